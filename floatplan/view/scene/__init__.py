"""The flight in three dimensions."""
