"""Draws the pictures of the documentation into docs/images/. Run it from anywhere; it plans what it draws.

``scripts/make_images.py studies`` draws the maps of docs/studies.md instead: minutes, unless ``runs/`` has their rows.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import floatplan as fp
from floatplan.arrays import Array, ComplexArray
from floatplan.files import write_atomically
from floatplan.stance.motion import JumpState
from floatplan.view.charts import charts
from floatplan.view.figures.figures import draw_panel, figures, sample
from floatplan.view.figures.snapshots import draw_flight, draw_posture, draw_surroundings, frame_box, plan_names
from floatplan.view.outlines import Postures, picture_box, placed_robot, postures, snapshot_times
from floatplan.view.style import ALARM, GREY, INK, PALE, new_figure, palette, styled

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
DPI = 220
SHEET_DPI = 150  # of several figures in one picture
COLOURS = 128  # of the PNG palettes: flat pictures need no more
NARROWEST = 0.5  # width of a flight over its height, so that its title fits
GALLERY = {
    "new_configuration": "new configuration",
    "somersault": "somersault",
    "high_jump": "high jump",
    "falling_cat": "falling cat, h = 0",
}


WIDTH = 7.6  # [in]
UNDER = 1.75  # [in] of curves under a jump's moments
GAP = 0.12  # [-] room between a jump's moments, in widths of the widest
FORCE = 0.16  # [-] length of a force of the robot's weight over the picture's height
SHORTEST_ARROW = 0.02  # [-] of that height
ARROW = {
    "arrowstyle": "-|>,head_width=0.12,head_length=0.25",
    "color": ALARM,
    "linewidth": 1.0,
    "shrinkA": 0,
    "shrinkB": 0,
}

SHOWN = {"obstacle": "obstacle", "go2": "gallery/go2"}
SHEET = (("configuration", "torques", "clearance"), ("rates", "snapshots"))


STUDIES = ("somersault", "weak_motors", "pole", "go2_flip")


def main() -> None:
    if sys.argv[1:] == ["studies"]:
        maps()
    else:
        pictures()


def maps() -> None:
    for name in STUDIES:
        study = fp.study(ROOT / "problems" / "studies" / f"{name}.toml", folder=ROOT / "runs" / name)
        print(f"{name}: {study.statuses}")
        write_atomically(IMAGES / f"study_{name}.png", (study.folder / "map.png").read_bytes())


def pictures() -> None:
    for name, problem in SHOWN.items():
        drawn = figures(plan_of(problem, prove=True))
        save(rendered(drawn["kinogram"]), IMAGES / f"kinogram_{name}.png")
        columns = [[rendered(drawn[figure], SHEET_DPI) for figure in column] for column in SHEET]
        save(sheet(columns), IMAGES / f"figures_{name}.png")
    with styled():
        save(rendered(jump_picture(jump_of("go2"))), IMAGES / "jump_go2.png")
        save(rendered(flight(plan_of("handstand"))), IMAGES / "handstand.png")
        save(rendered(flight(plan_of("obstacle"), without_obstacles("obstacle"))), IMAGES / "obstacle.png")
        save(rendered(gallery({title: plan_of(name) for name, title in GALLERY.items()})), IMAGES / "flights.png")


def plan_of(name: str, *, prove: bool = False) -> fp.Plan:
    plan = fp.plan(fp.load_problem(ROOT / "problems" / f"{name}.toml"), prove=prove)
    if not plan.ok:
        raise SystemExit(f"{name}: {plan.explanation}")
    return plan


def jump_of(name: str) -> fp.Jump:
    jump = fp.jump(ROOT / "problems" / "jumps" / f"{name}.toml")
    if not jump.ok:
        raise SystemExit(f"{name}: {jump.explanation}")
    return jump


def without_obstacles(name: str) -> fp.Plan:
    return fp.plan(replace(fp.load_problem(ROOT / "problems" / f"{name}.toml"), obstacles=()))


def flight(plan: fp.Plan, other: fp.Plan | None = None) -> Figure:
    """The flight at the left, its angles and torques at the right; those of another plan dashed."""
    figure = new_figure(7.6, 3.7)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1], wspace=0.06, hspace=0.08)
    draw_scene(figure.add_subplot(grid[:, 0]), plan)
    angles = figure.add_subplot(grid[0, 1])
    torques = figure.add_subplot(grid[1, 1], sharex=angles)
    sampled, beside = sample(plan), None if other is None else sample(other, plan)
    drawn = {chart.name: chart for chart in charts(sampled)}
    for axes, name in ((angles, "configuration"), (torques, "torques")):
        draw_panel(axes, drawn[name], drawn[name].panels[0], sampled, beside)
    angles.tick_params(labelbottom=False)
    torques.set(xlim=(0, plan.duration), xlabel="time (s)")
    names = ("orientation", *plan.robot.joints)
    handles = [Line2D([], [], color=colour) for colour in palette(len(names))]
    if other is not None:
        names += (plan_names(plan, other)[1],)
        handles.append(Line2D([], [], color=GREY, linestyle="--"))
    angles.legend(handles, names, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(len(names), 3))
    return figure


def gallery(plans: dict[str, fp.Plan]) -> Figure:
    """Flights side by side, each at its own scale and as wide as it needs."""
    boxes = [picture_box(plan, postures(plan, snapshot_times(plan))) for plan in plans.values()]
    widths = [max((high - low).real / (high - low).imag, NARROWEST) for low, high in boxes]
    figure = new_figure(7.6, 7.3 / sum(widths) + 0.25)
    for axes, (title, plan) in zip(row(figure, widths), plans.items(), strict=True):
        draw_scene(axes, plan)
        axes.set_title(title, fontsize=8)
    return figure


def row(figure: Figure, widths: Sequence[float]) -> Sequence[Axes]:
    grid = figure.add_gridspec(1, len(widths), width_ratios=widths, wspace=0.03)
    return [figure.add_subplot(grid[0, column]) for column in range(len(widths))]


def draw_scene(axes: Axes, plan: fp.Plan, times: Array | None = None) -> None:
    placed = postures(plan, snapshot_times(plan) if times is None else times)
    frame_box(axes, *picture_box(plan, placed))
    axes.set_axis_off()
    draw_surroundings(axes, plan, placed)
    draw_flight(axes, plan, placed)


def jump_picture(jump: fp.Jump) -> Figure:
    """A jump's moments, and under them the forces on its feet and what its torques take of their limits, over time."""
    placed = jump_postures(jump, jump_moments(jump, between=2, flying=5))
    height = strip_height(placed)
    figure = new_figure(WIDTH, height + UNDER)
    rows = figure.add_gridspec(2, 1, height_ratios=[height, UNDER], hspace=0.02)
    draw_jump(figure.add_subplot(rows[0, 0]), jump, placed)
    grid = rows[1, 0].subgridspec(1, 2)
    forces, torques = (figure.add_subplot(grid[0, column]) for column in range(2))
    times = np.linspace(0.0, jump.duration, 601)
    state, robot = jump.at(times), jump.problem.robot
    weight, colours = robot.mass * jump.problem.flight.gravity, palette(len(robot.joints) + 1)
    bodies = [shape.body for shape in robot.shapes]
    for contact in {contact.name: contact for stance in jump.stances for contact in stance.contacts}.values():
        force = sum(state.forces[each][:, 1] for each in contact.names) / weight
        colour = colours[placed.part[bodies.index(contact.spots[0].body)]]
        forces.plot(times, np.where(force > 0, force, np.nan), color=colour, label=", ".join(contact.names))
    shares = state.torques @ robot.transmission / jump.problem.motor_torque_limits
    for colour, joint in zip(colours[1:], robot.joints, strict=True):
        torques.plot(times, shares[:, robot.motors.index(joint)], color=colour, label=joint)
    forces.set(ylabel="vertical force / weight", ylim=(0, None))
    torques.set(ylabel="torque / limit", ylim=(-1, 1))
    for axes in (forces, torques):
        for phase in jump.phases:
            if phase.kind == "flight":
                axes.axvspan(phase.begin, phase.end, color=PALE, alpha=0.35, linewidth=0)
        axes.set(xlim=(0, jump.duration), xlabel="time (s); grey: in flight")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=6)
    return figure


