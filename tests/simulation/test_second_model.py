"""A jump lands in a second model with contact: MuJoCo's own reading of the URDF, capsules, a loop of its own."""

from dataclasses import dataclass
from math import atan2, pi
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from jumps import planned_jump

import floatplan as fp

FRICTION = 0.8
GAINS = {"go2": (57.0, 0.98), "a1": (56.0, 0.98)}  # that `fp.replay_jump` finds; MuJoCo takes no Go1, for its inertias
SOFT_GAINS = (40.0, 1.0)  # [N m/rad, N m s/rad]
STEP, EVERY, AFTER = 1e-3, 2, 1.0  # [s], steps of the control, [s]
LEGS = ("FL", "FR", "RL", "RR")
FEET = {"floor", *(f"{leg}_foot" for leg in LEGS)}


def model_of(
    jump: fp.Jump, heavier: float = 1.0, friction: float = FRICTION, contact: float = 6e-3, shank: float = 0.01
) -> tuple[mujoco.MjModel, float]:
    """The URDF as MuJoCo reads it, on a free base; its links' capsules and its feet's spheres; their radius, m.

    Masses are ``heavier`` times those of the file, contacts yield with a time constant ``contact``, s, and shanks have
    a radius, m.
    """
    robot = jump.problem.robot
    urdf = ElementTree.fromstring(robot.xml)
    for link in urdf.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    ElementTree.SubElement(ElementTree.SubElement(urdf, "mujoco"), "compiler", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(urdf, encoding="unicode"))
    spec.option.timestep, spec.option.cone = STEP, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10  # at MuJoCo's own 1, feet creep while they push, and it falls
    spec.body(robot.layout.tree.root).add_freejoint()
    touching = {"friction": [friction, 0, 0], "solref": [contact, 1]}
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], zaxis=[0, 0, 1], **touching)
    (radius,) = {round(each.depth, 6) for stance in jump.stances for each in stance.contacts}
    for foot in {name for phase in jump.phases for name in phase.contacts}:
        spec.body(foot).add_geom(
            name=foot, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], contype=0, **touching
        )
    trunk = {"size": [0.06, 0, 0], "fromto": [-0.18, 0, 0, 0.18, 0, 0], "contype": 0, "friction": [friction, 0, 0]}
    spec.body(robot.layout.tree.root).add_geom(name="trunk", type=mujoco.mjtGeom.mjGEOM_CAPSULE, **trunk)
    for leg in LEGS:
        bone = {"size": [shank, 0, 0], "fromto": [0, 0, 0, 0, 0, -0.15], "contype": 0, "friction": [friction, 0, 0]}
        spec.body(f"{leg}_calf").add_geom(name=f"{leg} shank", type=mujoco.mjtGeom.mjGEOM_CAPSULE, **bone)
    model = spec.compile()
    model.body_mass[:] *= heavier
    model.body_inertia[:] *= heavier
    return model, radius


@dataclass(frozen=True)
class Landed:
    """How a flight ended: the whole turn, rad; tilt of the quaternion; height of the base, m; what touched."""

    turned: float
    tilt: float
    height: float
    touched: set[str]

    @property
    def stands(self) -> bool:
        """Whether it turned over once, backwards, and stands."""
        return abs(self.turned + 2 * pi) < 0.2 and self.tilt < 0.1 and self.height > 0.2


def flown(jump: fp.Jump, model: mujoco.MjModel, radius: float, gains: tuple[float, float], correct: bool) -> Landed:
    """Fly the jump in a model whose joints follow it, with corrections in flight or without."""
    assert jump.flight is not None
    replanner, robot, begin = fp.Replanner(jump.flight, rate=250), jump.problem.robot, jump.takeoff_time
    data = mujoco.MjData(model)
    stiffness, damping = gains
    names = list(robot.model.names)[4:]
    planned, motors = ([names.index(name) for name in which] for which in (robot.joints, robot.motors))
    rows, columns = ([getattr(model.joint(name), key)[0] for name in names] for key in ("qposadr", "dofadr"))
    low, high = model.jnt_actfrcrange[[model.joint(name).id for name in names]].T
    times = np.arange(0.0, jump.duration + AFTER, EVERY * STEP)
    q, v, tau = (each(np.minimum(times, jump.duration)) for each in (jump.q, jump.v, jump.tau))
    data.qpos[:7], data.qpos[rows] = q[0, [0, 1, 2, 6, 3, 4, 5]], q[0, 7:]
    mujoco.mj_kinematics(model, data)
    data.qpos[2] += radius - data.geom("FL_foot").xpos[2]
    touched, turned, last = set[str](), 0.0, 0.0
    for row in range(len(times)):
        goal, rate, torque = q[row, 7:].copy(), v[row, 6:].copy(), tau[row, 6:].copy()
        places, rates, time = data.qpos[rows], data.qvel[columns], row * EVERY * STEP - begin
        if correct and 0 <= time < jump.flight.duration:
            replanner.update(time, 2 * atan2(data.qpos[5], data.qpos[3]), data.qvel[4], places[planned], rates[planned])
            wanted = replanner.reference(time)
            goal[motors], rate[motors] = robot.motor_ratios @ wanted.positions, robot.motor_ratios @ wanted.velocities
            torque[motors] = replanner.reference(time + EVERY * STEP / 2).motors
        torque += stiffness * (goal - places) + damping * (rate - rates)
        data.qfrc_applied[columns] = np.clip(torque, low, high)
        mujoco.mj_step(model, data, nstep=EVERY)
        touched |= {model.geom(geom).name for pair in data.contact.geom.tolist() for geom in pair}
        pitch = 2 * atan2(data.qpos[5], data.qpos[3])
        turned, last = turned + (pitch - last + pi) % (2 * pi) - pi, pitch
    return Landed(turned, abs(data.qpos[4]) + abs(data.qpos[6]), data.qpos[2], touched)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "heavier", "correct"),
    [
        *(("go2", mass, False) for mass in (0.95, 0.975, 1.0, 1.025)),
        *(("go2", mass, True) for mass in (1.05, 0.95)),
        *(("a1", 1.0, False), ("a1", 1.05, True)),
    ],
)
def test_it_lands_there_too(name: str, heavier: float, correct: bool) -> None:
    """All 5 % heavier a Go2 turns 5 degrees less than planned, and lands with corrections in flight alone."""
    jump = planned_jump(name)
    landed = flown(jump, *model_of(jump, heavier), GAINS[name], correct)
    assert landed.stands
    assert landed.touched <= FEET


@pytest.mark.long
def test_soft_joints_with_rotors_of_their_own_land_there() -> None:
    """A dozen Go2 whose joints hardly hold, on grounds of any grip, with rotors that nobody knows and thick shanks."""
    jump = planned_jump("go2")
    stand = alone = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        contact = (4e-3, 8e-3, 10e-3)[seed % 3]
        model, radius = model_of(jump, friction=float(rng.uniform(0.7, 1.0)), contact=contact, shank=0.0125)
        model.dof_armature[6:] = rng.uniform(0.0, 0.005)
        landed = flown(jump, model, radius, SOFT_GAINS, correct=False)
        stand += landed.stands
        alone += landed.stands and landed.touched <= FEET
    assert stand == 12
    assert alone >= 11
