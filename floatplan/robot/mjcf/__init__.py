"""MJCF files: read, compiled by MuJoCo, written as the URDF that the rest of the house knows."""