def jump_moments(jump: fp.Jump, between: int, flying: int) -> Array:
    """Instants of a jump: standing, where contacts change, parts of the stances between, and parts of the flight."""
    moments = [0.0]
    for phase in jump.phases:
        count = flying if phase.kind == "flight" else between
        moments += np.linspace(phase.begin, phase.end, count + 1)[1:].tolist()
    return np.array(moments)


def jump_postures(jump: fp.Jump, times: Array) -> Postures:
    """The robot of a jump at times (K,), s."""
    robot, state = jump.problem.robot, jump.at(times)
    orientation, joints = _angles(jump, state)
    base = robot.tree.point_weights(np.array([0]), np.array([0j]))[0]
    rotations = robot.tree.rotations(robot.tree.absolute_angles(orientation, joints))
    com = state.positions[:, 0] + 1j * state.positions[:, 1] - rotations @ base
    return placed_robot(jump.problem, times, com, orientation, joints)


def strip_shifts(placed: Postures) -> ComplexArray:
    """Shifts (K,) m that put postures side by side, none touching its neighbours, at their heights."""
    low, high = (np.real(corner - placed.com) for corner in (placed.low, placed.high))
    room = GAP * float(np.max(high - low))
    centres = np.cumsum(np.append(0.0, high[:-1] - low[1:] + room))
    return np.asarray(centres - placed.com.real + 0j)


