"""Hops of clips followed in MuJoCo by a controller that knows nothing of them: who is upright after the landing?

A run begins as the clip takes off, with its own configuration and velocity, a little disturbed; a robot that is a
little heavier or lighter than its model. Joints follow the clip by stiffness and damping, beside the torques that the
clip would take: in the air those of free flight, on the ground with the smallest forces on the feet that hold the base.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from drawn_hops import HOPPERS, Hop, draw_hops, stretched
from measuring import Counts, heading, table
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.clips.clip import Clip
from floatplan.clips.flights import SAMPLING, ClipFlight
from floatplan.clips.repair import repair_clip
from floatplan.clips.repaired_motion import RepairedMotion
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.simulation.gains import critical_gains, joint_inertia
from floatplan.simulation.mujoco_model import MujocoRobot, MujocoSpec
from floatplan.simulation.perturbation import Perturbation, Sample
from floatplan.simulation.reduced_model import ReducedModel, reduced_model

Array = NDArray[np.float64]
GRAVITY = 9.81  # [m/s^2]
RATE = 500.0  # [Hz] of the controller
DETECTED = 1 / SAMPLING.rate  # [s] to which a takeoff is detected: a run begins so much later, surely in flight
STEPS = 4  # [-] of the simulation in one of its periods
BANDWIDTH = 60.0  # [rad/s] of its feedback in the air
HOLDS = 2.0  # [-] least stiffness, in weights times heights of the robot
FRICTION = 0.8  # [-] of the ground
AFTER = 0.2  # [s] after the landing, when it is looked at
TIPPED = np.deg2rad(45.0)  # [rad] off the clip's attitude: no less is upright
LOW = 0.6  # [-] of the clip's height: no less is upright
DISTURBED = {"mass": 0.03, "inertia": 0.03}
PUSHED = (0.02, 0.05, 0.02)  # [m/s, rad/s, rad] standard deviations of takeoff: of speed, of turning, of attitude
STRETCH = 1.45  # [-] in time: what retargeted jumps have
SWING = 15.0  # [degree] by which the base turns on from the takeoff, and back
RUNS = 20  # [-] of a hop
FEW, MANY = 2, 18  # [-] runs upright of these: of a clip that does not fly, of one that does
ROBOTS = ("g1", "go2")


@dataclass(frozen=True, eq=False)
class Followed:
    """A clip from takeoff on, K instants of the controller: configurations, velocities, torques, and the landing, s."""

    configurations: Array
    velocities: Array
    torques: Array
    landing: float


def followed(clip: Clip, flight: ClipFlight, flat: bool) -> Followed:
    """Prepare a clip at the controller's rate to be followed from a flight's takeoff on; feet are soles or balls."""
    assert clip.velocities is not None
    first = int(np.ceil((flight.begin + DETECTED) * RATE))
    last = min(int((flight.end + AFTER) * RATE) + 2, clip.frames - 1)
    q = clip.configurations[first : last + 1]
    v = clip.velocities[first : last + 1]
    a = np.gradient(v, axis=0) * RATE
    in_air = np.arange(first, last + 1) / RATE <= flight.end
    model = clip.robot.model
    data = model.createData()
    feet = [model.getFrameId(foot, pin.FrameType.BODY) for foot in clip.scene.foot_names]
    torques = np.empty((len(q), model.nv - 6))
    for k, flies in enumerate(in_air):
        needed = pin.rnea(model, data, q[k], v[k], a[k])
        if not flies:
            pin.computeJointJacobians(model, data, q[k])
            pin.updateFramePlacements(model, data)
            rows = [pin.getFrameJacobian(model, data, foot, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED) for foot in feet]
            of_feet = np.concatenate([row if flat else row[:3] for row in rows])
            forces, *_ = np.linalg.lstsq(of_feet[:, :6].T, needed[:6], rcond=None)
            needed -= of_feet.T @ forces
        torques[k] = needed[6:]
    return Followed(q, v, torques, flight.end - first / RATE)


def world(robot: fp.Robot, clip: Clip, reduced: ReducedModel, sample: Sample) -> MujocoRobot:
    """A robot over a floor that its feet alone touch: as balls and hulls, as the clip's scene has them."""
    mujoco = import_mujoco()
    geoms = mujoco.mjtGeom
    parts = MujocoSpec(robot, reduced, sample, free=True)
    spec = parts.spec
    spec.option.timestep = 1.0 / (RATE * STEPS)
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_LIMIT
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    floor = {"type": geoms.mjGEOM_PLANE, "size": [0, 0, 1], "contype": 1, "friction": [FRICTION, 0, 0]}
    spec.worldbody.add_geom(name="floor", **floor)
    touching = {"contype": 0, "conaffinity": 1, "friction": [0, 0, 0]}
    for foot, (body, solids) in enumerate(zip(clip.scene.foot_bodies, clip.scene.foot_solids.groups, strict=True)):
        for number, solid in enumerate(solids):
            name = f"foot {foot}, {number}"
            radius = float(np.linalg.norm(solid.axes, axis=0).max())
            if len(solid.points) > 3:
                spec.add_mesh(name=name, uservert=solid.points.ravel())
                parts.bodies[body].add_geom(name=name, type=geoms.mjGEOM_MESH, meshname=name, **touching)
            elif radius > 0:
                for point in solid.points:
                    parts.bodies[body].add_geom(type=geoms.mjGEOM_SPHERE, size=[radius, 0, 0], pos=point, **touching)
    return MujocoRobot(parts)


