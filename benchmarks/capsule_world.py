"""A world for jumps in space that is not the package's: MuJoCo's own reading of the URDF, capsules, a loop of its own.

Of floatplan it uses what anyone has: ``jump.q``, ``v`` and ``tau``, and :class:`floatplan.Replanner`. Each robot has
masses 5 % off, each body's more or less, ground of friction 0.7 to 1 and rotors that nobody knows, and is measured late
and with noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

import mujoco
import numpy as np
import numpy.typing as npt

import floatplan as fp

Array = npt.NDArray[np.float64]

STEP = 1e-3  # [s] of MuJoCo
STEPS = 2  # in a period of the control
LATE = 2  # [-] periods until feedback and corrections know a measurement
NOISE = np.deg2rad(0.1)  # [rad] standard deviation of angles; of rates ten times as much, in 1/s
CONTACT = (6e-3, 1.0)  # [s, -] time constant and damping
AFTERWARDS = 1.0  # [s] that the robot is to stand


@dataclass(frozen=True)
class Flown:
    """How one robot ended: whether it stands, the geoms that touched the floor, the attitude's error, rad."""

    stands: bool
    touched: frozenset[str]
    error: float

    @property
    def clean(self) -> bool:
        """Whether it stands and touched the floor with its feet alone."""
        return self.stands and all(name.startswith("foot ") for name in self.touched)


def fly(jump: fp.Jump, seed: int, gains: Array, armature: float, replanner: fp.Replanner | None) -> Flown:
    """Fly one robot with rotors of at most ``armature``, kg m^2, in addition to those that the plan knows.

    Gains (P, 2, J) are stiffness and damping in each phase. A replanner corrects it in flight, at 250 Hz.
    """
    rng = np.random.default_rng(seed)
    world = World(jump, rng, armature)
    control = Control(jump, world, gains, replanner)
    touched: set[str] = set()
    error = np.nan
    for tick in range(round((jump.duration + AFTERWARDS) / (STEPS * STEP))):
        if np.isnan(error) and tick * STEPS * STEP >= control.landing:
            error = angle(world.data.qpos[3:7], control.goal)
        world.measure(rng)
        world.move(control.torques(tick))
        touched |= world.touching()
        if not np.isfinite(world.data.qpos).all():
            return Flown(False, frozenset(touched), error)
    return Flown(world.stands(control.planned_q[-1]), frozenset(touched), error)


class World:
    """A perturbed robot on the floor; the order of joints is the jump's."""

    def __init__(self, jump: fp.Jump, rng: np.random.Generator, armature: float) -> None:
        robot = jump.problem.robot
        self.names = list(robot.model.names)[2:]
        first = jump.q(np.zeros(1))[0]
        spec = spec_of(jump, friction=float(rng.uniform(0.7, 1.0)))
        model = spec.compile()
        factors = 1 + 0.05 * rng.choice((-1.0, 1.0), model.nbody)
        model.body_mass[:] *= factors
        model.body_inertia[:] *= factors[:, None]
        self.rows = np.array([model.joint(name).qposadr[0] for name in self.names])
        self.columns = np.array([model.joint(name).dofadr[0] for name in self.names])
        known = np.array([robot.armature.get(name, 0.0) for name in self.names])
        model.dof_armature[self.columns] = known + rng.uniform(0.0, armature)
        self.model = model
        self.data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self.data)  # the mass of all bodies is divided by where their centre is measured
        self.data.qpos[:7] = first[[0, 1, 2, 6, 3, 4, 5]]
        self.data.qpos[self.rows] = first[7:]
        mujoco.mj_forward(model, self.data)
        self.feet = [geom for geom in range(model.ngeom) if model.geom(geom).name.startswith("foot ")]
        self.floor = jump.stances[-1].ground  # on which it is to stand
        self.quaternions = [self.data.qpos[3:7].copy()]
        self.measured: list[tuple[Array, Array]] = []
        self.com: list[tuple[Array, Array]] = []
        self.pressed: list[bool] = []

    def measure(self, rng: np.random.Generator) -> None:
        """Note what sensors say now: (7 + J,) and (6 + J,) numbers, the centre of mass, and whether a foot presses."""
        data = self.data
        quaternion = data.qpos[3:7].copy()
        quaternion *= np.sign(quaternion @ self.quaternions[-1])
        self.quaternions.append(quaternion)
        turned = np.zeros(4)
        mujoco.mju_mulQuat(turned, quaternion, np.concatenate(([1.0], NOISE / 2 * rng.standard_normal(3))))
        count = len(self.names)
        q = np.concatenate((data.qpos[:3], turned / np.linalg.norm(turned), data.qpos[self.rows]))
        q[7:] += NOISE * rng.standard_normal(count)
        v = np.concatenate((data.qvel[:6], data.qvel[self.columns]))
        v[3:] += 10 * NOISE * rng.standard_normal(3 + count)
        self.measured.append((q, v))
        # MuJoCo's step leaves places and rates of the bodies where they were before it.
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_comVel(self.model, data)
        mujoco.mj_subtreeVel(self.model, data)
        self.com.append((data.subtree_com[0].copy(), data.subtree_linvel[0].copy()))
        self.pressed.append(any(geom in self.feet for geom, force in self._forces() if force > 1.0))

    def move(self, torques: Array) -> None:
        """Hold torques (J,), N m, for a period."""
        self.data.qfrc_applied[self.columns] = torques
        mujoco.mj_step(self.model, self.data, nstep=STEPS)

    def touching(self) -> set[str]:
        """Names of the geoms that touch the floor."""
        return {self.model.geom(geom).name for geom, _ in self._forces()}

    def _forces(self) -> Iterator[tuple[int, float]]:
        """Geoms on the floor, and the normal forces on them, N."""
        force = np.zeros(6)
        for index, geoms in enumerate(self.data.contact.geom.tolist()):
            mujoco.mj_contactForce(self.model, self.data, index, force)
            yield max(geoms), float(force[0])  # the floor is the first geom, higher ground the second

    def stands(self, planned: Array) -> bool:
        """Whether the base is as high as planned but for 40 %, level, and turned as often: of ``planned`` (7 + J,)."""
        base = self.data.qpos
        level = _up(base[3:7]) @ _up(planned[[6, 3, 4, 5]]) > np.cos(0.5)
        high = base[2] - self.floor > 0.6 * (planned[2] - self.floor)
        turned = self.quaternions[-1] @ planned[[6, 3, 4, 5]] > np.cos(np.pi / 4)  # half of the angle
        return bool(level and high and turned)


