"""Flight in a plane: momentum, orientation, torques, distances."""
