from __future__ import annotations

import dataclasses
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from unittest.mock import Mock

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

import floatplan as fp
from floatplan.errors import InputError
from floatplan.problem.parts import Obstacle
from floatplan.robot.shapes.links import LinkCapsule
from floatplan.view.figures.figures import SAMPLES, figures, save_figures
from floatplan.view.figures.snapshots import KINOGRAM, kinogram, kinogram_times, worst_passage
from floatplan.view.outlines import (
    ground_lines,
    obstacle_outlines,
    pairs,
    postures,
    rendered_capsules,
    snapshot_times,
    stadium,
)
from floatplan.view.style import COLUMN, OKABE_ITO, palette, styled

ALWAYS = ["snapshots", "kinogram", "configuration", "rates", "torques", "momentum", "inertia"]
CIRCLE = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)


@pytest.fixture(scope="module")
def hindered(handstand: fp.Plan) -> fp.Plan:
    """The same motion, in whose way there are obstacles of every kind, moving and not, and limits."""
    problem = dataclasses.replace(
        handstand.problem,
        obstacles=(
            CIRCLE,
            fp.Circle(center=(0.2, 3.2), radius=0.1, velocity=(1.0, 0.0)),
            fp.HalfPlane(),
            fp.Bar(start=(2.4, 3.0), end=(2.9, 3.2), radius=0.04, margin=0.05, window=(0.2, 0.9)),
        ),
        limits=fp.Limits(
            position="full",
            torque={"q1": 4.0, "q2": 100.0},
            velocity=9.0,
            motor={"q1": fp.Motor(5.0, 0.2)},
            orientation_rate=6.0,
        ),
    )
    return dataclasses.replace(handstand, problem=problem)


@pytest.fixture(scope="module")
def drawn(handstand: fp.Plan) -> dict[str, Figure]:
    return figures(handstand)


@pytest.fixture(scope="module")
def compared(handstand: fp.Plan, hindered: fp.Plan) -> dict[str, Figure]:
    return figures(hindered, compare=handstand)


def flight(root: Path, robot: str) -> fp.Plan:
    problem = fp.Problem(
        fp.Robot.from_urdf(root / "urdf" / f"{robot}.urdf"),
        start=fp.Posture(1.2, 0.15),
        goal=fp.Posture(-1.5, -0.1),
        flight=fp.Flight(
            1.3,
            takeoff=fp.Takeoff("foot"),
            landing=fp.Landing("hand"),
            horizontal_velocity=2.0,
            angular_momentum="free",
        ),
        name=robot,
    )
    return fp.plan(problem)


def only(figure: Figure) -> Axes:
    (axes,) = figure.axes
    return axes


def curves(axes: Axes) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in axes.lines if len(line.get_xdata()) == SAMPLES]


def test_a_plan_has_the_paper_s_figures(handstand: fp.Plan) -> None:
    assert list(handstand.figures()) == ALWAYS


def test_obstacles_and_a_second_plan_add_theirs(
    handstand: fp.Plan, hindered: fp.Plan, compared: dict[str, Figure]
) -> None:
    assert list(figures(hindered)) == [*ALWAYS, "clearance"]
    assert list(compared) == [*ALWAYS, "clearance", "comparison"]
    assert list(figures(handstand, compare=hindered)) == [*ALWAYS, "comparison"]


def test_two_plans_are_compared_where_one_runs_into_something(handstand: fp.Plan) -> None:
    def among(*obstacles: Obstacle) -> fp.Plan:
        return dataclasses.replace(handstand, problem=dataclasses.replace(handstand.problem, obstacles=obstacles))

    ground = fp.HalfPlane()
    time, obstacle = worst_passage(among(ground, CIRCLE), handstand)
    assert obstacle is CIRCLE
    assert handstand.clearances(time, [CIRCLE])[0] < CIRCLE.margin
    assert worst_passage(among(ground), handstand) == (handstand.duration / 2, None)


