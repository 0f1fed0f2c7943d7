"""Whole jumps in space: found, checked, saved and read; and what is refused."""

import json
from dataclasses import replace

import jumps
import numpy as np
import pinocchio as pin
import pytest

import floatplan as fp
from floatplan.jumps.launches import in_space
from floatplan.jumps.setup import NodeMargins
from floatplan.jumps.spatial import planner
from floatplan.jumps.spatial.guess import guess
from floatplan.jumps.spatial.program import SpatialProgram, SpatialSolution
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.stance_search import StanceResult


@pytest.fixture(scope="module")
def problem(root):
    return fp.load_problem(root / "problems" / "jumps" / "space" / "go2_roll.toml")


@pytest.fixture(scope="module")
def roll():
    """A Go2 that rolls once, from its right legs to its left ones."""
    return jumps.roll()


def test_it_is_found_and_checked(roll):
    assert roll.ok, roll.check.sentences[0]
    figures = roll.check.figures
    assert figures["residual"] < 1e-6
    assert figures["drift"] < 1e-4
    assert figures["foot_speed"] < 5e-3
    assert figures["takeoff_seam"] < 1e-8
    assert figures["landing_seam"] < 1e-8
    assert figures["torque"] <= 0.85
    assert figures["velocity"] <= 0.88


def test_it_rolls_and_stands(roll):
    ends = roll.q([0.0, roll.duration])
    first, last = (pin.Quaternion(q[3:7]).matrix() for q in ends)
    assert np.abs(last - first).max() < 1e-9
    quaternions = roll.q(np.linspace(0.0, roll.duration, 201))[:, 3:7]
    assert np.abs(quaternions[0] + quaternions[-1]).max() < 1e-9  # after one turn it has the other sign
    assert np.abs(ends[0, 7:] - ends[1, 7:]).max() < 1e-9
    assert [phase.kind for phase in roll.phases] == ["stance", "stance", "flight", "stance", "stance"]
    weight = roll.robot.mass * 9.81
    forces = roll.forces([0.0, roll.duration])
    assert np.abs(sum(forces.values()) - [0.0, 0.0, weight]).max() < 1e-6 * weight


def test_momentum_changes_by_what_the_feet_exert(roll):
    """The moment about the centre of mass, integrated, by an independent sum over contact forces."""
    times = np.linspace(0.0, roll.takeoff_time, 4001)
    state = roll.state(times)
    forces = roll.forces(times)
    points = roll.contact_points(times)
    arms = {name: np.nan_to_num(points[name] - state.com_position) for name in forces}  # NaN in the air, without force
    moment = sum(np.cross(arms[name], forces[name]) for name in forces)
    gained = np.trapezoid(moment, times, axis=0)
    assert np.abs(gained - state.angular_momentum[-1]).max() < 1e-4
    flight = roll.flight
    assert np.abs(state.angular_momentum[-1] - flight.angular_momentum).max() < 1e-9


def test_its_file_holds_it(roll, tmp_path):
    path = roll.save(tmp_path / "jump.json")
    content = json.loads(path.read_text())
    assert content["format"] == "floatplan.jump/2"
    assert content["flight"]["format"] == "floatplan.plan/2"
    again = fp.load_jump(path)
    assert again.check.figures == roll.check.figures
    content["stances"][0]["y"][8][40] += 0.02
    path.write_text(json.dumps(content))
    assert not fp.load_jump(path).ok
    content["stances"][0]["contacts"][0]["frame"] = "paw"
    path.write_text(json.dumps(content))
    with pytest.raises(fp.InputError, match="no frame 'paw'"):
        fp.load_jump(path)


def test_it_is_handed_on(roll, tmp_path):
    sample = roll.sample(100.0)
    assert sample.q.shape == (len(sample.times), roll.robot.nq)
    assert roll.export("npz", tmp_path / "jump.npz").exists()


def test_what_is_for_jumps_in_a_plane_says_so(roll):
    with pytest.raises(fp.InputError, match="near: is for jumps in a plane"):
        fp.jump(roll.problem, near=roll)


def test_a_takeoff_with_rates_beyond_the_limits_is_shown_to_be_impossible(roll, monkeypatch):
    """Rates follow from the velocity, the momentum and the still feet: nothing is searched for."""
    monkeypatch.setattr(in_space, "planned_stance", lambda *_, **__: pytest.fail("a search for what there is not"))
    flight = roll.flight
    slow = replace(flight, problem=replace(flight.problem, limits=fp.Limits(velocity=3.0)))
    result = fp.launch(slow)
    assert result.impossible
    assert not result.ok
    largest = np.abs(flight.at(0.0).velocities).max() / 3.0
    assert 1.0 < result.ratio <= largest * (1 + 1e-6)
    assert f"{result.joint}'s rate is at least {result.ratio:.2f} of its limit, whatever came" in result.sentences[0]


