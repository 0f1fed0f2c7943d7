"""The objective "robust" of flights in space: errors at takeoff grow less until landing, and what it says is true."""

import json
from dataclasses import replace

import numpy as np
import pytest
import space_reference
from long_cases import cases
from once import made_once
from places import PROBLEMS, SPACE
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.motion.spatial.attitude import WEIGHT_OF_GROWTH
from floatplan.motion.spatial.rotations import exponential
from floatplan.planning.in_space import SpatialSearch, degrees_tried
from floatplan.planning.lifting import LIFTING, LiftedFlight, close, descend, nearby, refined, starts
from floatplan.planning.options import SearchOptions
from floatplan.planning.robust import RobustCost
from floatplan.planning.spec import spec_of
from floatplan.planning.variables import decision_variables

NAMES = ("diver_half_twist", "go2_half_twist")


def problem_of(name, objective):
    problem = fp.load_problem(SPACE / f"{name}.toml")
    return problem.with_parts(motion=replace(problem.motion, objective=objective))


@pytest.fixture(scope="module")
def plan_of(planned):
    def plan_of(name, objective):
        if objective == "coefficients":
            return planned(f"space/{name}")  # which others look at too
        return made_once(f"{objective} of {name}", lambda: fp.plan(problem_of(name, objective), prove=True))

    return plan_of


def landing(record):
    """The attitude at landing by DOP853."""
    return space_reference.flown(record, [0.0, record.duration], with_torques=False).attitudes[-1]


def turn_between(before, after):
    """The small turn (3,) of the world, rad."""
    return Rotation.from_matrix(after @ before.T).as_rotvec()


def with_momentum(plan, factor):
    return replace(plan.record, angular_momentum=factor * np.array(plan.record.angular_momentum))


def size_of(growth):
    return float(np.sqrt(sum((part**2).sum() for part in growth)))


@pytest.mark.parametrize("name", cases(NAMES, NAMES[1:]))
def test_errors_at_takeoff_grow_less(plan_of, name):
    """P to a tenth of what it was, and two per cent of h to less than two thirds, for a motion hardly larger."""
    robust = plan_of(name, "robust")
    usual = plan_of(name, "coefficients")
    for plan in (robust, usual):
        assert plan.ok
        assert plan.certificate.proved
    of_robust = np.linalg.norm(robust.growth_of_errors[1])
    of_usual = np.linalg.norm(usual.growth_of_errors[1])
    assert of_robust < 0.1 * of_usual
    assert robust._size < usual._size + 0.2
    for factor in (0.98, 1.02):
        errors = [
            np.linalg.norm(turn_between(landing(plan.record), landing(with_momentum(plan, factor))))
            for plan in (robust, usual)
        ]
        assert errors[0] < 0.65 * errors[1]


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_what_is_optimal_cannot_be_made_smaller(plan_of, name):
    """However far a descent of the plan's motion goes, its value falls by less than a thousandth."""
    plan = plan_of(name, "robust")
    assert plan.status == "optimal"
    problem = problem_of(name, "robust")
    spec = spec_of(problem)
    searched = SpatialSearch(problem, SearchOptions())
    best = searched.run().best
    motion = close(nearby(LiftedFlight(spec, best.variables), best.x))
    assert RobustCost.of(motion).value == pytest.approx(plan.objective_value, rel=1e-6)
    further = descend(motion, RobustCost.of, replace(LIFTING, least_gain=1e-9, descent_steps=400, shortest_step=1e-7))
    assert RobustCost.of(further).value > plan.objective_value * (1 - 1e-3)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("objective", ["coefficients", "robust"])
