"""From a flight to a nonlinear program."""
