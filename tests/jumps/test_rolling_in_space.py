"""Feet that roll in space: balls about their frames, in the program's model, in exact stances, and in the check."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import plan_on_fewer_nodes
from places import ROOT

import floatplan as fp
from floatplan.jumps.model import casadi
from floatplan.jumps.reading import read_spatial_stance
from floatplan.jumps.spatial.coordinates import Mechanics, rotations_about
from floatplan.jumps.spatial.jump import contact_table
from floatplan.jumps.spatial.model import BASE, SpatialModel
from floatplan.jumps.spatial.pendulum import Line, rolled_from
from floatplan.jumps.spatial.setup import feet_and_posture, spatial_setup
from floatplan.jumps.spatial.stance import SpatialGrid, SpatialStance
from floatplan.jumps.spatial.standing import Kinematics, feet_at, rolling
from floatplan.problem.attitude import Attitude

AXES = "yxz"
FEET = ("FL_foot", "RR_foot")
LEVEL = Attitude(angles=(0.0, 0.0, 0.0), axes=AXES)


@pytest.fixture(scope="module")
def quarter_turn():
    return fp.load_problem(ROOT / "problems" / "jumps" / "space" / "go2_quarter_turn.toml")


@pytest.fixture(scope="module")
def go2(quarter_turn):
    return quarter_turn.robot


@pytest.fixture(scope="module")
def feet(go2):
    points = [feet_at(go2, frame, LEVEL, go2.resting, "contacts")[0] for frame in FEET]
    return tuple(rolling(go2, point, LEVEL, go2.resting) for point in points)


@pytest.fixture(scope="module")
def mechanics(go2, feet):
    return Mechanics(go2, AXES, 9.81, feet)


def rocking(robot, times, size=1.0):
    """Base, angles and joints of a robot that rocks about where it stands, with derivatives (3, 6+n, N)."""
    rng = np.random.default_rng(0)
    rows = BASE + len(robot.joints)
    standing = np.concatenate((np.zeros(BASE), robot.resting))
    rates = rng.uniform(4.0, 9.0, (rows, 1))
    shifts = rng.uniform(0.0, 2 * np.pi, (rows, 1))
    sizes = size * rng.uniform(0.1, 0.3, (rows, 1))
    at = rates * times + shifts
    return np.stack(
        (standing[:, None] + sizes * np.sin(at), sizes * rates * np.cos(at), -sizes * rates**2 * np.sin(at))
    )


def lowest_then(robot, foot, motion, instant):
    """Where the point of a foot is at N instants (N, 3), m, that is its lowest at one of them."""
    kinematics = Kinematics(robot)
    places = []
    local = np.zeros(3)
    for index in [instant, *range(motion.shape[2])]:
        y = motion[0, :, index]
        kinematics.pose(y[:3], rotations_about(AXES, y[3:BASE, None])[0], y[BASE:])
        placement = kinematics.data.oMi[foot.body]
        if not places:
            local = placement.actInv(placement.act(np.array(foot.local)) - [0.0, 0.0, foot.radius])
        places.append(placement.act(local))
    return np.array(places[1:])


def test_rows_are_what_the_lowest_point_of_a_ball_moves_by(go2, feet, mechanics):
    """Slip and its derivative in the model and by Pinocchio, against differences of places of the ball's points."""
    step = 1e-4  # [s]
    motion = rocking(go2, step * np.arange(-2, 3))
    model = SpatialModel(go2, AXES, 9.81, feet)
    ca = casadi()
    rows = ca.Function("rows", [model.y, model.v, model.a], [ca.horzcat(*model.foot(foot.name)[1]) for foot in feet])
    of_centre = motion.copy()
    of_centre[:, :3] = mechanics.centre(motion)[0]
    places = mechanics.feet(motion, FEET)
    _, jacobians = mechanics.places_and_jacobians(mechanics.coordinates(motion)[0], FEET, of_slip=True)
    for column, foot in enumerate(feet):
        point = lowest_then(go2, foot, motion, 2)
        slip = (point[3] - point[1]) / (2 * step)
        assert places[1, 2, column] == pytest.approx(slip, abs=1e-5)
        assert np.linalg.norm(slip) > 0.1
        assert places[2, 2, column] == pytest.approx((places[1, 3] - places[1, 1])[column] / (2 * step), abs=1e-4)
        of_model = np.array(rows(*of_centre[:, :, 2])[column])
        assert np.abs(of_model.T - places[:, 2, column]).max() < 1e-11
        joint = 2 + mechanics.legs[foot.name][0]
        moved = motion[:, :, [2, 2]].copy()
        moved[1, BASE + joint, 1] += 1.0
        slips = mechanics.feet(moved, FEET)
        assert jacobians[2, column, :, joint] == pytest.approx((slips[1, 1] - slips[1, 0])[column], abs=1e-12)