def test_growth_is_that_of_differences(plan_of, name, objective):
    """K and P by DOP853, of central differences."""
    plan = plan_of(name, objective)
    by_size, by_attitude = plan.growth_of_errors
    small = 1e-5
    ends = [landing(with_momentum(plan, 1 + change)) for change in (-small, small)]
    assert turn_between(*ends) / (2 * small) == pytest.approx(by_size, abs=2e-6 * size_of([by_size, by_attitude]))
    start = Rotation.from_quat(plan.record.orientation["start"]["quaternion_xyzw"])
    for axis, column in enumerate(by_attitude.T):
        ends = []
        for change in (-small, small):
            turned = Rotation.from_rotvec(change * np.eye(3)[axis]) * start
            orientation = {**plan.record.orientation, "start": {"quaternion_xyzw": turned.as_quat()}}
            ends.append(landing(replace(plan.record, orientation=orientation)))
        assert turn_between(*ends) / (2 * small) == pytest.approx(column, abs=2e-6 * size_of([by_size, by_attitude]))


@pytest.mark.parametrize("name", cases(NAMES, NAMES[1:]))
def test_the_value_is_what_it_says(plan_of, name, tmp_path):
    plan = plan_of(name, "robust")
    growth = size_of(plan.growth_of_errors)
    assert plan.objective_value == pytest.approx(np.sqrt(plan._size**2 + WEIGHT_OF_GROWTH * growth**2), rel=1e-12)
    path = plan.save(tmp_path / "plan.json")
    assert fp.load_plan(path).objective_value == pytest.approx(plan.objective_value, rel=1e-12)
    content = json.loads(path.read_text())
    content["objective"]["value"] *= 1 + 1e-5
    path.write_text(json.dumps(content))
    with pytest.raises(fp.InputError, match=r"objective\.value"):
        fp.load_plan(path)


@pytest.fixture(scope="module", params=NAMES)
def lifted(request):
    """A closed motion on the search's own grid, made small."""
    problem = problem_of(request.param, "robust")
    spec = spec_of(problem)
    variables = decision_variables(problem, degrees_tried(problem, spec.flight)[0], None, spec.momentum)
    motion = close(next(starts(LiftedFlight(spec, variables), 0)))
    assert motion.is_closed()
    assert motion.makes_right_turns
    return descend(motion)


def test_the_kernel_s_growth_is_that_of_the_whole_motion(lifted):
    fine = refined(lifted)
    own = fine.lifted.turning(fine.cells, fine.x)
    slope = own.landing_by_momentum(np.eye(3))
    cost = RobustCost.of(fine)
    by_size = slope @ own.angular_momentum
    assert cost.growth[:3] == pytest.approx(np.sqrt(WEIGHT_OF_GROWTH) * by_size, abs=1e-7)
    # P without h turned back: of each cell in turn.
    through = np.eye(3)
    for transition in own.carried[0]:
        through = transition @ through
    assert cost.growth[3:].reshape(3, 3) == pytest.approx(np.sqrt(WEIGHT_OF_GROWTH) * through, abs=1e-7)


def test_a_small_motion_is_not_least(lifted):
    assert not RobustCost.of(lifted).is_least


def test_steps_go_downhill_as_far_as_they_promise(lifted):
    """A small step changes the cost as its derivative says, keeps the landing, and is within radius and box."""
    cost = RobustCost.of(lifted)
    free = lifted.lifted.variables.coefficients
    for radius in (1e-5, 1e-2, 1.0, np.inf):
        step = cost.downhill(radius)
        leaves_box = np.isclose(np.abs(lifted.x + step)[free:], 1.0, atol=1e-9).any()
        assert leaves_box or np.linalg.norm(step) <= radius * (1 + 1e-6)
        assert np.abs(lifted.turns[-1] @ step).max() < 1e-9 * np.abs(lifted.turns[-1]).max()
        assert np.abs((lifted.x + step)[free:]).max(initial=0.0) <= 1 + 1e-9
    step = cost.downhill(1e-5)
    turns = np.zeros_like(lifted.gaps)
    turns[1:] = lifted.turns[:-1] @ step
    costs = []
    for sign in (1, -1):
        borders = exponential(sign * turns) @ lifted.borders
        costs.append(RobustCost.of(lifted.lifted.fly(lifted.cells, lifted.x + sign * step, borders)).value ** 2 / 2)
    promised = (cost._growth_slope.T @ cost.growth) @ step + lifted.x[:free] @ step[:free]
    assert promised < 0
    assert (costs[0] - costs[1]) / 2 == pytest.approx(promised, rel=1e-3)


