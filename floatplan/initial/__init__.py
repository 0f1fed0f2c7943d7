"""A first problem for any robot: what it stands on, a flight that can begin and end, and its problem file."""