class Control:
    """Torques of a jump with feedback, and corrections in flight where there is a replanner."""

    def __init__(self, jump: fp.Jump, world: World, gains: Array, replanner: fp.Replanner | None) -> None:
        assert jump.flight is not None
        self.jump = jump
        self.world = world
        self.gains = gains
        self.replanner = replanner
        if replanner is not None:
            replanner.reset()
        times = np.arange(0.0, jump.duration, STEPS * STEP)
        self.planned_q = jump.q(times)
        flips = np.sign(np.sum(self.planned_q[1:, 3:7] * self.planned_q[:-1, 3:7], axis=1))
        self.planned_q[1:, 3:7] *= np.cumprod(flips)[:, None]
        self.planned_v = jump.v(times)
        self.planned_tau = jump.tau(times)[:, 6:]
        self.takeoff = jump.takeoff_time
        robot = jump.problem.robot
        self.motors = [world.names.index(name) for name in robot.motors]
        self.planned_joints = [world.names.index(name) for name in robot.joints]
        effort = world.model.jnt_actfrcrange[[world.model.joint(name).id for name in world.names]]
        self.least, self.most = effort.T
        self.goal = self.planned_q[min(round(self.planned_landing / (STEPS * STEP)), len(times) - 1), [6, 3, 4, 5]]
        self.errors: list[Array] = []

    @property
    def planned_landing(self) -> float:
        """When the plan's flight ends, s."""
        assert self.jump.flight is not None
        return self.takeoff + self.jump.flight.duration

    @property
    def landing(self) -> float:
        """When the flight should end, s."""
        return self.planned_landing if self.replanner is None else self.takeoff + self.replanner.landing

    def torques(self, tick: int) -> Array:
        """Torques (J,), N m, of a period."""
        now = tick * STEPS * STEP
        in_flight = self.takeoff <= now < self.landing
        early = 0 if now < self.takeoff else round((self.planned_landing - self.landing) / (STEPS * STEP))
        row = min(tick + early, len(self.planned_q) - 1)
        positions = self.planned_q[row, 7:].copy()
        rates = self.planned_v[row, 6:].copy()
        torques = self.planned_tau[row].copy()
        if in_flight and self.replanner is not None:
            self._correct(tick, now)
            reference = self.replanner.reference(now - self.takeoff)
            ratios = self.jump.problem.robot.motor_ratios
            positions[self.motors] = ratios @ reference.positions
            rates[self.motors] = ratios @ reference.velocities
            torques[self.motors] = reference.motors
        q, v = self.world.measured[-1]
        self.errors.append(np.stack((positions - q[7:], rates - v[6:])))
        if tick >= LATE:
            torques += (self.gains[self._phase(row, in_flight, now)] * self.errors[tick - LATE]).sum(axis=0)
        return np.asarray(np.clip(torques, self.least, self.most))

    def _phase(self, row: int, in_flight: bool, now: float) -> int:
        """Number of the phase in which the robot should be."""
        flight = [phase.kind for phase in self.jump.phases].index("flight")
        if in_flight:
            return flight
        begins = [phase.begin for phase in self.jump.phases]
        planned = int(np.searchsorted(begins, row * STEPS * STEP, side="right")) - 1
        return min(planned, flight - 1) if now < self.takeoff else max(planned, flight + 1)

    def _correct(self, tick: int, now: float) -> None:
        """Hand the replanner what was measured, where it was measured in the air."""
        assert self.replanner is not None
        late = tick - LATE
        measured_at = late * STEPS * STEP - self.takeoff
        if tick % 2 or measured_at < 0 or self.world.pressed[late]:
            return
        q, v = self.world.measured[late]
        joints = self.planned_joints
        com, com_velocity = self.world.com[late]
        self.replanner.update(
            measured_at, q[[4, 5, 6, 3]], v[3:6], q[7:][joints], v[6:][joints], now - self.takeoff, com, com_velocity
        )


