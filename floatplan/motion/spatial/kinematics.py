"""Where the bodies of a robot with a free base are, their lowest points, and limbs that bring a body to a pose.

The kernel computes all of it, at many instants at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from floatplan.arrays import Array
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct, doubles, integers, layout
from floatplan.motion.spatial.bodies import BodyPoses
from floatplan.motion.spatial.dynamics import SpatialDynamics, spatial_dynamics
from floatplan.problem.attitude import required
from floatplan.problem.parts import JointState
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import LinkSolid
from floatplan.robot.urdf.base import FREE_FLYER as BASE


@lru_cache(maxsize=16)
def free_dynamics(robot: Robot) -> SpatialDynamics:
    """Momentum and torques by all joints that move, in the order of the model."""
    count = len(robot.model_joints)
    return SpatialDynamics(robot.model, np.zeros(count), np.eye(count))


def body_poses(robot: Robot, base_positions: Array, attitudes: Array, positions: Array) -> BodyPoses:
    """Return where the bodies of a robot's free-flyer model are at K instants, in the world.

    Parameters
    ----------
    robot : with a free base, whose joints have one coordinate each
    base_positions : (K, 3) m
    attitudes : (K, 3, 3)
    positions : (K, J) rad
    """
    count = len(positions)
    bodies = robot.model.njoints
    places = np.empty((count, bodies, 3))
    rotations = np.empty((count, bodies, 3, 3))
    places[:, 0] = 0.0
    rotations[:, 0] = np.eye(3)
    _run(
        "poses",
        free_dynamics(robot).tree,
        Struct(
            "SpatialPoses",
            instants=count,
            base=doubles(base_positions),
            attitudes=doubles(attitudes),
            positions=doubles(positions),
            places=places,
            rotations=rotations,
        ),
    )
    return BodyPoses(places, rotations)


def poses_about(robot: Robot, attitudes: Array, positions: Array, com: Array) -> BodyPoses:
    """Return where bodies are with attitudes (K, 3, 3), planned joints (K, n), rad, centres of mass at (K, 3), m."""
    dynamics = spatial_dynamics(robot)
    joints = dynamics.reference + positions @ dynamics.selection.T
    at_origin = body_poses(robot, np.zeros((len(positions), 3)), attitudes, joints)
    moved = com - centre_of_mass(robot, at_origin)
    return BodyPoses(at_origin.places + moved[:, None], at_origin.rotations)


def posture_about(robot: Robot, state: JointState, com: Array) -> BodyPoses:
    """Return the same of a posture, K = 1, with its centre of mass at (3,), m."""
    return poses_about(robot, required(state.attitude).matrix[None], state.positions[None], com[None])


def _run(function: str, *structs: Struct) -> None:
    """Call a function of the kernel.

    Raises
    ------
    MemoryError
        There is not enough for it.
    """
    compiled = kernel()
    if getattr(compiled, function)(*[struct.pointer for struct in structs], compiled.instructions):
        raise MemoryError


def centre_of_mass(robot: Robot, poses: BodyPoses) -> Array:
    """Places (K, 3) of the centre of mass, m, in the world."""
    masses, levers = _masses(robot)
    moments = np.einsum("b,kba->ka", masses, poses.places) + np.einsum("kbac,bc->ka", poses.rotations, levers)
    return np.asarray(moments / masses.sum())


@lru_cache(maxsize=16)
def _masses(robot: Robot) -> tuple[Array, Array]:
    """Masses (B,) of the bodies, kg, and first moments (B, 3) in their own frames, kg m; nothing of the world's."""
    inertias = list(robot.model.inertias)[1:]
    masses = np.array([0.0, *(inertia.mass for inertia in inertias)])
    levers = np.array([np.zeros(3), *(inertia.lever for inertia in inertias)])
    return masses, masses[:, None] * levers