def strip_box(placed: Postures) -> tuple[complex, complex]:
    """Corners of a strip, m, with room for captions under the ground and forces."""
    shifts = strip_shifts(placed)
    low, high = placed.low + shifts, placed.high + shifts
    tall = float(high.imag.max() - low.imag.min())
    return complex(low.real.min() - 0.1 * tall, low.imag.min() - 0.15 * tall), complex(
        high.real.max() + 0.1 * tall, high.imag.max() + 0.04 * tall
    )


def strip_height(placed: Postures) -> float:
    """Height of a strip as wide as a page, in."""
    low, high = strip_box(placed)
    return WIDTH * (high - low).imag / (high - low).real


def draw_jump(axes: Axes, jump: fp.Jump, placed: Postures) -> None:
    """Draw a jump's moments from left to right over the ground, with the forces on its feet and times below."""
    shifts, (low, high) = strip_shifts(placed), strip_box(placed)
    frame_box(axes, low, high)
    axes.set_axis_off()
    ground = float(placed.low.imag.min())
    axes.axhspan(low.imag, ground, color=PALE, alpha=0.5, linewidth=0, zorder=0)
    axes.axhline(ground, color=INK, linewidth=0.9, zorder=1)
    ends = [phase.end for phase in jump.phases]
    stances = iter(jump.stances)
    standing = [None if phase.kind == "flight" else next(stances) for phase in jump.phases]
    state, robot = jump.at(placed.times), jump.problem.robot
    axes_of_plane = np.stack((robot.plane.horizontal, robot.plane.vertical))
    unit = FORCE * (high - low).imag / (robot.mass * jump.problem.flight.gravity)
    for index, time in enumerate(placed.times):
        draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(("white", 1.0),), shift=shifts[index])
        stance = standing[int(np.searchsorted(ends[:-1], time))]
        for contact in () if stance is None else stance.contacts:
            along, up = axes_of_plane @ state.points[contact.name][index]
            foot = complex(along + 1j * up + shifts[index])
            push = unit * sum(state.forces[name][index] for name in contact.names)
            if np.hypot(*push) > SHORTEST_ARROW * (high - low).imag:
                tip = (foot.real + push[0], foot.imag + push[1])
                axes.annotate("", tip, (foot.real, foot.imag), arrowprops=ARROW, zorder=6)
        at = float((placed.com[index] + shifts[index]).real)
        axes.text(at, low.imag, f"{time:.2f} s", ha="center", va="bottom", size=6)


def _angles(jump: fp.Jump, state: JumpState) -> tuple[Array, Array]:
    robot = jump.problem.robot
    return state.positions[:, 2], (state.positions - robot.reference) @ np.linalg.pinv(robot.selection).T


def rendered(figure: Figure, dpi: int = DPI) -> Image.Image:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    return Image.open(stream).convert("RGB")


def sheet(columns: Sequence[Sequence[Image.Image]]) -> Image.Image:
    """Pictures in columns."""
    widths = [max(picture.width for picture in column) for column in columns]
    whole = Image.new(
        "RGB", (sum(widths), max(sum(picture.height for picture in column) for column in columns)), "white"
    )
    for index, column in enumerate(columns):
        for row, picture in enumerate(column):
            whole.paste(picture, (sum(widths[:index]), sum(above.height for above in column[:row])))
    return whole


def save(picture: Image.Image, path: Path) -> None:
    content = io.BytesIO()
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(content, format="PNG", optimize=True)
    write_atomically(path, content.getvalue())
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