def lands_upright(clip: Clip, wanted: Followed, run: int) -> bool:
    """Follow it once, disturbed by a seed; whether the robot is upright after the landing, and not low."""
    robot = clip.robot
    model = robot.model
    reduced = reduced_model(robot, GRAVITY, ())
    sample = Perturbation(**DISTURBED).sampled(0, run, len(reduced.joints), reduced.model.njoints)
    simulated = world(robot, clip, reduced, sample)
    rng = np.random.default_rng(run)
    q = np.array(wanted.configurations[0])
    v = np.array(wanted.velocities[0])
    speed, turning, angle = PUSHED
    v[:3] += speed * rng.normal(size=3)
    v[3:6] += turning * rng.normal(size=3)
    q[3:7] = (Rotation.from_quat(q[3:7]) * Rotation.from_rotvec(angle * rng.normal(size=3))).as_quat()
    simulated.data.qpos[:], simulated.data.qvel[:] = simulated.own_state(q, v)
    stiffness, damping = critical_gains(BANDWIDTH, joint_inertia(model, wanted.configurations[0]))
    stands = HOLDS * robot.mass * GRAVITY * float(wanted.configurations[-1][2])
    damping = damping * np.sqrt(np.maximum(stiffness, stands) / stiffness)
    stiffness = np.maximum(stiffness, stands)
    limits = np.where(np.isfinite(model.effortLimit[6:]), model.effortLimit[6:], np.inf)
    periods = min(int((wanted.landing + AFTER) * RATE), len(wanted.torques))
    for k in range(periods):
        positions = simulated.data.qpos[simulated.positions]
        rates = simulated.data.qvel[simulated.velocities]
        feedback = stiffness * (wanted.configurations[k, 7:] - positions) + damping * (wanted.velocities[k, 6:] - rates)
        torques = np.clip(wanted.torques[k] + feedback, -limits, limits)
        simulated.data.qfrc_applied[simulated.velocities] = torques
        for _ in range(STEPS):
            simulated.step()
    if not np.isfinite(simulated.data.qpos).all():
        return False
    now, _ = simulated.reduced_state(simulated.data.qpos, simulated.data.qvel)
    planned = wanted.configurations[periods - 1]
    up = Rotation.from_quat(now[3:7]).as_matrix()[2] @ Rotation.from_quat(planned[3:7]).as_matrix()[2]
    return bool(np.arccos(np.clip(up, -1.0, 1.0)) < TIPPED and now[2] > LOW * planned[2])


def swung(hop: Hop, fps: float, factor: float, degrees: float, axis: Array) -> Clip:
    """The hop slower by a factor, whose base turns on from the takeoff and back until the landing, about an axis."""
    clip = stretched(hop, fps, factor)
    s = np.clip((clip.times - hop.takeoff) / (factor * hop.flight), 0.0, 1.0)
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * np.sin(np.pi * s)[:, None] * axis)
    return replace(clip, base_quaternion=(turn * Rotation.from_quat(clip.base_quaternion)).as_quat())


def clip_landings(counts: Counts) -> None:
    """How often hops are upright after the landing: as their clip is, and repaired."""
    heading("Recorded motions: followed in MuJoCo, upright after the landing")
    print(f"stretched by {STRETCH:g}, the base swung by {SWING:g} degrees; of {RUNS} disturbed runs each")
    rows = []
    hard = good = 0
    for name in ROBOTS:
        for number, hop in enumerate(draw_hops(name, counts.clip_landings)):
            angle = 2.0 * np.pi * number / counts.clip_landings
            clip = swung(hop, 50.0, STRETCH, SWING, np.array([np.cos(angle), np.sin(angle), 0.0]))
            repaired, told = repair_clip(clip, rate=RATE)
            if not told.changed:
                rows.append([name, number, "-", "-", "not repairable"])
                continue
            upright = []
            for each in (RepairedMotion(clip, {}).clip(RATE), repaired):
                wanted = followed(each, each.flights[0], HOPPERS[name].flat)
                upright.append(sum(lands_upright(each, wanted, run) for run in range(RUNS)))
            rows.append([name, number, *upright, told.flights[0].to_dict()["choice"]])
            hard += upright[0] <= FEW
            good += upright[0] <= FEW and upright[1] >= MANY
    table(["robot", "hop", "spoiled", "repaired", "choice"], rows)
    print(f"of {hard} hops of which at most {FEW} runs are upright as spoiled, {good} are in {MANY} at least, repaired")
    print()
