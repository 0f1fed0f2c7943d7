"""Forward dynamics: torques of a flight, accelerations by Pinocchio or MuJoCo, and their integration.

Open loop, a replay with Pinocchio is integrated far more finely than anything it checks. MuJoCo, flights in space and
control loops, whose torques are held for a period, take the fixed steps of the classical Runge-Kutta method.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import count
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import pinocchio as pin

from floatplan.arguments import by_name, number, one_of
from floatplan.arrays import Array, IntArray, read_only
from floatplan.errors import FloatplanError, InputError
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.planar.model import BASE_COORDINATES, FREE_FLYER
from floatplan.robot.robot import Robot
from floatplan.simulation.mujoco_model import SpatialModel, planar_model
from floatplan.simulation.perturbation import Drawn
from floatplan.simulation.recorded_motion import RecordedMotion, ReducedModel
from floatplan.stance.jump_motion import JumpMotion
from floatplan.tables import Range

Engine: TypeAlias = Literal["pinocchio", "mujoco"]
State: TypeAlias = tuple[Array, Array]  # positions, velocities
Accelerations: TypeAlias = Callable[[Array, Array, Array], Array]  # positions, velocities, forces -> accelerations
Dynamics: TypeAlias = Callable[[float, Array, Array], Array]  # time, positions, velocities -> accelerations
Moved: TypeAlias = Callable[[Array, Array, float], Array]  # positions, velocities, duration -> positions
Entries: TypeAlias = IntArray | slice

GAIN = number(Range(0.0, 1e12, ""))
Gain: TypeAlias = float | Mapping[str, float]  # of all joints, or of some by name
Gains: TypeAlias = tuple[Gain | None, Gain | None]  # stiffness, damping

FASTEST = 1e4  # [rad/s] bandwidth of feedback
BANDWIDTH = 100.0  # [rad/s] of a controller's feedback, where none is said
STIFFEST = 125.0  # [rad/s] of a jump's feedback, over what is measured 4 ms late and held for 2 ms: 0.6 over the delay
LEAD = 0.017  # [s] its damping over its stiffness: nearly critical
INSTANTS = 33  # [-] of a flight
TIGHT = 1e-12  # [-] per step; open loop, errors grow with the motion: 10-fold in a flight, 1e12-fold with 20 links
LOOSE = 1e-8  # [-] where what is flown was perturbed by far more
MOST_EVALUATIONS = 40_000  # [-] of the dynamics; flights of real robots take up to 2000
MOST_STEPS = 100_000  # [-] of a flight, where steps are fixed
JOINTS = slice(BASE_COORDINATES, None)  # entries of the reduced model's coordinates that are joints


def check_engine(name: str) -> Engine:
    """Return the engine of that name; InputError where there is none."""
    engine: Engine = one_of(*get_args(Engine))(name, "engine")
    return engine


def critical_gains(bandwidth: float, inertia: Array) -> Array:
    """Return critically damped stiffness and damping (2, m) for a bandwidth, rad/s, and joints' inertia (m,), kg m^2.

    They pull the joints to their paths by torques ``stiffness (q_d - q) + damping (q_d' - q')``, N m.
    """
    return read_only([bandwidth**2 * inertia, 2.0 * bandwidth * inertia])


def joint_inertia(model: Any, posture: Array) -> Array:
    """Return the inertia (m,), kg m^2, that each joint of a ``pinocchio.Model`` in the plane turns at a posture.

    It is ``1 / (M^-1)_jj``: what a torque on the joint alone feels while the robot floats.
    """
    inverse = pin.computeMinverse(model, model.createData(), np.asarray(posture))
    return np.asarray(1.0 / np.diagonal(inverse)[JOINTS if model.nq == model.nv else slice(FREE_FLYER, None)])


def given_gains(joints: Sequence[str], given: Gain | None, element: str, otherwise: Array) -> Array:
    """Return gains (J,) as given, else as they are otherwise; InputError where one is wrong."""
    if given is None:
        return otherwise
    if not isinstance(given, Mapping):
        return np.full(len(joints), GAIN(given, element))
    gains = otherwise.copy()
    for joint, gain in by_name(GAIN)(given, element).items():
        if joint not in joints:
            raise InputError(f"the robot has no such joint that moves: {joint}", element=element)
        gains[joints.index(joint)] = gain
    return gains


def first_gains(jump: JumpMotion, given: Gains = (None, None)) -> Array:
    """Stiffness, N m/rad, and damping, N m s/rad, (2, J) of all joints that move, as given.

    What is left out is the same of all: what gives the lightest joint in flight the bandwidth ``STIFFEST``, but at
    least the weight times its height where the robot stands, which it falls over without; and ``LEAD`` times that. The
    lightest bounds them all, for damping of more than its inertia over the delay rings. InputError where one that is
    given is wrong.
    """
    robot, begin = jump.problem.robot, jump.at(0.0).positions[0]
    com = pin.centerOfMass(robot.model, robot.model.createData(), begin) @ robot.plane.vertical
    standing = robot.mass * jump.problem.flight.gravity * float(com - jump.ground)
    model, joints = robot.model, tuple(robot.model.names)[BASE_COORDINATES + 1 :]
    takeoff, landing = next((phase.begin, phase.end) for phase in jump.phases if phase.kind == "flight")
    postures = jump.at(np.linspace(takeoff, landing, INSTANTS)).positions
    lightest = float(np.mean([joint_inertia(model, posture).min() for posture in postures]))
    usual = float(f"{max(STIFFEST**2 * lightest, standing):.2g}")
    rows = zip(given, ("kp", "kd"), (usual, LEAD * usual), strict=True)
    return np.array([given_gains(joints, each, name, np.full(len(joints), gain)) for each, name, gain in rows])


class JointTorques:
    """Torques (m,) by time, s, and the joints' positions and velocities (m,): the plan's, and feedback's.

    ``factors`` (m,) say how strong each motor is; without gains (2, m) of feedback the torques are open loop. Motors
    make up for what joints that move as planned lose by damping and friction; what joints lose is taken off.
    """

    def __init__(self, motion: RecordedMotion, factors: Array, gains: Array | None) -> None:
        self.factors, self.gains, self.lost = factors, gains, motion.reduced.lost
        self.of_joints = motion.reduced.of_joints
        self.loses = bool(motion.reduced.losses.any())
        # a Runge-Kutta method evaluates some instants twice
        self._planned = lru_cache(maxsize=4)(motion.torques)
        self._target = lru_cache(maxsize=4)(motion.joints)

    def __call__(self, time: float, positions: Array, velocities: Array) -> Array:
        """Torques (m,), N m."""
        torques = self._planned(time)
        if self.loses:
            torques = torques + self.lost(self._target(time).velocities[self.of_joints[1]])
        if self.gains is not None:
            target = self._target(time)
            torques = torques + (
                self.gains[0] * (target.positions[self.of_joints[0]] - positions)
                + self.gains[1] * (target.velocities[self.of_joints[1]] - velocities)
            )
        return np.asarray(self.factors * torques - self.lost(velocities) if self.loses else self.factors * torques)

    def applied(
        self, to: Accelerations, positions: Entries | None = None, velocities: Entries | None = None
    ) -> Dynamics:
        """Return the dynamics under these torques; the entries are of the joints, left out the reduced model's."""
        positions = self.of_joints[0] if positions is None else positions
        velocities = self.of_joints[1] if velocities is None else velocities

        def dynamics(time: float, q: Array, v: Array) -> Array:
            forces = np.zeros_like(v)
            forces[velocities] = self(time, q[positions], v[velocities])
            return to(q, v, forces)

        return dynamics