@dataclass(frozen=True, eq=False)
class BodySolids:
    """Convex solids in G groups, mostly those of a body each.

    Attributes
    ----------
    groups : (G,) sequences of LinkSolid
    """

    groups: tuple[Sequence[LinkSolid], ...]

    def lowest(self, poses: BodyPoses) -> Array:
        """Lowest point (K, G, 3) of each group, m, in the world."""
        lowest = np.empty((len(poses.places), len(self.groups), 3))
        _run("lowest", self._placed(poses, lowest=lowest))
        return lowest

    def reach(self, poses: BodyPoses, levels: Array, directions: Array) -> Array:
        """How far (K, D), m, points on the ground reach from the world's origin in D directions.

        Minus infinity where there are none.

        Parameters
        ----------
        levels : (K, G) m, up to which a group's points are on the ground; of a ball about a point, what is lowest
        directions : (D, 2) horizontal unit vectors
        """
        reach = np.empty((len(poses.places), len(directions)))
        members = {"directions": len(directions), "direction": doubles(directions), "levels": doubles(levels)}
        _run("reach", self._placed(poses, reach=reach, **members))
        return reach

    def _placed(self, poses: BodyPoses, **members: Any) -> Struct:
        """The kernel's struct, with what is to be computed."""
        places = {"places": doubles(poses.places), "rotations": doubles(poses.rotations)}
        count, bodies, _ = poses.places.shape
        shapes = dict.fromkeys(layout("PlacedSolids").arrays) | self._shapes
        return Struct("PlacedSolids", **(shapes | places | members), instants=count, bodies=bodies)

    @cached_property
    def _shapes(self) -> dict[str, Any]:
        """The members of the kernel's struct that are the same at all instants."""
        solids: list[LinkSolid] = []
        groups: list[int] = []
        for group, members in enumerate(self.groups):
            solids += members
            groups += [group] * len(members)
        points = [solid.points for solid in solids]
        return {
            "solids": len(solids),
            "groups": len(self.groups),
            "body": integers([solid.body for solid in solids]),
            "group": integers(groups),
            "first": integers(np.cumsum([0, *map(len, points)])),
            "points": doubles(np.concatenate(points)),
            "axes": doubles([solid.axes for solid in solids]),
        }


def in_body(poses: BodyPoses, body: int, points: Array) -> Array:
    """Points (K, 3) of the world, one at each instant, in a body's frame, m."""
    return np.asarray(np.einsum("kba,kb->ka", poses.rotations[:, body], points - poses.places[:, body]))


def on_body(poses: BodyPoses, body: int, local: Array) -> Array:
    """Places (K, 3) in the world, m, of points (K, 3) in a body's frame, one at each instant."""
    return np.asarray(poses.places[:, body] + np.einsum("kab,kb->ka", poses.rotations[:, body], local))


@dataclass(frozen=True, eq=False)
class Limb:
    """The joints from the base to a body, some of which move no other body of interest.

    Attributes
    ----------
    robot : Robot
    chain : joints of the model, from the base outwards, the last of which carries the body
    moved : those of them that may be moved, in the same order
    """

    robot: Robot
    chain: tuple[int, ...]
    moved: tuple[int, ...]

    def bent(
        self, base_positions: Array, attitudes: Array, positions: Array, local: Array, target: Array, attitude: Array
    ) -> Array:
        """Positions (K, m) of the moved joints with which a point of the last body is where it is to be.

        The body's attitude is brought near its own target as far as the limb has joints for that.

        Parameters
        ----------
        base_positions : (K, 3) m
        attitudes : (K, 3, 3), of the base
        positions : (K, J) rad, where the joints begin
        local : (K, 3) m, the point in the body's frame
        target : (K, 3) m, where it is to be in the world
        attitude : (K, 3, 3), that of the body
        """
        columns = np.array([self.robot.model.idx_vs[joint] for joint in self.chain]) - BASE
        result = doubles(positions[:, columns])
        targets = Struct(
            "LimbTargets",
            instants=len(positions),
            links=len(columns),
            sweeps=30,  # steps of Levenberg and Marquardt: those of bent limbs converge in 3 to 8
            chain=integers(columns),
            moves=integers([joint in self.moved for joint in self.chain]),
            base=doubles(base_positions),
            attitudes=doubles(attitudes),
            local=doubles(local),
            target=doubles(target),
            attitude=doubles(attitude),
            turn_weight=0.01,  # [m/rad] with fewer than six joints the position wins
            damping=1e-7,  # [m^2] at the least
            settled=1e-8,  # [rad] the next step changes nothing
            positions=result,
        )
        _run("bend", free_dynamics(self.robot).tree, targets)
        return result[:, [self.chain.index(joint) for joint in self.moved]]