@pytest.mark.long
def test_ten_joints_have_a_picture_each(root: Path, tmp_path: Path) -> None:
    """With its own curve, limit and proved peak; a limit that is far away is a number."""
    plan = flight(root, "chain10")
    limit = 2.0 * float(plan.peaks.velocity[0])
    limits = fp.Limits(velocity=[limit, *[1e4] * 9])
    plan = dataclasses.replace(plan, problem=dataclasses.replace(plan.problem, limits=limits))
    assert len(save_figures(plan, tmp_path, formats=("svg",))) == len(ALWAYS)
    drawn = figures(plan)
    state = plan.at(np.linspace(0, plan.duration, SAMPLES))
    expected = {
        "configuration": np.rad2deg(np.column_stack((state.orientation, state.positions))),
        "rates": np.column_stack((state.orientation_rate, state.velocities)),
        "torques": state.motor_torques,
    }
    for name, columns in expected.items():
        panels = named_panels(drawn[name])
        names = ["orientation", *plan.robot.joints][-columns.shape[1] :]
        assert set(panels) == set(names)
        for joint, column in zip(names, columns.T, strict=True):
            own = [curve for curve in curves(panels[joint]) if np.allclose(curve[:, 1], column)]
            assert len(own) == 1, joint
    rates = named_panels(drawn["rates"])
    assert {rates[joint].get_title("right") for joint in plan.robot.joints[1:]} == {"limit 1e+04"}
    drawn_limits = {float(curve[0, 1]) for curve in curves(rates["q1"]) if np.ptp(curve[:, 1]) == 0}
    assert drawn_limits == {limit, -limit}
    assert rates["q1"].get_title("right") == ""


def named_panels(figure: Figure) -> dict[str, Axes]:
    return {axes.get_title("left"): axes for axes in figure.axes if axes.axison}


def test_ten_joints_against_another_plan(root: Path) -> None:
    plan = flight(root, "chain10")
    drawn = figures(plan, compare=dataclasses.replace(plan, problem=dataclasses.replace(plan.problem, name="other")))
    for name in ("configuration", "rates", "torques"):
        assert all(len(curves(axes)) == 2 for axes in drawn[name].axes if axes.axison)
        assert "other" in [text.get_text() for text in drawn[name].legends[0].get_texts()]


@pytest.mark.parametrize("robot", ["acrobat"])
def test_one_joint(root: Path, tmp_path: Path, robot: str) -> None:
    plan = flight(root, robot)
    assert len(save_figures(plan, tmp_path, formats=("svg",))) == len(ALWAYS)
    drawn = figures(plan)
    assert len(curves(only(drawn["configuration"]))) == len(plan.robot.joints) + 1
    assert len(curves(only(drawn["torques"]))) == len(plan.robot.joints)
    names = [text.get_text() for text in drawn["configuration"].legends[0].get_texts()]
    assert names == ["orientation", *plan.robot.joints, "goal"]


def test_curves_hold_the_plan_s_numbers(handstand: fp.Plan, drawn: dict[str, Figure]) -> None:
    state = handstand.at(np.linspace(0, handstand.duration, SAMPLES))
    expected = {
        "configuration": np.rad2deg(np.column_stack((state.orientation, state.positions))),
        "torques": state.torques,
        "rates": np.column_stack((state.velocities, state.orientation_rate)),
    }
    for name, columns in expected.items():
        lines = [line for axes in drawn[name].axes for line in curves(axes)]
        assert len(lines) == columns.shape[1]
        for line, column in zip(lines, columns.T, strict=True):
            np.testing.assert_array_equal(line, np.column_stack((state.times, column)))


@pytest.mark.parametrize("robot", ["acrobat", "chain10"])
def test_momentum_is_what_its_curves_add_up_to(root: Path, robot: str) -> None:
    """D times the rates are the momenta of base and joints, whose sum is h; the interval (9) is the plan's own."""
    plan = flight(root, robot)
    drawn = figures(plan)
    base, joints, h = (line[:, 1] for line in curves(only(drawn["momentum"])))
    np.testing.assert_allclose(base + joints, h)
    np.testing.assert_allclose(h, plan.angular_momentum)
    panels = named_panels(drawn["inertia"])
    shown = [panels[name] for name in ("orientation", *plan.robot.joints)] if len(panels) > 1 else panels.values()
    inertia = np.stack([line[:, 1] for axes in shown for line in curves(axes)])
    state = plan.at(np.linspace(0, plan.duration, SAMPLES))
    np.testing.assert_allclose(inertia[0] * state.orientation_rate, base)
    np.testing.assert_allclose((inertia[1:] * state.velocities.T).sum(axis=0), joints, atol=1e-9)


