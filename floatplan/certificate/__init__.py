"""Is a plan true, for every instant? From its record and its URDF only."""
