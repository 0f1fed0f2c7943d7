"""URDF files: read, checked, as a tree of links and joints; example robots."""
