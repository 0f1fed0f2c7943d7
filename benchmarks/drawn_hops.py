"""True motions of robots that hop, drawn by seed: a stance, a flight that conserves momentum, a stance.

Flights may be spoiled: stretched in time, drifted, shifted, with noise.

At every instant the feet's velocities, that of the centre of mass and the angular momentum are prescribed, and the
velocities of base and legs follow from them: as many equations as unknowns. Their integral is the motion. In the
air the centre of mass falls at g and the momentum is constant; feet are at rest where they stand, and as they leave and
arrive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.clips.clip import Clip, FileLayout
from floatplan.clips.formats import continuous_signs
from floatplan.motion.spatial.kinematics import BodySolids, body_poses

Array = NDArray[np.float64]
GRAVITY = 9.81  # [m/s^2]
STANDING = 0.3  # [s] at rest, before and after
STEP = 1 / 400  # [s] at most, of the integration by Runge and Kutta's method of the fourth order
FASTEST = 25.0  # [rad/s] of a joint in a hop that is taken


@dataclass(frozen=True)
class Hopper:
    """A robot that hops.

    Attributes
    ----------
    source : of its URDF
    feet : links
    flat : whether its feet are soles, which keep their attitude, or balls, which roll
    posture : rad, by a part of a joint's name, as it stands
    duration : s, least and most of a flight
    crouch : m, by which the centre of mass is lowered before takeoff
    """

    source: str
    feet: tuple[str, ...]
    flat: bool
    posture: dict[str, float]
    duration: tuple[float, float]
    crouch: float


HOPPERS = {
    "go2": Hopper(
        source="example-robot-data:go2_description/urdf/go2.urdf",
        feet=("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
        flat=False,
        posture={"thigh": 0.8, "calf": -1.6},
        duration=(0.3, 0.5),
        crouch=0.07,
    ),
    "solo12": Hopper(
        source="example-robot-data:solo_description/robots/solo12.urdf",
        feet=("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"),
        flat=False,
        posture={"FL_HFE": 0.8, "FR_HFE": 0.8, "HL_HFE": -0.8, "HR_HFE": -0.8}
        | {"FL_KFE": -1.6, "FR_KFE": -1.6, "HL_KFE": 1.6, "HR_KFE": 1.6},
        duration=(0.26, 0.36),
        crouch=0.04,
    ),
    "g1": Hopper(
        source="example-robot-data:g1_description/urdf/g1_29dof_rev_1_0.urdf",
        feet=("left_ankle_roll_link", "right_ankle_roll_link"),
        flat=True,
        posture={"hip_pitch": -0.5, "knee": 1.0, "ankle_pitch": -0.5, "elbow": 0.9},
        duration=(0.3, 0.5),
        crouch=0.1,
    ),
}


@dataclass(frozen=True, eq=False)
class Hop:
    """A true motion of a robot: it stands, crouches, flies, and stands.

    Attributes
    ----------
    robot : Robot
    takeoff, landing, duration : s, from the beginning: when the flight begins, when it ends, and when all ends
    parts : the curve (7 + J,) of each part that is smooth, with its first and last instant, s
    """

    robot: fp.Robot
    takeoff: float
    landing: float
    duration: float
    parts: tuple[tuple[float, float, CubicSpline], ...]

    @property
    def flight(self) -> float:
        """How long it lasts, s."""
        return self.landing - self.takeoff

    def configurations(self, times: Array) -> Array:
        """Configurations (K, 7 + J) at times (K,), s: place, quaternion x, y, z, w, joints."""
        result = np.empty((len(times), self.robot.model.nq))
        for number, (begin, end, curve) in enumerate(self.parts):
            chosen = (times >= begin) if number else np.ones(len(times), bool)
            result[chosen] = curve(np.clip(times[chosen], begin, end))
        result[:, 3:7] /= np.linalg.norm(result[:, 3:7], axis=1, keepdims=True)
        return result


@cache
def robot_of(name: str) -> fp.Robot:
    """Return one of the robots, with a free base."""
    return fp.Robot.from_urdf(HOPPERS[name].source, base="free-flyer")


class Body:
    """A robot whose legs do what feet and momentum ask of them.

    Parameters
    ----------
    name : of the robot
    """

    def __init__(self, name: str) -> None:
        self.robot = robot_of(name)
        self.hopper = HOPPERS[name]
        self.model = self.robot.model
        self.data = self.model.createData()
        self.frames = [self.model.getFrameId(foot, pin.FrameType.BODY) for foot in self.hopper.feet]
        legs = set()
        for frame in self.frames:
            joint = self.model.frames[frame].parentJoint
            while joint > 1 and "waist" not in self.model.names[joint]:
                legs.add(self.model.joints[joint].idx_v)
                joint = self.model.parents[joint]
        self.others = [column for column in range(6, self.model.nv) if column not in legs]
        self.solved = [*range(6), *sorted(legs)]
        self.standing = self._standing()

    def _standing(self) -> Array:
        """The usual configuration (7 + J,), its feet on the ground; it sets ``sole``, m, below a foot's origin."""
        joints = np.zeros(len(self.robot.model_joints))
        for column, joint in enumerate(self.robot.model_joints):
            for word, angle in self.hopper.posture.items():
                if word in joint:
                    joints[column] = angle
        feet = {self.model.frames[frame].parentJoint for frame in self.frames}
        poses = body_poses(self.robot, np.zeros((1, 3)), np.eye(3)[None], joints[None])
        solids = BodySolids(([solid for solid in self.robot.solids if solid.body in feet],))
        lowest = float(solids.lowest(poses)[0, 0, 2])
        configuration = np.concatenate(([0.0, 0.0, -lowest, 0.0, 0.0, 0.0, 1.0], joints))
        pin.framesForwardKinematics(self.model, self.data, configuration)
        self.sole = float(np.mean([self.data.oMf[frame].translation[2] for frame in self.frames]))
        return configuration

    def velocity(self, configuration: Array, feet: Array, centre: Array, momentum: Array, others: Array) -> Array:
        """Velocity (nv,) by which feet, centre of mass, angular momentum and the other joints move as they are given.

        Parameters
        ----------
        feet : (F, 6) m/s and rad/s, of each foot's lowest point, in the world; balls leave their turning open
        centre : (3,) m/s
        momentum : (3,) kg m^2/s
        others : rad/s, of joints that move no foot
        """
        pin.computeJointJacobians(self.model, self.data, configuration)
        pin.updateFramePlacements(self.model, self.data)
        below = pin.skew(np.array([0.0, 0.0, -self.sole]))
        rows = []
        targets = []
        for frame, velocity in zip(self.frames, feet, strict=True):
            jacobian = pin.getFrameJacobian(self.model, self.data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            if self.hopper.flat:
                rows.append(jacobian)
                targets.append(velocity)
            else:
                rows.append(jacobian[:3] - below @ jacobian[3:])
                targets.append(velocity[:3])
        rows.append(np.array(pin.computeCentroidalMap(self.model, self.data, configuration)))
        targets += [self.robot.mass * centre, momentum]
        matrix = np.concatenate(rows)
        result = np.zeros(self.model.nv)
        result[self.others] = others
        target = np.concatenate(targets) - matrix[:, self.others] @ others
        result[self.solved] = np.linalg.solve(matrix[:, self.solved], target)
        return result

    def integrate(self, start: Array, duration: float, velocity: Callable[[Array, float], Array]) -> Array | None:
        """Configurations (K, 7 + J) at equal steps of a time; None where joints become too fast.

        Parameters
        ----------
        duration : s, negative where the motion is followed backwards
        velocity : of a configuration and the time since the start
        """
        count = int(np.ceil(abs(duration) / STEP))
        step = duration / count
        rows = [start]
        for k in range(count):
            now = rows[-1]
            time = k * step
            first = velocity(now, time)
            second = velocity(pin.integrate(self.model, now, 0.5 * step * first), time + 0.5 * step)
            third = velocity(pin.integrate(self.model, now, 0.5 * step * second), time + 0.5 * step)
            last = velocity(pin.integrate(self.model, now, step * third), time + step)
            mean = (first + 2 * second + 2 * third + last) / 6
            if not np.abs(mean[6:]).max() < FASTEST:
                return None
            rows.append(pin.integrate(self.model, now, step * mean))
        return np.array(rows)


@cache
def body_of(name: str) -> Body:
    """Return the body of a robot."""
    return Body(name)


def draw_hop(name: str, rng: np.random.Generator) -> Hop | None:
    """Draw a hop; None where the numbers that were drawn ask too much of the legs."""
    body = body_of(name)
    hopper = body.hopper
    flight = float(rng.uniform(*hopper.duration))
    across = 0.25 * rng.normal(size=2)
    rates = np.deg2rad([20.0, 20.0, 40.0]) * rng.normal(size=3)  # rad/s, about which the robot turns in the mean
    clearance = rng.uniform(0.8, 1.2) * GRAVITY * flight**2 / 8  # m, of the feet at the top
    start = body.standing.copy()
    pin.ccrba(body.model, body.data, start, np.zeros(body.model.nv))
    momentum = np.array(body.data.Ig.inertia) @ rates
    up = GRAVITY * flight / 2
    tilt = Rotation.from_rotvec(np.deg2rad([1.0, 1.0, 1.0]) * rng.normal(size=3))
    swing = rng.normal(size=len(body.others)) * np.deg2rad(20.0)
    level = np.zeros((len(hopper.feet), 6))
    no_others = np.zeros(len(body.others))

    def tilting(configuration: Array, time: float) -> Array:
        # the base tilts over feet that stand, as from a momentum; the centre of mass goes down and aside
        pin.ccrba(body.model, body.data, configuration, np.zeros(body.model.nv))
        turning = np.array(body.data.Ig.inertia) @ tilt.as_rotvec()
        return body.velocity(configuration, level, np.array([0.0, 0.0, -0.3 * hopper.crouch]), turning, no_others)

    def flying(configuration: Array, time: float) -> Array:
        s = time / flight
        feet = np.tile(np.concatenate((across, [0.0, 0.0, 0.0, 0.0])), (len(hopper.feet), 1))
        bump = 32 * s * (1 - s) * (1 - 2 * s) / flight  # rate of 16 s^2 (1-s)^2
        feet[:, 2] = clearance * bump
        feet[:, :2] *= 30 * s**2 * (1 - s) ** 2
        centre = np.array([*across, up - GRAVITY * time])
        return body.velocity(configuration, feet, centre, momentum, swing * bump)

    def standing(centre: Array, stance: float) -> Callable[[Array, float], Array]:
        def velocity(configuration: Array, time: float) -> Array:
            s = min(abs(time) / stance, 1.0)
            share = (1 - s) ** 2 * (1 + 2 * s)
            return body.velocity(configuration, level, share * centre, share * momentum, no_others)

        return velocity

    try:
        tilted = body.integrate(start, 1.0, tilting)
        if tilted is None:
            return None
        flown = body.integrate(tilted[-1], flight, flying)
        if flown is None:
            return None
        stance = 2 * hopper.crouch / up
        before = body.integrate(flown[0], -stance, standing(np.array([*across, up]), stance))
        after = body.integrate(flown[-1], stance, standing(np.array([*across, -up]), stance))
    except np.linalg.LinAlgError:
        return None
    if before is None or after is None:
        return None
    takeoff = STANDING + stance
    landing = takeoff + flight
    parts = (
        _part(STANDING, takeoff, before[::-1]),
        _part(takeoff, landing, flown),
        _part(landing, landing + stance, after),
    )
    return Hop(body.robot, takeoff, landing, landing + stance + STANDING, parts)


def draw_hops(name: str, count: int) -> list[Hop]:
    """So many hops of a robot, with the seed 0."""
    rng = np.random.default_rng(0)
    hops: list[Hop] = []
    while len(hops) < count:
        hop = draw_hop(name, rng)
        if hop is not None:
            hops.append(hop)
    return hops


def _part(begin: float, end: float, configurations: Array) -> tuple[float, float, CubicSpline]:
    """The curve through configurations (K, 7 + J) at equal steps of time."""
    smooth = configurations.copy()
    smooth[:, 3:7] = continuous_signs(smooth[:, 3:7])
    return begin, end, CubicSpline(np.linspace(begin, end, len(smooth)), smooth)


def clip_of(hop: Hop, fps: float, configurations: Array | None = None, path: str = "drawn.csv") -> Clip:
    """Return a hop as a clip; of other configurations (N, 7 + J) where they are given."""
    q = hop.configurations(_frame_times(hop.duration, fps)) if configurations is None else configurations
    return Clip(
        robot=hop.robot,
        path=Path(path),
        fps=fps,
        base_position=q[:, :3],
        base_quaternion=continuous_signs(q[:, 3:7]),
        positions=q[:, 7:],
        layout=FileLayout("unitree-csv", hop.robot.model_joints),
    )


def _frame_times(duration: float, fps: float) -> Array:
    return np.arange(int(duration * fps) + 1) / fps


def in_a_row(hops: Sequence[Hop], fps: float, factor: float, stance: float, between: float) -> Clip:
    """Hops one after the other, whose flights are slower by a factor in time.

    Parameters
    ----------
    stance : s, that is left of each hop before and after its flight
    between : s, from the end of one hop to the posture in which the next begins
    """
    rows: list[Array] = []
    for hop in hops:
        q = stretched(hop, fps, factor).configurations
        first = int((hop.takeoff - stance) * fps)
        last = int((hop.landing + (factor - 1) * hop.flight + stance) * fps)
        part = q[first : last + 1].copy()
        if rows:
            part[:, :2] += rows[-1][-1, :2] - part[0, :2]
            rows.append(_from_to(rows[-1][-1], part[0], int(between * fps)))
        rows.append(part)
    return clip_of(hops[0], fps, np.concatenate(rows))


def _from_to(first: Array, last: Array, count: int) -> Array:
    """So many configurations (count, 7 + J) between two."""
    ends = np.stack([first, last])
    ends[:, 3:7] = continuous_signs(ends[:, 3:7])
    s = np.arange(1, count + 1)[:, None] / (count + 1)
    share = s**2 * (3 - 2 * s)
    return np.asarray(ends[0] + share * (ends[1] - ends[0]))


def rounded(clip: Clip, digits: int = 4) -> Clip:
    """The clip with so many digits after the point."""
    return replace(
        clip,
        base_position=np.round(clip.base_position, digits),
        base_quaternion=continuous_signs(np.round(clip.base_quaternion, digits)),
        positions=np.round(clip.positions, digits),
    )


def noisy(clip: Clip, rng: np.random.Generator, degrees: float, metres: float) -> Clip:
    """The clip with independent noise in every frame: of the attitude, of each joint, of each coordinate."""
    angle = np.deg2rad(degrees)
    noise = Rotation.from_rotvec(angle / np.sqrt(3) * rng.normal(size=(clip.frames, 3)))
    turned = noise * Rotation.from_quat(clip.base_quaternion)
    return replace(
        clip,
        base_position=clip.base_position + metres * rng.normal(size=clip.base_position.shape),
        base_quaternion=continuous_signs(turned.as_quat()),
        positions=clip.positions + angle * rng.normal(size=clip.positions.shape),
    )


def stretched(hop: Hop, fps: float, factor: float) -> Clip:
    """The hop with its flight slower by a factor in time."""
    longer = (factor - 1) * hop.flight
    times = _frame_times(hop.duration + longer, fps)
    in_flight = hop.takeoff + (times - hop.takeoff) / factor
    after = np.where(times > hop.landing + longer, times - longer, in_flight)
    return clip_of(hop, fps, hop.configurations(np.where(times < hop.takeoff, times, after)))


def drifted(hop: Hop, fps: float, degrees: float, axis: Array) -> Clip:
    """The hop whose base turns farther and back in its flight, by so much at most, about a unit vector."""
    times = _frame_times(hop.duration, fps)
    q = hop.configurations(times)
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * _bump(hop, times)[:, None] * axis)
    q[:, 3:7] = (turn * Rotation.from_quat(q[:, 3:7])).as_quat()
    return clip_of(hop, fps, q)


def shifted(hop: Hop, fps: float, metres: float, axis: Array) -> Clip:
    """The hop whose base moves aside and back in its flight, by so much at most, along a unit vector."""
    times = _frame_times(hop.duration, fps)
    q = hop.configurations(times)
    q[:, :3] += metres * _bump(hop, times)[:, None] * axis
    return clip_of(hop, fps, q)


def _bump(hop: Hop, times: Array) -> Array:
    """0 in the stances, 1 in the middle of the flight, (K,)."""
    s = np.clip((times - hop.takeoff) / hop.flight, 0.0, 1.0)
    return np.asarray(np.sin(np.pi * s) ** 2)