def accelerations_of(
    engine: Engine, robot: Robot, reduced: ReducedModel, drawn: Drawn, free: SpatialModel | None = None
) -> Accelerations:
    """Accelerations of a perturbed robot by an engine, in space where it is ``free``; errors as of ``planar_model``."""
    if free is not None:
        return free_accelerations(free)
    if engine == "pinocchio":
        return pinocchio_accelerations(drawn.perturbed(reduced.model))
    return mujoco_accelerations(*planar_model(robot, reduced, drawn.mass, drawn.inertia))


def pinocchio_accelerations(model: Any) -> Accelerations:
    """Accelerations by the articulated-body algorithm of a ``pinocchio.Model`` with gravity."""
    data = model.createData()
    return lambda q, v, forces: pin.aba(model, data, q, v, forces).copy()


def mujoco_accelerations(model: Any, entries: Entries = slice(None)) -> Accelerations:
    """Accelerations by MuJoCo; ``entries`` are its coordinates of each of the robot's, in the plane.

    MuJoCo's own integrator takes torques from a callback that is one for all threads of the process.
    """
    mujoco = import_mujoco()
    data = mujoco.MjData(model)

    def accelerations(q: Array, v: Array, forces: Array) -> Array:
        data.qpos[entries], data.qvel[entries], data.qfrc_applied[entries] = q, v, forces
        mujoco.mj_forward(model, data)
        return np.array(data.qacc[entries])

    return accelerations


