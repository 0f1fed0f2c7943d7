"""What is proved of a flight in a plane."""
