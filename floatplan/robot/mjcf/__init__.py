"""MJCF files: read, compiled by MuJoCo, written as the URDF that all else reads."""
