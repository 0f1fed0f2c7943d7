"""What flies: URDF files checked and read, the planar free-flyer, and the robot's shape in its plane."""

from floatplan.robot.parts import Coupling, Frame, LinkCapsule, Plane
from floatplan.robot.planar.tree import PlanarTree
from floatplan.robot.robot import Robot

__all__ = ["Coupling", "Frame", "LinkCapsule", "PlanarTree", "Plane", "Robot"]
