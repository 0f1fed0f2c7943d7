"""The links' shapes in the plane."""
