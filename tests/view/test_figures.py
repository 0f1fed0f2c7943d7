import dataclasses
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

import floatplan as fp
from floatplan.errors import InputError
from floatplan.problem.parts import Obstacle
from floatplan.view.figures.figures import SAMPLES, figures, save_figures
from floatplan.view.outlines import (
    obstacle_outlines,
    pairs,
)
from floatplan.view.style import COLUMN

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


def named_panels(figure: Figure) -> dict[str, Axes]:
    return {axes.get_title("left"): axes for axes in figure.axes if axes.axison}


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


@pytest.mark.parametrize("robot", ["acrobat", pytest.param("chain10", marks=pytest.mark.long)])
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


def test_a_second_plan_for_other_joints_is_refused(root: Path, handstand: fp.Plan) -> None:
    with pytest.raises(InputError, match="compare"):
        figures(handstand, compare=flight(root, "acrobat"))


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


@pytest.mark.long
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
