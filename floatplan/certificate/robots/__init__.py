"""The robot as the certificate reads it by itself, from a URDF and a plan's record: for a plane and for space."""