def spec_of(jump: fp.Jump, friction: float) -> mujoco.MjSpec:
    """Return the URDF as MuJoCo reads it on a free base, with a floor, feet as spheres, and links as capsules."""
    robot = jump.problem.robot
    urdf = ElementTree.fromstring(robot.xml)
    for link in urdf.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    compiler = {"fusestatic": "false", "balanceinertia": "true", "boundmass": "1e-6", "boundinertia": "1e-9"}
    ElementTree.SubElement(ElementTree.SubElement(urdf, "mujoco"), "compiler", compiler)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(urdf, encoding="unicode"))
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4  # with others momenta change by 1 % in a flight
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10  # at MuJoCo's own 1, feet creep while they push
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET  # what is unstable has fallen, and stays so
    root = spec.worldbody.first_body()
    root.add_freejoint()
    touching = {"friction": [friction, 0, 0], "solref": list(CONTACT)}
    kinds = mujoco.mjtGeom
    spec.worldbody.add_geom(name="floor", type=kinds.mjGEOM_PLANE, size=[0, 0, 1], pos=[0, 0, jump.ground], **touching)
    if jump.step is not None:
        _add_higher_ground(spec, jump, touching)
    height = float(jump.q(np.zeros(1))[0, 2] - jump.stances[0].ground)
    soles = set()
    for foot in {foot.name: foot for foot in jump.contacts}.values():
        radius = max(foot.depth, 5e-3)  # m; a sole's points are corners
        body = spec.joint(robot.model.names[foot.body]).parent
        if foot.suffix:
            soles.add(body.name)
        centre = np.add(foot.local, [0, 0, radius - foot.depth])
        body.add_geom(
            name=f"foot {foot.name}", type=kinds.mjGEOM_SPHERE, size=[radius, 0, 0], pos=centre, contype=0, **touching
        )
    for body in spec.bodies[1:]:
        of_trunk = body == root
        radius = (0.15 if of_trunk else 0.04) * height
        for child in body.bodies:
            end = np.array(child.pos)
            if np.linalg.norm(end) < 2 * radius:
                continue
            if body.name in soles:
                continue  # its points are its shape; a capsule to a frame on its sole would reach below it
            reach = 1.0 if child.bodies or of_trunk else 0.8  # a last link ends at a foot, which has its own geom
            body.add_geom(
                name=f"link {body.name} {child.name}",
                type=kinds.mjGEOM_CAPSULE,
                size=[radius, 0, 0],
                fromto=[0, 0, 0, *(reach * end)],
                contype=0,
                **touching,
            )
    return spec


def _add_higher_ground(spec: mujoco.MjSpec, jump: fp.Jump, touching: dict[str, list[float]]) -> None:
    """Add a box of 4 m with an edge where the higher ground ends."""
    step = jump.step
    assert step is not None
    assert step.across is not None
    middle = np.zeros(3)
    middle[step.axis] = step.edge + 2.0 * step.inwards
    middle[1 - step.axis] = step.across
    middle[2] = (step.low + step.high) / 2
    size = [2.0, 2.0, (step.high - step.low) / 2]
    spec.worldbody.add_geom(name="higher", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=middle, **touching)


def angle(quaternion: Array, other: Array) -> float:
    """Angle between two attitudes, rad, of quaternions w, x, y, z."""
    return float(2 * np.arccos(np.clip(np.abs(quaternion @ other), 0.0, 1.0)))


def _up(quaternion: Array) -> Array:
    """The world's vertical (3,) in the axes of a base, of a quaternion w, x, y, z."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return np.asarray(matrix.reshape(3, 3)[2])
