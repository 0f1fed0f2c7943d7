"""Flight in space: attitudes follow from a differential equation."""