@pytest.mark.long
def test_obstacles_are_kept_clear_of(plan_of):
    """The motion that is least without them goes through the bar."""
    problem = problem_of("diver_past_a_bar", "robust")
    free = fp.plan(problem.with_parts(obstacles=()))
    assert free.clearances(np.linspace(0, free.duration, 1001), problem.obstacles).min() < 0
    plan = fp.plan(problem, prove=True)
    usual = plan_of("diver_past_a_bar", "coefficients")
    assert plan.ok
    assert plan.certificate.proved
    assert plan.status == "feasible"
    assert plan.peaks.clearance >= -1e-8
    assert np.linalg.norm(plan.growth_of_errors[1]) < 0.1 * np.linalg.norm(usual.growth_of_errors[1])
    assert free.objective_value < plan.objective_value < 1.1 * free.objective_value


@pytest.mark.long
@pytest.mark.parametrize(
    "limits",
    [pytest.param(fp.Limits(velocity=5.0), id="velocity"), pytest.param(fp.Limits(torque=30.0), id="torque")],
)
def test_limits_are_kept_and_the_value_is_less_than_that_of_a_small_motion(limits):
    usual = fp.plan(problem_of("diver_half_twist", "coefficients").with_parts(limits=limits))
    plan = fp.plan(problem_of("diver_half_twist", "robust").with_parts(limits=limits), prove=True)
    assert plan.ok
    assert plan.certificate.proved
    assert plan.objective_value < 0.3 * usual.whole.robust_size(usual._size)


@pytest.mark.long
def test_where_a_small_motion_is_best_it_is_the_plan(plan_of):
    """Without momentum nothing grows: then both objectives are the same but for a constant."""
    usual = plan_of("go2_levels", "coefficients")
    plan = fp.plan(problem_of("go2_levels", "robust"))
    assert plan.objective_value <= usual.whole.robust_size(usual._size) * (1 + 1e-9)


@pytest.mark.long
def test_several_starts_are_compared_by_the_true_value(plan_of):
    one = plan_of("diver_half_twist", "robust")
    several = fp.plan(problem_of("diver_half_twist", "robust"), starts=4)
    assert several.objective_value <= one.objective_value


def test_without_momentum_nothing_grows():
    plan = fp.plan(problem_of("cat", "robust"))
    assert plan.ok
    by_size, by_attitude = plan.growth_of_errors
    assert np.abs(by_size).max() == 0.0
    assert by_attitude == pytest.approx(np.eye(3), abs=1e-15)


@pytest.mark.parametrize("name", ["somersault", "obstacle"])
def test_it_is_refused_in_a_plane(name):
    problem = fp.load_problem(PROBLEMS / f"{name}.toml")
    with pytest.raises(fp.InputError, match=r"motion\.objective: \"robust\" is for flights in space.*leave it out"):
        problem.with_parts(motion=replace(problem.motion, objective="robust"))


def test_a_plan_file_in_a_plane_that_says_it_is_refused(tmp_path):
    plan = fp.plan(fp.load_problem(PROBLEMS / "somersault.toml"))
    assert plan.growth_of_errors is None
    path = plan.save(tmp_path / "plan.json")
    content = json.loads(path.read_text())
    content["problem"]["motion"]["objective"] = content["objective"]["name"] = "robust"
    path.write_text(json.dumps(content))
    with pytest.raises(fp.InputError, match="flights in space"):
        fp.load_plan(path)


def test_it_takes_no_recorded_motion():
    with pytest.raises(fp.InputError, match=r'is of the objective "clip", not of "robust"'):
        fp.Motion(objective="robust", clip=fp.ClipReference(positions=((0.0,), (1.0,))))