def test_forces_act_where_a_ball_touches_the_ground(go2, feet, mechanics):
    """By virtual work: torques change by forces times what each joint moves the ball's lowest point by."""
    motion = rocking(go2, np.zeros(1))
    model = SpatialModel(go2, AXES, 9.81, feet)
    ca = casadi()
    symbols = {foot.name: ca.SX.sym(foot.name, 3) for foot in feet}
    function = ca.Function(
        "model", [model.y, model.v, model.a, *symbols.values()], [model.torques(symbols), model.balance(symbols)]
    )
    of_centre = motion[:, :, 0].copy()
    of_centre[:, :3] = mechanics.centre(motion)[0][:, :, 0]
    forces = np.random.default_rng(1).uniform(-100.0, 100.0, (2, 3))
    free, free_balance = function(*of_centre, *np.zeros((2, 3)))
    loaded, balance = function(*of_centre, *forces)
    _, jacobians = mechanics.places_and_jacobians(mechanics.coordinates(motion)[0], FEET, of_slip=True)
    carried = np.einsum("fin,fi->n", jacobians[0], forces)
    change = np.array(free - loaded).ravel() @ go2.selection[BASE:]
    assert change == pytest.approx(carried, abs=1e-11)
    points = np.array([lowest_then(go2, foot, motion, 0)[0] for foot in feet])
    moments = np.cross(points - of_centre[0, :3], forces).sum(axis=0)
    expected = np.concatenate((forces.sum(axis=0), moments))
    assert np.array(free_balance - balance).ravel() == pytest.approx(expected, abs=1e-10)


def test_legs_roll_and_a_robot_on_two_balls_is_in_balance(go2, feet, mechanics):
    """From either end: nothing slips, heights stay, and no moment is left about the line through both contacts."""
    times = np.linspace(0.0, 0.06, 13)
    motion = rocking(go2, times, size=0.3)
    still = motion[:, :, [6]].copy()
    still[1:] = 0.0
    places = mechanics.feet(still, FEET)
    line = Line.through(dict(zip(FEET, places[0, 0], strict=True)))
    direction = line.rotated_robot(AXES, still, np.array([[0.0], [1.0], [0.0]]))[1, :BASE, 0]
    for fixed_end in (0, -1):
        rolled = rolled_from(mechanics, FEET, times, motion, fixed_end, direction)
        assert np.abs(rolled[:2, :BASE, fixed_end] - motion[:2, :BASE, fixed_end]).max() < 1e-12
        assert np.ptp(rolled[0, :BASE] - motion[0, :BASE], axis=1).max() > 1e-4
        places = mechanics.feet(rolled, FEET)
        assert np.abs(places[1:]).max() < 1e-9
        assert np.ptp(places[0, :, :, 2], axis=0).max() < 1e-8
        assert np.ptp(places[0, :, :, :2], axis=0).max() > 1e-4  # [m] it has rolled
        contacts = places[0] - [0.0, 0.0, feet[0].radius]
        contacts[:, 1, 2] += feet[0].radius - feet[1].radius
        wrench = mechanics.base_wrench(rolled)
        moments = wrench[:, 3:] - np.cross(contacts[:, 0] - rolled[0, :3].T, wrench[:, :3])
        about_line = ((contacts[:, 1] - contacts[:, 0]) * moments).sum(axis=1)
        assert np.abs(about_line).max() < 1e-8 * np.abs(moments).max()