def test_feet_of_a_takeoff_that_are_not_level_are_named(roll):
    """A roll leaves from its right legs, its left ones are in the air then."""
    contacts = [("FL_foot", "FR_foot", "RL_foot", "RR_foot")]
    request = replace(roll.request, takeoff=replace(roll.request.takeoff, contacts=contacts))
    result = fp.launch(roll.flight, request)
    assert result.impossible
    assert "mm higher than" in result.sentences[0]


@pytest.mark.long
@pytest.mark.parametrize("end", ["takeoff", "landing"])
def test_the_stances_of_its_flight_are_found_again(roll, end, monkeypatch):
    """Within tighter limits, which takes longer, that of the takeoff alone is searched for."""
    jumps.plan_on_fewer_nodes(monkeypatch)
    search = in_space.planned_stance
    results = []

    def first_of_landings(*arguments, **options):
        if results and end == "landing":
            return StanceResult((), {}, ("not searched for",))
        results.append(search(*arguments, **options))
        return results[-1]

    monkeypatch.setattr(in_space, "planned_stance", first_of_landings)
    result = fp.launch(roll.flight, end=end, starts=1)
    assert result.ok, result.sentences
    assert result.ratio <= 0.97  # where its own takes 0.88
    assert result.sentences[0].startswith(f"{end.capitalize()}: reachable, with ")
    assert result.figures["residual"] < 1e-3


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("go2_roll", {"FR_foot", "RR_foot"}, {"FL_foot", "RL_foot"}),
        ("go2_half_flip_half_twist", {"RL_foot", "RR_foot"}, {"RL_foot", "RR_foot"}),
        ("a1_roll", {"FR_foot", "RR_foot"}, {"FL_foot", "RL_foot"}),
    ],
)
def test_feet_over_which_it_tips_leave_last(root, name, before, after):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / f"{name}.toml")
    phases = spatial_setup(problem, problem.jump).phases
    assert [phase.side for phase in phases] == ["takeoff", "takeoff", "flight", "landing", "landing"]
    assert set(phases[1].names) == before
    assert set(phases[3].names) == after


@pytest.mark.parametrize("name", ["go2_quarter_turn", "go2_side", "a1_diagonal"])
def test_without_tilt_all_feet_stand(root, name):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / f"{name}.toml")
    phases = spatial_setup(problem, problem.jump).phases
    assert [len(phase.feet) for phase in phases] == [4, 0, 4]


@pytest.mark.parametrize(
    ("name", "stances"), [("go2_quarter_turn", 2), pytest.param("go2_roll", 3, marks=pytest.mark.long)]
)
def test_feet_are_held_where_they_stand(root, name, stances):
    """Rows of feet that stand grow with their distance from where they stood, on both sides of the flight."""
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / f"{name}.toml")
    program = spatial_setup(problem, problem.jump).program(replace(planner.MARGINS, refinement=0.4))
    raw = guess(program)
    parameters = np.zeros(program.size + 1)
    of_feet = np.array([label.startswith("position of") for label in program.assembly.labels])
    stiffness = 625.0 / 9.81  # [1/m] over g
    for node, count in ((3, 4), (program.nodes - 4, 4), (int(program.borders[2]) - 2, 2))[:stances]:
        moved = raw.copy()
        moved[program.begins[node]] += 0.01
        change = np.subtract(*(np.array(program.assembly.evaluate(x, parameters)).ravel() for x in (moved, raw)))
        assert np.count_nonzero(np.abs(change[of_feet] - 0.01 * stiffness) < 1e-9) == count


@pytest.mark.long
def test_what_fails_its_check_is_planned_once_more(root, monkeypatch):
    """A program that allows rates of 0.84 of their limits where 0.7 are requested: the next one allows less."""
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / "go2_quarter_turn.toml")
    request = replace(problem.jump, margin={"torque": 0.85, "velocity": 0.7})
    monkeypatch.setattr(planner, "MARGINS", NodeMargins(torque=0.95, velocity=1.2, friction=0.85, refinement=0.6))
    completed = planner.completed
    jumps = []

    def recorded(*arguments):
        jumps.append(completed(*arguments))
        return jumps[-1]

    monkeypatch.setattr(planner, "completed", recorded)
    messages = []
    jump = planner.jump_in_space(problem, request, 0, 1, messages.append)
    assert not jumps[0].ok
    assert jumps[0].check.figures["velocity"] > 0.7
    assert jump is jumps[-1]
    assert jump.ok, jump.check.sentences[0]
    assert jump.check.figures["velocity"] <= 0.7
    assert len(jumps) == 1 + sum("with more nodes" in message for message in messages)


