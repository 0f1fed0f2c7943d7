"""What flies: URDF files checked and read, the planar free-flyer, and the robot's shape in its plane."""

from floatplan.robot.robot import Coupling, Frame, LinkCapsule, PlanarTree, Plane, Robot

__all__ = ["Coupling", "Frame", "LinkCapsule", "PlanarTree", "Plane", "Robot"]