def test_an_interval_for_h_is_drawn_where_it_is_near(handstand: fp.Plan) -> None:
    def drawn(low: float, high: float) -> tuple[set[float], str]:
        figure = figures(dataclasses.replace(handstand, angular_momentum_bounds=(low, high)))["momentum"]
        across = [line.get_ydata() for line in only(figure).lines if len(line.get_xdata()) == 2]
        return {float(ends[0]) for ends in across}, figure.legends[0].get_texts()[-1].get_text()

    assert drawn(-1.5, 0.5) == ({-1.5, 0.5, 0.0}, "h without turning back")
    assert drawn(-1e3, 0.5) == ({0.0}, "h without turning back: -1e+03 to 0.5")


def test_goals_are_marked_where_the_problem_has_them(handstand: fp.Plan, drawn: dict[str, Figure]) -> None:
    final = handstand.problem.final
    points = [line.get_xydata()[0] for line in only(drawn["configuration"]).lines if line.get_marker() == "o"]
    for angle in np.rad2deg([final.orientation, *final.positions]):
        assert any(np.allclose(point, (handstand.duration, angle)) for point in points)


def test_limits_are_drawn_where_they_are_near(hindered: fp.Plan) -> None:
    drawn = figures(hindered)
    state = hindered.at(np.linspace(0, hindered.duration, SAMPLES))
    limit = np.minimum(4.0, 5.0 - 0.2 * np.abs(state.velocities[:, 0]))
    torques = [line[:, 1] for line in curves(only(drawn["torques"]))]
    assert len(torques) == 2 + 2
    assert all(any(np.array_equal(line, sign * limit) for line in torques) for sign in (1, -1))
    rates = [line[:, 1] for axes in drawn["rates"].axes for line in curves(axes)]
    assert sum(np.ptp(line) == 0 for line in rates) == 4
    assert "limit" in [text.get_text() for text in drawn["torques"].legends[0].get_texts()]


def test_clearance_is_that_of_the_plan(hindered: fp.Plan, compared: dict[str, Figure]) -> None:
    times = np.linspace(0, hindered.duration, SAMPLES)
    each = [hindered.clearances(times, [obstacle]) for obstacle in hindered.problem.obstacles]
    np.testing.assert_array_equal(np.fmin.reduce(each), hindered.clearances(times))
    axes = only(compared["clearance"])
    lines = curves(axes)
    assert len(lines) == 2 * len(each)
    for distances in each:
        assert any(np.array_equal(line[:, 1], distances) for line in lines)
    heights = {float(line.get_ydata()[0]) for line in axes.lines if len(line.get_xdata()) == 2}
    assert heights == {obstacle.margin for obstacle in hindered.problem.obstacles}


def test_a_second_plan_is_dashed_on_the_same_axes(handstand: fp.Plan, somersault: fp.Plan) -> None:
    drawn = figures(handstand, compare=somersault)
    other = somersault.at(np.linspace(0, somersault.duration, SAMPLES))
    lines = only(drawn["torques"]).lines
    dashed = [line for line in lines if line.is_dashed() and len(line.get_xdata()) == SAMPLES]
    assert [line.get_ydata().tolist() for line in dashed] == other.torques.T.tolist()
    texts = [text.get_text() for text in drawn["torques"].legends[0].get_texts()]
    assert texts[-2:] == ["handstand", "somersault"]


def test_a_second_plan_for_other_joints_is_refused(root: Path, handstand: fp.Plan) -> None:
    with pytest.raises(InputError, match="compare"):
        figures(handstand, compare=flight(root, "acrobat"))


