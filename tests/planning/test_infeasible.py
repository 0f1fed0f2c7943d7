"""Problems without a plan end soon and say which requirement cannot be met, by how much and when; and that is so."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from forward_problems import GRADES, forward_problem
from independent import Look, violations_seen
from long_cases import cases
from places import PROBLEMS

import floatplan as fp
from floatplan.kernel.tolerances import EXCHANGE
from floatplan.motion.planar.bounds import impossibilities
from floatplan.motion.planar.closed_form import Dynamics
from floatplan.planning.search import DEFAULT_WORK

WORK = DEFAULT_WORK / 20  # of the searches here
NEAREST = re.compile(r"In the nearest motion found, (.+?) is violated by (\S+) (.+?) at t = ([\d.]+) s")
AT_AN_END = re.compile(r"At (takeoff|landing) the (start|goal) itself is impossible: (.+?) is violated by (\S+) (\S+)")


@cache
def problem_of(name):
    return fp.load_problem(PROBLEMS / f"{name}.toml")


def with_obstacle(name, obstacle):
    return replace(problem_of(name), obstacles=(obstacle,))


def with_limits(name, **limits):
    return replace(problem_of(name), limits=fp.Limits(position="full", **limits))


def with_momentum(problem, momentum):
    return replace(problem, flight=replace(problem.flight, angular_momentum=momentum))


def com(name, share):
    """Place of the centre of mass at a share of the flight."""
    duration = problem_of(name).flight.duration
    (place,) = problem_of(name).path.positions(np.array([share * duration]))
    return float(place[0]), float(place[1])


def moved_to(place, velocity, time):
    """Where what is at a place at a time was at takeoff."""
    return place[0] - velocity[0] * time, place[1] - velocity[1] * time


def accelerated(name, end, acceleration):
    problem = problem_of(name)
    return replace(problem, **{end: replace(getattr(problem, end), accelerations=acceleration)})


@dataclass(frozen=True)
class Case:
    """A problem, what its explanation must say, and whether no search is needed to know it."""

    make: Callable[[], fp.Problem]
    says: str
    provable: bool = True


A, B = "new_configuration", "handstand"
SHIN = (0.06, 0.19)  # on the first link of example B at takeoff, m
A_PEAKS = np.array([2.3107, 1.2570])  # N m, of the plan without limits

COVERED = {
    "a pole in the shin": lambda: with_obstacle(B, fp.Circle(center=SHIN, radius=0.05)),
    "ground above the foot": lambda: with_obstacle(B, fp.HalfPlane(point=(0.0, 0.1), window=(0.0, 0.3))),
    "a ball that leaves at once": lambda: with_obstacle(B, fp.Circle(center=SHIN, radius=0.1, velocity=(-8.0, 0.0))),
    "a pole for a moment": lambda: with_obstacle(B, fp.Circle(center=SHIN, radius=0.05, window=(0.0, 0.01))),
}
OCCUPIED = {
    "a pole where it arrives": lambda: with_obstacle(A, fp.Circle(center=com(A, 1), radius=0.3, window=(0.9, 1.1))),
    "a bar across the handstand": lambda: with_obstacle(
        B, fp.Bar(start=(com(B, 1)[0] - 0.3, 0.5), end=(com(B, 1)[0] + 0.3, 0.5), radius=0.01)
    ),
    "a ball that comes in time": lambda: with_obstacle(
        B, fp.Circle(center=moved_to(com(B, 1), (-3.0, 1.0), 1.4), radius=0.1, velocity=(-3.0, 1.0))
    ),
}
IN_THE_WAY = {
    "a rock around the path": lambda: with_obstacle(B, fp.Circle(center=com(B, 0.5), radius=0.9)),
    "a rock that flies through": lambda: with_obstacle(
        B, fp.Circle(center=moved_to(com(B, 0.5), (4.0, 4.0), 0.7), radius=0.8, margin=0.1, velocity=(4.0, 4.0))
    ),
    "a flood in mid-flight": lambda: with_obstacle(B, fp.HalfPlane(point=(0.0, 4.0), window=(0.6, 0.8))),
    "a wall": lambda: with_obstacle(B, fp.Bar(start=(1.5, 0.0), end=(1.5, 6.0), radius=0.02)),
    "a wall that flies along": lambda: with_obstacle(
        B, fp.Bar(start=(2.2, 0.0), end=(2.2, 7.0), radius=0.02, velocity=(-1.0, 0.0))
    ),
}
CANNOT_TURN = {
    "much momentum": lambda: with_momentum(with_limits(B, velocity=10.0), 40.0),
    "a cat too slow": lambda: replace(problem_of("falling_cat"), limits=fp.Limits(position="full", velocity=0.2)),
}
CASES = {
    **{name: Case(make, r"covers the start posture") for name, make in COVERED.items()},
    **{name: Case(make, r"covers the goal posture") for name, make in OCCUPIED.items()},
    **{name: Case(make, r"Obstacle 0 .* cannot be passed whatever the posture") for name, make in IN_THE_WAY.items()},
    "velocity of q1": Case(lambda: with_limits(A, velocity={"q1": 2.8}), r"Joint q1 moves .* velocity limit"),
    "a somersault": Case(
        lambda: with_limits("somersault", orientation_rate=7.1), r"The orientation changes .* orientation rate limit"
    ),
    **{name: Case(make, r"Under the velocity limits the orientation changes") for name, make in CANNOT_TURN.items()},
    "links apart that are joined by one": Case(
        lambda: replace(problem_of(B), self_clearances=(fp.SelfClearance(("body0", "body2"), 0.41),)),
        r"At landing the goal itself is impossible: clearance of body0 to body2",
    ),
    "a jerk at takeoff": Case(
        lambda: replace(accelerated(A, "start", 30.0), limits=fp.Limits(position="full", torque=1.0)),
        r"At takeoff the start itself is impossible: torque of q1",
    ),
    "a jerk at landing": Case(
        lambda: replace(
            accelerated(A, "goal", {"q2": 60.0}),
            limits=fp.Limits(position="full", motor={"q2": fp.Motor(stall=1.0, slope=0.1)}),
        ),
        r"At landing the goal itself is impossible: speed-dependent torque of q2",
    ),
    "faster at takeoff than allowed": Case(
        lambda: replace(
            problem_of("new_configuration_moving"), limits=fp.Limits(position="full", velocity={"q2": 0.06})
        ),
        r"At takeoff the start itself is impossible: velocity of q2",
    ),
    "a tenth of the torque": Case(
        lambda: with_limits(A, torque=0.1 * A_PEAKS), r"torque of q[12] is violated", provable=False
    ),
    "motors of a tenth": Case(
        lambda: with_limits(A, motor={"q1": fp.Motor(0.23, 0.01), "q2": fp.Motor(0.12, 0.01)}),
        r"speed-dependent torque of q[12] is violated",
        provable=False,
    ),
    "momentum far outside": Case(
        lambda: with_momentum(problem_of(B), 40.0),
        r"40 kg m\^2/s lies outside the interval of motions that do not turn back",
        provable=False,
    ),
}


def seen(plan, label, instant):
    """By how much a requirement is violated at an instant, by code that is not the planner's."""
    look = Look(plan, np.array(sorted({0.0, instant, plan.duration})))
    return max(worst.amount for worst in violations_seen(look) if label.startswith(worst.label))


