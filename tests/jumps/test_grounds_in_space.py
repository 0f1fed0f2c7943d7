"""Jumps in space between grounds of different heights: the step, what stands for it, and what is refused."""

from dataclasses import replace
from functools import cache

import jumps
import numpy as np
import pinocchio as pin
import pytest

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.check import check_jump
from floatplan.jumps.spatial.coordinates import rotations_about
from floatplan.jumps.spatial.guess import guess
from floatplan.jumps.spatial.jump_motion import SpatialGeometry, SpatialJumpMotion
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.standing import Kinematics
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.problem.ground_step import GroundStep, edge_obstacles
from floatplan.problem.jump import JumpLanding, JumpRequest, JumpTakeoff
from floatplan.simulation.contact.model import contact_spec
from floatplan.simulation.contact.tracked_motion import tracked_jump
from floatplan.simulation.perturbation import Perturbation
from floatplan.view import outlines

HEIGHT = 0.2  # m, of the box


@cache
def problem():
    """A Go2 that jumps down from a box in front of it."""
    return fp.load_problem(jumps.PROBLEMS / "jumps" / "space" / "go2_down.toml")


def request(edge, displacement, rise=-HEIGHT):
    takeoff = JumpTakeoff(height=max(-rise, 0.0) or None)
    landing = JumpLanding(height=max(rise, 0.0) or None, displacement=displacement)
    return JumpRequest(takeoff=takeoff, landing=landing, edge=edge)


def setup_of(**values):
    changed = replace(problem().jump, **values)
    return spatial_setup(replace(problem(), jump=changed), changed)


@cache
def coarse_program():
    """The program of that jump, on few nodes."""
    return setup_of().program(jumps.COARSE)


@pytest.mark.parametrize("side", ["box", "floor"])
@pytest.mark.parametrize(
    ("edge", "displacement", "axis"), [(0.1, (0.7, 0.2), 0), (-0.1, (0.1, -0.6), 1), (0.1, (0.5, 0.5), 0)]
)
def test_the_edge_is_at_right_angles_to_the_longer_way(edge, displacement, axis, side):
    """A point that is higher ground is in an obstacle, one beyond the edge is not, whichever way it jumps."""
    rise = -HEIGHT if side == "box" else HEIGHT
    takeoff = (1.0, 2.0, 0.5)
    step = GroundStep.of(request(edge, displacement, rise), takeoff, 0.4)
    assert step.axis == axis
    assert step.edge == pytest.approx(takeoff[axis] + edge)
    assert (step.low, step.high) == pytest.approx((0.4 + min(rise, 0), 0.4 + max(rise, 0)))
    ahead = np.sign(edge)
    behind, beyond = (np.array(takeoff) + ahead * way * np.eye(3)[axis] for way in (-0.2, 0.3))
    stands_higher = step.above_low(np.array([behind[axis], beyond[axis]])) > 0
    assert stands_higher.tolist() == [rise < 0, rise > 0]
    bar, box = edge_obstacles(step)
    low, high = (np.array(box.center) + sign * np.array(box.size) / 2 for sign in (-1, 1))
    for point, is_higher in zip((behind, beyond), stands_higher, strict=True):
        inside_ground = np.array([*point[:2], step.low + HEIGHT / 2])
        assert ((low < inside_ground) & (inside_ground < high)).all() == is_higher
    assert (high[2] + box.margin, low[2]) == pytest.approx((step.high - 0.02, step.low - 1.0))
    face = (high if step.inwards < 0 else low)[axis]
    assert face == pytest.approx(step.edge)
    ends = np.array([bar.start, bar.end])
    assert ends[:, 2] + bar.radius == pytest.approx(step.high)
    assert ends[:, axis] - step.inwards * bar.radius == pytest.approx(step.edge)
    assert np.ptp(ends[:, 1 - axis]) > 5.0


def test_one_ground_has_no_step():
    assert GroundStep.of(JumpRequest(), (0.0, 0.0, 0.0), 0.0) is None
    assert edge_obstacles(None) == ()


def test_it_lands_lower_and_flies_longer():
    lower = setup_of()
    level = setup_of(takeoff=JumpTakeoff(), edge=None)
    assert lower.ends.y[1, 2] - lower.ends.y[0, 2] == pytest.approx(-HEIGHT)
    for name, place in lower.ends.places["landing"].items():
        assert place - level.ends.places["landing"][name] == pytest.approx([0, 0, -HEIGHT])
    flight, level_flight = (next(phase for phase in own.phases if phase.side == "flight") for own in (lower, level))
    fall = np.sqrt(2 * HEIGHT / 9.81)
    assert flight.bounds[1] - level_flight.bounds[1] == pytest.approx(fall)
    assert flight.duration - level_flight.duration == pytest.approx(fall / 2)