def free_accelerations(free: SpatialModel) -> Accelerations:
    """Accelerations by MuJoCo of a robot on a free joint, in Pinocchio's coordinates: the base's are its own axes."""
    mujoco = import_mujoco()
    data = mujoco.MjData(free.model)
    place, turn = (
        slice(free.base_position, free.base_position + 3),
        slice(free.base_position + 3, free.base_position + 7),
    )
    linear, angular = (
        slice(free.base_velocity, free.base_velocity + 3),
        slice(free.base_velocity + 3, free.base_velocity + 6),
    )

    def accelerations(q: Array, v: Array, forces: Array) -> Array:
        quaternion = q[3:7] / np.linalg.norm(q[3:7])
        rotation = pin.Quaternion(quaternion).matrix()
        data.qpos[place], data.qpos[turn], data.qpos[free.positions] = q[:3], np.roll(quaternion, 1), q[7:]
        data.qvel[linear], data.qvel[angular], data.qvel[free.velocities] = rotation @ v[:3], v[3:6], v[6:]
        data.qfrc_applied[free.velocities] = forces[6:]
        mujoco.mj_forward(free.model, data)
        of_base = rotation.T @ data.qacc[linear] - np.cross(v[3:6], v[:3])
        return np.concatenate((of_base, data.qacc[angular], data.qacc[free.velocities]))

    return accelerations


def fly_finely(
    dynamics: Dynamics,
    takeoff: State,
    times: Array,
    tolerance: float = TIGHT,
    moved_at: Callable[[Array, Array], Array] = lambda positions, velocities: velocities,
) -> tuple[Array, Array]:
    """Integrate by a Runge-Kutta method of order 8 and return positions and velocities at times, (N, 3 + m) each.

    Parameters
    ----------
    dynamics : callable
    takeoff : positions, velocities (3 + m,) at time zero
    times : (N,) s, rising; the last is the end
    tolerance : float
        Of a step's error, relative; a tenth of it absolute, in m, rad, m/s, rad/s.
    moved_at : derivatives of positions by time; velocities, unless the base turns in space

    Raises
    ------
    FloatplanError
        The motion cannot be integrated to its end, or not within ``MOST_EVALUATIONS``.
    """
    from scipy.integrate import solve_ivp  # here, because what reads gains alone does without

    evaluations, size = count(), len(takeoff[0])

    def rate(time: float, state: Array) -> Array:
        if next(evaluations) == MOST_EVALUATIONS or not np.isfinite(state).all():
            raise FloatplanError(
                f"the replay was stopped {time:.3g} s after takeoff: motion or feedback is too fast to be integrated"
            )
        positions, velocities = state[:size], state[size:]
        return np.concatenate((moved_at(positions, velocities), dynamics(time, positions, velocities)))

    flown = solve_ivp(
        rate,
        (0.0, float(times[-1])),
        np.concatenate(takeoff),
        method="DOP853",
        t_eval=times,
        rtol=tolerance,
        atol=0.1 * tolerance,
    )
    if flown.status != 0:
        raise FloatplanError(f"the replay stopped before the end of the flight: {flown.message}")
    return flown.y.T[:, :size], flown.y.T[:, size:]


def _straight(positions: Array, velocities: Array, duration: float) -> Array:
    return np.asarray(positions + duration * velocities)


def fly_in_steps(
    dynamics: Dynamics, takeoff: State, times: Array, step: float, moved: Moved = _straight
) -> tuple[Array, Array]:
    """Integrate at fixed steps, which divide all ``times``; as :func:`fly_finely`, ``moved`` as of a step."""
    state, done, flown = takeoff, 0, []
    for steps in np.rint(times / step).astype(int).tolist():
        for each in range(done, steps):
            state = runge_kutta_step(dynamics, state, each * step, (each + 1) * step, moved)
        done = steps
        flown.append(state)
    positions, velocities = zip(*flown, strict=True)
    return np.array(positions), np.array(velocities)


def whole_step(duration: float, step: float, panels: int) -> float:
    """Return the longest step up to ``step`` that divides each of ``panels`` equal parts of a duration, s."""
    return duration / (panels * max(1, math.ceil(duration / (panels * step) - 1e-9)))


def runge_kutta_step(dynamics: Dynamics, state: State, begin: float, end: float, moved: Moved = _straight) -> State:
    """One step of the classical Runge-Kutta method; the next one begins at the very time at which this one ends.

    Parameters
    ----------
    dynamics : accelerations of a time, s, positions and velocities
    state : positions, velocities
    begin, end : s
    moved : positions after a duration at given velocities: along the geodesic where the base turns in space
    """
    q, v = state
    duration = end - begin
    half, middle = duration / 2, begin + duration / 2
    a1 = dynamics(begin, q, v)
    v2 = v + half * a1
    a2 = dynamics(middle, moved(q, v, half), v2)
    v3 = v + half * a2
    a3 = dynamics(middle, moved(q, v2, half), v3)
    v4 = v + duration * a3
    a4 = dynamics(end, moved(q, v3, duration), v4)
    return moved(q, (v + 2 * (v2 + v3) + v4) / 6, duration), v + duration / 6 * (a1 + 2 * (a2 + a3) + a4)