def test_a_stance_tells_what_its_feet_roll_and_slip(go2, feet, mechanics):
    """What the check has of them: places less what was rolled stay, and the points on the ground are at rest."""
    times = np.linspace(0.0, 0.06, 13)
    motion = rolled_from(mechanics, FEET, times, rocking(go2, times, size=0.3), 0, None)
    grid = SpatialGrid(times, *motion, np.full((6, len(times)), 50.0))
    stance = SpatialStance(go2, 9.81, AXES, feet, 0.6, grid)
    state = stance.at(np.linspace(0.0, 0.06, 121))
    _, of_feet = stance.inverse_dynamics(state)
    for foot in feet:
        places, speeds = of_feet[foot.name]
        assert np.ptp(places, axis=0).max() < 1e-6
        assert speeds.max() < 1e-5
        assert np.ptp(state.points[foot.name][:, :2], axis=0).max() > 1e-4
    slipping = replace(stance, contacts=tuple(replace(foot, radius=0.8 * foot.radius) for foot in feet))
    _, of_feet = slipping.inverse_dynamics(state)
    assert min(speeds.max() for _, speeds in of_feet.values()) > 5e-3


def test_a_file_holds_that_feet_roll(go2, feet):
    times = np.array([0.0, 1.0])
    zero = np.zeros((BASE + len(go2.joints), 2))
    content = {
        "contacts": [contact_table(foot) for foot in feet],
        "axes": AXES,
        "friction": 0.6,
        "times": times.tolist(),
        **dict.fromkeys(("y", "v", "a"), zero.tolist()),
        "shares": np.zeros((6, 2)).tolist(),
    }
    assert all(table["rolls"] is True for table in content["contacts"])
    assert read_spatial_stance(content, go2, 9.81, "stances[0]").contacts == feet
    assert "rolls" not in contact_table(replace(feet[0], radius=0.0))


def test_feet_roll_where_a_request_says_so(quarter_turn):
    asked = replace(quarter_turn.jump, feet="rolling")
    radii = {foot.radius for foot in spatial_setup(quarter_turn, asked).feet}
    assert min(radii) == pytest.approx(0.0227, abs=1e-4)
    assert {foot.radius for foot in spatial_setup(quarter_turn, quarter_turn.jump).feet} == {0.0}


def test_what_cannot_roll_is_refused(quarter_turn):
    g1 = fp.load_problem(ROOT / "problems" / "jumps" / "space" / "g1_quarter_turn.toml")
    asked = replace(g1.jump, feet="rolling")
    with pytest.raises(fp.InputError, match="'left_ankle_roll_link' cannot roll: its link is a sole") as error:
        spatial_setup(g1, asked)
    assert error.value.element == "jump.feet"
    asked = replace(quarter_turn.jump, feet="rolling")
    with pytest.raises(fp.InputError, match="is for whole jumps, so far") as error:
        feet_and_posture(quarter_turn, asked, "takeoff")
    assert error.value.element == "jump.feet"
    everything = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")
    three = replace(asked, takeoff=fp.JumpTakeoff(contacts=[everything, everything[:3]]))
    with pytest.raises(fp.InputError, match="3 feet would roll where 4 stand") as error:
        spatial_setup(quarter_turn, three)
    assert error.value.element == "jump.takeoff.contacts"


@pytest.mark.long
def test_a_jump_on_balls_is_found_and_checked(quarter_turn, tmp_path, monkeypatch):
    plan_on_fewer_nodes(monkeypatch, share=0.45)
    found = fp.jump(quarter_turn, replace(quarter_turn.jump, feet="rolling"), starts=1)
    assert found.ok, found.explanation
    figures = found.check.figures
    assert figures["residual"] < 1e-6
    assert figures["drift"] < 1e-6
    assert figures["foot_speed"] < 5e-3
    assert max(figures["takeoff_seam"], figures["landing_seam"]) < 1e-6
    assert figures["circle"] < 4e-3
    for stance in found.stances:
        points = stance.at(np.linspace(*stance.span, 50)).points
        assert min(np.ptp(point[:, :2], axis=0).max() for point in points.values()) > 2e-3  # [m] rolled
    found.save(tmp_path / "jump.json")
    read = fp.load_jump(tmp_path / "jump.json")
    times = np.linspace(0.0, found.duration, 20)
    assert read.q(times) == pytest.approx(found.q(times), abs=1e-12)
    assert {foot.radius for foot in read.contacts} == {foot.radius for foot in found.contacts}
    ends = found.q([0.0, found.duration])
    turned = pin.log3(pin.Quaternion(ends[0, 3:7]).matrix().T @ pin.Quaternion(ends[1, 3:7]).matrix())
    assert turned == pytest.approx([0.0, 0.0, np.pi / 2], abs=1e-9)