REFUSED = {
    "nowhere to land": ({"landing": JumpLanding()}, "landing.displacement: the grounds differ in height; say where"),
    "behind it": ({"edge": -0.06}, r"jump\.edge: -0\.06 m along x is not on its way, which is 0\.7 m there"),
    "beside it": ({"landing": JumpLanding(displacement=(0.1, -0.6))}, r"jump\.edge: 0\.06 m along y is not on its way"),
    "below a foot": ({"edge": 0.01}, r"edge: where it stands at takeoff, 'F._foot' would be 10 mm from the edge on"),
    "inside the box": (
        {"landing": JumpLanding(displacement=(0.5, 0.0))},
        r"displacement: where it stands at landing, 'R._calf' would be -\d+ mm from the side .* come 0\.642 m along x",
    ),
    "inside the box in front": (
        {"takeoff": JumpTakeoff(), "landing": JumpLanding(height=0.2, displacement=(0.7, 0.0))},
        r"edge: where it stands at takeoff, 'base' would be -\d+ mm from the side of the higher ground, 30 mm are",
    ),
    "on the edge of the box": (
        {"takeoff": JumpTakeoff(), "landing": JumpLanding(height=0.2, displacement=(0.6, 0.0)), "edge": 0.24},
        r"displacement: where it stands at landing, 'R._foot' would be -\d+ mm from the edge on the higher ground",
    ),
    "no edge": ({"edge": None}, "edge: the grounds differ in height; say where the higher one ends"),
    "an edge of nothing": ({"takeoff": JumpTakeoff()}, "edge: the grounds are equally high; leave it out"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_grounds_that_do_not_fit_are_refused(name):
    values, reason = REFUSED[name]
    with pytest.raises(InputError, match=reason):
        setup_of(**values)


def test_what_a_refusal_advises_is_not_refused():
    setup_of(landing=JumpLanding(displacement=(0.642, 0.0)), edge=0.06)


def test_an_edge_is_measured_from_a_foot():
    flight = replace(problem().flight, takeoff=None)
    with pytest.raises(InputError, match=r"jump\.edge: is measured from a foot, and 'base', .*: FL_foot, FR_foot"):
        spatial_setup(replace(problem(), flight=flight), problem().jump)


@pytest.mark.parametrize("height", [0.0, 0.5])
def test_a_flight_that_lands_on_another_ground_is_refused(height):
    """The frame's own height, 2 cm over the ground, is no other ground; nor is the one that it leaves."""
    landing = fp.Landing("FL_foot", height=height)
    other = replace(problem(), flight=replace(problem().flight, landing=landing))
    if not height:
        spatial_setup(other, problem().jump)
        return
    with pytest.raises(InputError, match=r"landing\.height: a jump lands on ground that is -0\.2 m up, not 0\.5 m up"):
        spatial_setup(other, problem().jump)


def test_a_robot_that_lands_rotated_stands_on_level_ground():
    """On a box its links are as far from the ground as on the floor: the floor below the box does not count."""
    jump = jumps.roll()
    landed = jump.state_of(jump.after[0].at(np.array([jump.after[0].span[0]])))
    everywhere = GroundStep(edge=-9.0, low=jump.ground - HEIGHT, high=jump.ground, inwards=1)
    floor, box = (SpatialGeometry(jump.robot, jump.after[0].contacts, step) for step in (None, everywhere))
    heights = list(floor.rotated_heights(landed, 0.07))
    assert min(heights) > 0.0
    assert list(box.rotated_heights(landed, 0.07)) == pytest.approx(heights)
    poses = floor.locate(landed)
    of_box = dict(box.lowest(poses))
    for link, height in floor.lowest(poses):
        assert of_box[link] == pytest.approx(height - HEIGHT)


def test_the_ground_of_a_landing_without_its_takeoff_is_the_one_that_it_lands_on():
    jump = jumps.roll()
    upwards = request(0.1, (0.7, 0.0), HEIGHT)
    motion = SpatialJumpMotion(jump.problem, upwards, None, (), jump.after)
    assert (motion.step.low, motion.step.high) == pytest.approx((jump.ground - HEIGHT, jump.ground))
    assert motion.ground == motion.step.low


def test_labels_name_the_phase_in_which_a_foot_stands():
    """On the border of takeoff and flight feet still stand, with those that leave on the border of two phases."""
    program = coarse_program()
    by_phase = {phase.name: {foot.name for foot in phase.feet} for phase in program.phases}
    positions = {label for label in program.assembly.labels if label.startswith("position of ")}
    assert positions
    for label in positions:
        foot, where = label.removeprefix("position of ").rstrip(")").split(" (")
        assert foot in by_phase[where]


def test_rows_keep_capsules_out_of_the_box():
    """They are within the smoothing of what the box's faces leave of capsules that are placed by Pinocchio."""
    setup = setup_of()
    program = coarse_program()
    raw = guess(program, np.random.default_rng(0))
    assembly = program.assembly
    labels = np.array(assembly.labels)
    values = np.asarray(assembly.evaluate(raw, np.zeros(program.size + 1))).ravel() * program.height
    node = int(program.borders[program.flight]) + 4  # over the edge
    robot = program.model.robot
    kinematics = Kinematics(robot)
    y = program.solution(raw, 0, False).y[:, node]
    q = kinematics.pose(np.zeros(3), rotations_about(setup.axes, y[3:6, None])[0], y[6:])
    shift = y[:3] - pin.centerOfMass(kinematics.model, kinematics.data, q)
    is_of_edge = np.char.startswith(labels, "distance of") & np.char.endswith(labels, "edge of the ground (flight)")
    nodes = program.phases[program.flight].intervals - 1  # between takeoff and landing
    own = values[is_of_edge].reshape(nodes, -1)[3]
    names = labels[is_of_edge].reshape(nodes, -1)[4]
    capsules = [capsule for capsule in robot.solid_capsules if capsule.radius or (capsule.start != capsule.end).any()]
    step = setup.step
    feet = {foot.body for foot in setup.feet}
    assert len(own) == len(capsules)
    for value, name, capsule in zip(own, names, capsules, strict=True):
        ends = np.array([kinematics.point(capsule.body, end) + shift for end in (capsule.start, capsule.end)])
        top = step.high - (0.022 if capsule.body in feet else 0.0)  # 2 mm, and what is apart
        beyond = (step.inwards * (step.edge - ends[:, step.axis])).min()
        above = (ends[:, 2] - top).min()
        assert capsule.link in name
        assert value == pytest.approx(max(beyond, above) - capsule.radius - 0.02, abs=0.0101)


def test_heights_are_over_the_ground_below():
    """Where all is on the higher ground every height is less by its own; beyond the edge none is."""
    jump = jumps.roll()
    state = jump.state(np.linspace(0.0, jump.duration, 5))
    heights = {}
    for edge in (None, -50.0, 50.0, float(state.com_position[0, 0])):
        step = None if edge is None else GroundStep(edge, 0.0, HEIGHT, 1, axis=0, across=0.0)
        geometry = type(jump.geometry)(jump.robot, jump.contacts, step)
        heights[edge] = np.array([lowest for _, lowest in geometry.lowest(geometry.locate(state))])
    level, higher, lower, between = heights.values()
    assert higher == pytest.approx(level - HEIGHT)
    assert lower == pytest.approx(level)
    assert (between > level - HEIGHT - 1e-9).all()
    first = between[:, 0] - level[:, 0]
    assert first.min() == pytest.approx(-HEIGHT)
    assert first.max() == pytest.approx(0.0)


@pytest.mark.parametrize(("axis", "inwards"), [(0, 1), (0, -1), (1, 1), (1, -1)])
def test_mujoco_has_a_box(axis, inwards):
    tracked, _ = tracked_jump(jumps.roll())
    step = GroundStep(0.3, -0.1, 0.1, inwards, axis=axis, across=0.5)
    other = replace(tracked, shapes=replace(tracked.shapes, step=step))
    sample = Perturbation().sampled(0, 0, len(tracked.reduced.joints), tracked.reduced.model.njoints)
    geom = contact_spec(other, 0.8, sample).spec.geom("step")
    turned = of_quaternions(np.array([[*geom.quat[1:], geom.quat[0]]]))[0]
    half = np.abs(turned @ geom.size)
    low, high = geom.pos - half, geom.pos + half
    assert (low[2], high[2]) == pytest.approx((-0.1, 0.1))
    assert (low if inwards > 0 else high)[axis] == pytest.approx(0.3)
    assert (low[1 - axis] + high[1 - axis]) / 2 == pytest.approx(0.5)


def test_pictures_have_a_platform_with_shadows_on_it():
    level = jumps.roll()
    jump = replace(level, request=request(0.3, (0.7, 0.0)))
    higher = outlines.platform(jump)
    assert higher.center[2] + higher.size[2] / 2 == pytest.approx(jump.before[0].ground)
    assert higher.size[2] == pytest.approx(HEIGHT)
    assert higher.center[0] + higher.size[0] / 2 == pytest.approx(jump.step.edge)
    below = higher.center[0] - higher.size[0] / 2
    assert below < level.state([0.0]).base_position[0, 0] - outlines.robot_size(level) / 3
    assert outlines.ground_step(jump) is None
    assert outlines.platform(level) is None
    own, other = (outlines.postures(each, np.zeros(1)).shadows for each in (jump, level))
    assert own == pytest.approx(other, abs=1e-12)  # on the platform, not on the ground below it


@pytest.mark.long
def test_down_from_a_box(tmp_path):
    jump = jumps.stored_jump("a1_down")
    assert jump.ok, jump.explanation
    assert jump.before[-1].ground - jump.after[0].ground == pytest.approx(HEIGHT)
    again = fp.load_jump(jump.save(tmp_path / "jump.json"))
    assert again.check.figures == jump.check.figures
    proof = fp.certify(jump.flight)
    assert proof.proved
    assert {"capsule", "box"} <= {finding.subject[1] for finding in proof.findings if finding.kind == "obstacle"}
    wider = replace(jump, request=replace(jump.request, edge=jump.request.edge + 0.4))
    assert check_jump(wider).figures["ground"] < -0.1  # where it lands then is the box
    assert check_jump(wider).figures["obstacles"] < 0
    tracked, _ = tracked_jump(jump)
    assert tracked.begin_ground - tracked.end_ground == pytest.approx(HEIGHT)
    assert fp.replay_jump(jump, gains=100.0).landings.stands.all()