def as_seen(problem, amount):
    """The amount as far as that code can see it: to it, a line that crosses another is at distance 0."""
    bars = [obstacle.margin + obstacle.radius for obstacle in problem.obstacles if isinstance(obstacle, fp.Bar)]
    return min([amount, *bars])


@pytest.mark.usefixtures("little_work")
@pytest.mark.parametrize("name", CASES)
def test_ends_soon_with_a_true_explanation(name):
    case = CASES[name]
    problem = case.make()
    plan = fp.plan(problem)
    assert plan.solver["evaluations"] < WORK / EXCHANGE.evaluation
    assert not plan.ok
    assert plan.status == "infeasible"
    assert re.search(case.says, plan.explanation), plan.explanation
    assert not case.provable or plan.solver["starts"] <= 2
    assert np.isfinite(plan.coefficients).all()
    fixed = not case.provable and plan.coefficients.shape[1] > 6
    assert ('"auto"' in plan.explanation) == (fixed and not problem.raises_degree)
    assert ('"free"' in plan.explanation) == (fixed and problem.flight.angular_momentum != "free")
    nearest = NEAREST.search(plan.explanation)
    if nearest:
        label, amount, _, instant = nearest.groups()
        assert seen(plan, label, float(instant)) == pytest.approx(as_seen(problem, float(amount)), rel=2e-3, abs=1e-5)
    for verb, end, label, amount, _ in AT_AN_END.findall(plan.explanation):
        assert (verb, end) in (("takeoff", "start"), ("landing", "goal"))
        instant = 0.0 if end == "start" else plan.duration
        if end == "start" or plan.final_orientation == pytest.approx(problem.final.orientation, abs=1e-6):
            assert seen(plan, label, instant) >= as_seen(problem, float(amount)) * (1 - 1e-3)


