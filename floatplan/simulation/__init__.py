"""Does a plan fly? Forward dynamics under its torques."""