def test_axes_have_names_with_units(compared: dict[str, Figure]) -> None:
    for name, figure in compared.items():
        if name == "kinogram":
            assert any(text.get_text().endswith(" m") for text in only(figure).texts)
            continue
        for axes in figure.axes:
            assert axes.get_ylabel().endswith(")")
        assert figure.axes[-1].get_xlabel() in ("time (s)", "horizontal (m)")


def test_space_has_equal_scales_and_fits_a_column(compared: dict[str, Figure]) -> None:
    for name, figure in compared.items():
        assert figure.get_figwidth() == COLUMN
        if name in ("snapshots", "kinogram", "comparison"):
            assert only(figure).get_aspect() == 1


def test_links_are_drawn_where_they_are(handstand: fp.Plan, drawn: dict[str, Figure]) -> None:
    placed = postures(handstand, snapshot_times(handstand))
    assert abs(placed.takeoff[0]) < 1e-12
    assert abs(placed.landing[-1].imag) < 1e-9
    start, end = np.moveaxis(placed.corners, -1, 0)
    np.testing.assert_allclose(np.abs(end - start), np.tile([0.4, 0.4, 0.3], (len(placed.times), 1)))
    np.testing.assert_allclose(start[:, 1:], end[:, :-1], atol=1e-12)
    axes = only(drawn["snapshots"])
    robots = [each for each in axes.collections if isinstance(each, PolyCollection)]
    assert len(robots) == len(placed.times) + 1
    np.testing.assert_allclose(robots[-1].get_paths()[0].vertices[:-1], pairs(placed.outlines(-1)[0]))


def test_the_whole_robot_is_in_the_picture(somersault: fp.Plan) -> None:
    placed = postures(somersault, snapshot_times(somersault))
    axes = only(figures(somersault)["snapshots"])
    assert axes.get_xlim()[0] < placed.low.real.min()
    assert placed.high.real.max() < axes.get_xlim()[1]
    assert axes.get_ylim()[0] < placed.low.imag.min()
    assert placed.high.imag.max() < axes.get_ylim()[1]


def test_obstacles_are_drawn_with_their_margins(hindered: fp.Plan, compared: dict[str, Figure]) -> None:
    collections = [each for each in only(compared["snapshots"]).collections if isinstance(each, PolyCollection)]
    outlines = [np.asarray(path.vertices) for each in collections for path in each.get_paths()]

    def shown(obstacle: Obstacle, time: float, margin: float) -> bool:
        outline = pairs(obstacle_outlines(obstacle, time, margin)[0])
        return any(np.allclose(each[:-1], outline) for each in outlines if len(each) == len(outline) + 1)

    fixed, moving, ground, bar = hindered.problem.obstacles
    assert shown(fixed, 0.0, 0.0)
    assert shown(fixed, 0.0, 0.02)
    assert not shown(fixed, 0.0, 0.03)
    assert shown(ground, 0.0, 0.0)
    assert shown(bar, 0.2, 0.05)
    assert shown(moving, 0.0, 0.0)
    assert shown(moving, hindered.duration, 0.0)


def test_outlines_surround_what_they_outline() -> None:
    outline = stadium(1 + 1j, 3 + 2j, 0.25)
    along = 2 + 1j
    points = outline - (1 + 1j)
    share = np.clip((points * along.conjugate()).real / abs(along) ** 2, 0, 1)
    np.testing.assert_allclose(np.abs(points - share * along), 0.25)
    wall = obstacle_outlines(fp.HalfPlane(point=(1.0, 0.0), normal=(3.0, 4.0), velocity=(0.5, 0.0)), 2.0, 0.1)[0]
    heights = ((wall - 2.0) * (0.6 - 0.8j)).real
    assert heights.max() == pytest.approx(0.1)
    assert heights.min() < -100


def test_ground_is_drawn_where_the_robot_stands(root: Path, handstand: fp.Plan) -> None:
    placed = postures(handstand, np.linspace(0, handstand.duration, 9))
    ((height, _, _),) = ground_lines(placed)
    assert height == pytest.approx(-placed.radius.min(), abs=0.01)
    cat = fp.plan(fp.load_problem(root / "problems" / "falling_cat.toml"))
    assert ground_lines(postures(cat, np.linspace(0, cat.duration, 9))) == []