class TestNumbersInReasons:
    """The amounts that are given are those of the problem."""

    def reasons(self, problem):
        return " ".join(impossibilities(problem))

    def test_mean_velocity(self):
        problem = with_limits(A, velocity={"q1": 2.8})
        mean = math.radians(70 + 108.97) / 1.1
        assert f"needs {mean:.4g} rad/s" in self.reasons(problem)
        assert not self.reasons(with_limits(A, velocity={"q1": mean}))

    def test_turning_bounds_hold_for_every_motion(self):
        """Motions within velocity limits turn by no more than the bound that is given."""
        rng = np.random.default_rng(5)
        problem = with_momentum(with_limits(B, velocity=10.0), 40.0)
        least, most = map(float, re.search(r"changes by (\S+) to (\S+) rad", self.reasons(problem)).groups())
        dynamics = Dynamics(problem.robot.tree)
        positions = rng.uniform(-np.pi, np.pi, (20_000, 2))
        rates = dynamics.base_rate(positions, rng.uniform(-10, 10, (20_000, 2)), 40.0)
        assert least < 1.4 * rates.min()
        assert 1.4 * rates.max() < most

    def test_rock_that_can_just_be_passed_is_no_reason(self):
        depth = re.search(r"is (\S+) m inside it", self.reasons(CASES["a rock around the path"].make())).group(1)
        reach = re.search(r"further than (\S+) m", self.reasons(CASES["a rock around the path"].make())).group(1)
        assert float(depth) == pytest.approx(0.9, abs=0.01)
        smaller = with_obstacle(B, fp.Circle(center=com(B, 0.5), radius=float(reach) - 0.01))
        assert not self.reasons(smaller)

    @pytest.mark.parametrize("grade", cases(GRADES, {"medium"}))
    def test_none_is_given_for_what_has_a_solution(self, grade):
        problems = [problem for seed in range(300, 312) if (problem := forward_problem(seed, grade))]
        assert len(problems) > 2
        for problem in problems:
            assert not self.reasons(problem)


@pytest.mark.usefixtures("little_work")
@pytest.mark.parametrize(
    ("kind", "short"),
    [
        ("torque", (2e-5, 1e-5)),
        pytest.param("velocity", (3e-6, 4e-5), marks=pytest.mark.long),
        pytest.param("acceleration", (0.0, 2e-5), marks=pytest.mark.long),
    ],
)
def test_what_would_make_a_plan_names_every_limit_that_is_exceeded(kind, short):
    """Next to no other motion reaches the goal; with what is said added to the limits, it exceeds none of them."""
    problem = replace(problem_of("handstand"), motion=fp.Motion(degree=(6, 5)))
    free = fp.plan(problem)
    state = free.at(np.linspace(0.0, free.duration, 10001))
    quantity = {"torque": "motor_torques", "velocity": "velocities", "acceleration": "accelerations"}[kind]
    peaks = np.abs(getattr(state, quantity)).max(axis=0)
    limits = dict(zip(problem.robot.joints, (peaks * (1 - np.array(short))).tolist(), strict=True))
    plan = fp.plan(replace(problem, limits=replace(problem.limits, **{kind: limits})))
    assert not plan.ok
    said = re.findall(rf"the limit on the {kind} of (\w+) (\S+) ", plan.explanation)
    assert said, plan.explanation
    for joint, amount in said:
        limits[joint] += float(amount)
    reached = np.abs(getattr(plan.at(np.linspace(0.0, plan.duration, 10001)), quantity)).max(axis=0)
    assert (reached <= np.array(list(limits.values())) * (1 + 1e-9)).all(), plan.explanation


@pytest.mark.usefixtures("little_work")
def test_the_goal_that_only_touches_a_limit_is_reached():
    """No room to aim inside: the only motion there is just meets its torque limits."""
    problem = replace(problem_of("handstand"), motion=fp.Motion(degree=(6, 5)))
    peaks = fp.plan(problem).peaks.torque
    plan = fp.plan(replace(problem, limits=replace(problem.limits, torque=peaks)))
    assert plan.ok, plan.explanation
    assert plan.status == "optimal"
    assert fp.certify(plan).proved