@pytest.mark.parametrize(
    ("name", "number", "intervals", "tilt"),
    [
        ("go2_half_flip_half_twist", 0, 12, 65.0),
        ("go2_half_flip_half_twist", 1, 12, 65.0),
        ("a1_backflip_half_twist", 0, 22, 45.0),
        ("a1_backflip_half_twist", 1, 31, 35.0),
        ("a1_backflip_half_twist", 2, 31, 35.0),
    ],
)
def test_starts_of_combined_rotations_tilt_less_with_more_nodes(root, monkeypatch, name, number, intervals, tilt):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / f"{name}.toml")
    guesses = []

    def unsolved(program, raw, is_near=False):
        guesses.append(raw)
        return SpatialSolution(raw, *np.zeros((3, 1, 1)), [], np.zeros(1), (1.0, ""), 0, converged=False)

    monkeypatch.setattr(SpatialProgram, "solve", unsolved)
    setup = spatial_setup(problem, problem.jump)
    start = planner.solved_start(setup, 0, number)
    assert start.program.phases[start.program.flight].intervals == intervals
    assert np.rad2deg(start.program.bounds.tilt) == pytest.approx(tilt)
    is_generic = number == 0 or (setup.is_combined and number == 1)
    assert np.array_equal(guesses[0], guess(start.program)) == is_generic


@pytest.mark.long
def test_an_a1_flips_with_half_a_twist_within_three_starts(root):
    found = fp.jump(root / "problems" / "jumps" / "space" / "a1_backflip_half_twist.toml", starts=3)
    assert found.ok, found.explanation


ALL = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")


def sides(takeoff, landing=(ALL,)):
    return {"takeoff": fp.JumpTakeoff(contacts=takeoff), "landing": fp.JumpLanding(contacts=landing)}


@pytest.mark.parametrize(
    ("changes", "element", "words"),
    [
        (sides([ALL, ("RR_foot",)]), "jump.takeoff.contacts", "would stand on its own"),
        (sides([(*ALL, "FL_calf")]), "jump.takeoff.contacts", "stands twice: on the same leg as 'FL_foot'"),
        (sides([ALL], [ALL[:3]]), "jump.landing.contacts", "'RR_foot' would be left in the air"),
        (sides([ALL[:3]], [ALL[:3]]), "jump.takeoff.contacts", "'RR_foot' is on the ground too"),
        (sides([ALL], [("FL_hip", *ALL)]), "jump.landing.contacts", "'FL_hip' is not among what stands at first"),
        ({"objective": "limits"}, "jump.objective", "is for jumps in a plane"),
        ({"feet": "rolling"}, "jump.feet", "is for jumps in a plane"),
        ({"fixed": ("goal",)}, "jump.fixed", "is for jumps in a plane"),
    ],
)
def test_requests_that_no_jump_meets_are_refused(problem, changes, element, words):
    with pytest.raises(fp.InputError, match=words) as error:
        spatial_setup(problem, replace(problem.jump, **changes))
    assert error.value.element.startswith(element)


@pytest.mark.parametrize(
    ("angles", "axes", "words"),
    [
        ((0.0, np.pi, 0.0), "xyz", "its second angle about 'xyz' is 180 degrees"),
        ((np.pi, 0.0, 0.0), "xyz", "a jump ends as level as it begins"),
    ],
)
def test_goals_that_are_not_level_are_refused(problem, angles, axes, words):
    goal = replace(problem.goal, orientation=fp.Attitude(angles=angles, axes=axes))
    start = replace(problem.start, orientation=fp.Attitude(angles=(0.0, 0.0, 0.0), axes=axes))
    with pytest.raises(fp.InputError, match=words) as error:
        fp.jump(replace(problem, start=start, goal=goal), starts=1)
    assert error.value.element == "goal.orientation"


def test_a_displacement_is_for_jumps_in_space(root):
    planar = fp.load_problem(root / "problems" / "jumps" / "go2.toml")
    with pytest.raises(fp.InputError, match="is for jumps in space"):
        replace(planar, jump=replace(planar.jump, landing=fp.JumpLanding(displacement=(0.1, 0.0))))