def test_postures_of_a_kinogram_stand_apart(somersault: fp.Plan) -> None:
    times = kinogram_times(somersault)
    assert len(times) % KINOGRAM.columns == 0
    np.testing.assert_allclose(np.diff(times), times[1])
    with styled():
        axes = only(kinogram(somersault))
    robots = [each for each in axes.collections if isinstance(each, PolyCollection)]
    boxes = [np.concatenate([path.vertices for path in each.get_paths()]) for each in robots]
    for row in range(0, len(times), KINOGRAM.columns):
        for left, right in zip(
            boxes[row : row + KINOGRAM.columns - 1], boxes[row + 1 : row + KINOGRAM.columns], strict=True
        ):
            assert left[:, 0].max() < right[:, 0].min()


def test_files_are_whole_and_repeat_to_the_byte(
    hindered: fp.Plan, handstand: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    paths = save_figures(hindered, tmp_path / "new", compare=handstand)
    names = [*ALWAYS, "clearance", "comparison"]
    assert [path.name for path in paths] == [f"{name}.{form}" for name in names for form in ("png", "svg")]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(path.name for path in paths)
    for path in paths:
        if path.suffix == ".png":
            with Image.open(path) as image:
                image.verify()
                assert image.width == round(300 * COLUMN)
        else:
            assert ElementTree.parse(path).getroot().tag.endswith("svg")
            assert b"<dc:date>" not in path.read_bytes()
    again = save_figures(hindered, tmp_path / "again", compare=handstand, formats=("svg",))
    for first, second in zip(paths[1::2], again, strict=True):
        assert first.read_bytes() == second.read_bytes()


def test_an_unknown_format_is_refused_before_anything_is_written(handstand: fp.Plan, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gif"):
        save_figures(handstand, tmp_path / "new", formats=("png", "gif"))
    assert not (tmp_path / "new").exists()


def test_names_are_printed_as_they_are(handstand: fp.Plan) -> None:
    robot = dataclasses.replace(handstand.robot, joints=("_left$knee", "$hip$"), motors=("_left$knee", "$hip$"))
    problem = dataclasses.replace(handstand.problem)
    object.__setattr__(problem, "robot", robot)
    figure = figures(dataclasses.replace(handstand, problem=problem))["torques"]
    figure.canvas.draw()
    assert [text.get_text().strip() for text in figure.legends[0].get_texts()] == ["_left$knee", "$hip$"]


def test_settings_of_matplotlib_stay_as_they_are(handstand: fp.Plan) -> None:
    before = dict(matplotlib.rcParams)
    figures(handstand)
    assert dict(matplotlib.rcParams) == before


def test_pyplot_is_never_imported(root: Path) -> None:
    """Nor by what is imported: pictures are drawn where it is not to be had, see above."""
    assert not [path for path in (root / "floatplan").rglob("*.py") if "pyplot" in path.read_text(encoding="utf-8")]


def test_colours_of_parts_differ() -> None:
    for count in (1, 3, len(OKABE_ITO), len(OKABE_ITO) + 1, 21):
        colours = palette(count)
        assert len({tuple(colour) for colour in colours}) == count


def test_a_sole_of_balls_is_drawn_from_heel_to_toe() -> None:
    """On the ground where they are, and as long; links of one ball, and balls of two links, are as they are."""
    heel, toe, radius = -0.05 - 0.048j, 0.12 - 0.048j, 0.005
    balls = [LinkCapsule("foot", 3, end, end, radius) for end in (heel, toe)]
    other = LinkCapsule("hand", 4, 0j, 0j, radius)
    (sole, hand) = rendered_capsules(Mock(shapes=(*balls, other)))
    assert hand is other
    assert sole.radius == pytest.approx(0.012)
    assert sole.start - sole.radius * (1 + 1j) == pytest.approx(heel - radius * (1 + 1j))
    assert sole.end + sole.radius * (1 - 1j) == pytest.approx(toe + radius * (1 - 1j))
