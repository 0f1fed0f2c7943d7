"""The scene: the robot in flight, its postures at both ends, and obstacles."""
