"""Pictures of the moving robot: along the path of its centre of mass, side by side, and against another plan; jumps.

Side by side is the kinogram, read like text, for flights that stay in one place or turn over and over.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from floatplan.arrays import Array, ComplexArray
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.parts import Obstacle
from floatplan.view import outlines
from floatplan.view.jumps import footing
from floatplan.view.jumps import moments as moment_times
from floatplan.view.solids import CAMERA
from floatplan.view.style import COLUMN, GREY, INK, PALE, faded, legend_above, new_figure, palette, rgb, round_below

SOLID = "#9a9a9a"  # of obstacles
PALEST = 0.30  # [-] strength of the first snapshot's colours
MARK = 0.95  # [-] size of the dots on the frames that take off and land, in radii of the link
TOUCH = 1e-3  # [m] standing on the ground is not running into it
PASSAGE_SAMPLES = 513  # [-] instants among which the deepest penetration is sought
BACKGROUND = 0.3  # [-] strength of the snapshots behind the two robots compared
CLOSE_UP = 0.12  # [-] room around two robots compared and the obstacle, in sizes of their box
FLATTEST = 0.45  # [-] height of a picture over its width
TALLEST = 1.35
COLUMNS = 5  # [-] of the kinogram
ROWS = (2, 4)  # [-] fewest and most
TURN = math.radians(60)  # [rad] of any body against the ground, from one posture to the next
GAP = 0.07  # [in] between neighbours
CAPTION = 0.19  # [in] for the line of text under a row
RULE = 0.16  # [in] for the scale under the last row
DOT: dict[str, Any] = {"marker": "o", "linestyle": "none", "color": INK, "markeredgecolor": "white", "mew": 0.4}

WIDTH = 2 * COLUMN + 0.3  # [in] both columns of a paper
APART = 0.12  # [-] room between moments and around them, in widths of the widest
BESIDE = 0.06
TIMES = 0.22  # [in] for times under the ground, and for names above
LEGEND = 0.25
SHORTEST = 0.01  # [m] of an arrow
ARROW = {"arrowstyle": "-|>,head_width=0.13,head_length=0.28", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
DIRECTIONS = 0.075  # [-] length of the world's axes, in widths of the picture
SHADE = 0.55  # [-] of a colour where no light falls
RING = withStroke(linewidth=2.8, foreground="white")


def snapshots(plan: Plan) -> Figure:
    """Draw the robot along the path of its centre of mass, from light at takeoff to full colour at landing."""
    placed = outlines.postures(plan, outlines.snapshot_times(plan))
    low, high = outlines.picture_box(plan, placed)
    figure, axes = spatial_figure(low, high)
    if placed.depth is not None:
        draw_directions(axes)
    draw_surroundings(axes, plan, placed)
    draw_flight(axes, plan, placed)
    key(figure, plan, placed.times[1])
    return figure


def draw_surroundings(axes: Axes, plan: Plan, placed: outlines.Postures, instant: float | None = None) -> None:
    """Draw ground and obstacles onto axes in metres; obstacles that move at one instant, or several."""
    draw_ground(axes, plan, placed)
    for obstacle in plan.problem.obstacles:
        times = outlines.obstacle_times(obstacle, plan.duration) if instant is None else np.array([instant])
        draw_obstacle(axes, obstacle, times)


def draw_ground(axes: Axes, plan: Trajectory, placed: outlines.Postures) -> None:
    """Draw the ground line, through the whole picture where it is the same at takeoff and landing; in space a grid."""
    if isinstance(plan, Plan) and placed.depth is not None:
        floor = [outlines.pairs(CAMERA(line)) for line in outlines.floor(plan)]
        axes.add_collection(LineCollection(floor, colors=[PALE], linewidths=0.6, zorder=0.6), autolim=False)
    lines = outlines.ground_lines(placed)
    for height, low, high in lines:
        if len(lines) == 1:
            axes.axhline(height, color=INK, linewidth=0.9, zorder=1)
        else:
            reach = 0.15 * (high - low).real
            axes.add_line(Line2D([low.real - reach, high.real + reach], [height] * 2, color=INK, linewidth=0.9))


def draw_obstacle(axes: Axes, obstacle: Obstacle, times: Array) -> None:
    """Draw an obstacle and its margin at some instants (K,), s, from light to full where there are several."""
    for strength, time in zip(0.35 + 0.65 * np.arange(1, len(times) + 1) / len(times), times, strict=True):
        look: dict[str, Any] = {"edgecolors": [faded(INK, strength)], "linewidths": 0.6}
        body = [outlines.pairs(outline) for outline in outlines.obstacle_outlines(obstacle, time, 0.0)]
        solid = PolyCollection(body, facecolors=[faded(SOLID, strength)], zorder=1.5, **look)
        axes.add_collection(solid, autolim=False)
        if obstacle.margin > 0:
            ring = [outlines.pairs(outline) for outline in outlines.obstacle_outlines(obstacle, time, obstacle.margin)]
            look |= {"facecolors": "none", "linestyles": [(0, (2, 1.5))]}
            axes.add_collection(PolyCollection(ring, zorder=90, **look), autolim=False)


def draw_flight(axes: Axes, plan: Plan, placed: outlines.Postures, strengths: Sequence[float] | None = None) -> None:
    """Draw path, postures and goal onto axes in metres."""
    count = len(placed.times)
    draw_path(axes, plan, placed)
    goal = outlines.posture_at(plan, plan.problem.final, plan.duration)
    draw_posture(axes, goal, 0, strength=0.0, zorder=3 + count - 1.5, rings=((INK, 4.6), ("white", 3.2)))
    for index, strength in enumerate(strengths or np.linspace(PALEST, 1, count)):
        rings = ((INK, 1.4),) if index == 0 else (("white", 1.0),)
        rings = rings if index < count - 1 else (("white", 2.4),)
        draw_posture(axes, placed, index, strength=strength, zorder=3 + index, rings=rings)


def draw_posture(
    axes: Axes,
    placed: outlines.Postures,
    index: int,
    *,
    strength: float,
    zorder: float,
    rings: Sequence[tuple[Any, float]] = (),
    shift: complex = 0j,
    colour: Any = None,
) -> None:
    """Draw one posture: rings (colour, points of width) around the whole robot, its links, the two frames' marks."""
    links = placed.outlines(index)
    colours = palette(int(placed.part.max()) + 1)
    fills = [faded(colours[part] if colour is None else colour, strength) for part in placed.part]
    drawn = [(link, faded(ring, 1.0), width) for ring, width in rings for link in links]
    for each, seen in placed.painted(index):
        drawn.append((links[each], fills[each], 0.0))
        drawn += [(face, lit(fills[each], light), 0.2) for face, light in seen if strength]
    mark = MARK * float(placed.radius.min())  # full where it lands, hollow where it takes off
    takeoff = complex(placed.takeoff[index])
    landing = complex(placed.landing[index])
    for place, fill, size in ((landing, INK, mark), (takeoff, INK, mark), (takeoff, "white", 0.6 * mark)):
        drawn.append((outlines.stadium(place, place, size), faded(fill, max(strength, 0.5)), 0.0))
    shapes, faces, widths = zip(*drawn, strict=True)
    moved = [outlines.pairs(shape + shift) for shape in shapes]
    look: dict[str, Any] = {"facecolors": faces, "edgecolors": faces, "linewidths": widths, "joinstyle": "round"}
    axes.add_collection(PolyCollection(moved, zorder=zorder, **look), autolim=False)


def lit(colour: Any, light: float) -> Array:
    """A colour (3,) as it is where so much light falls on it, 0 to 1: darker, or with white in it."""
    shade = SHADE + light
    return rgb(colour) * shade if shade <= 1 else faded(colour, 2 - shade)


def draw_path(axes: Axes, plan: Plan, placed: outlines.Postures) -> None:
    """Draw the path of the centre of mass, with a dot per snapshot."""
    com = outlines.com_path(plan, np.linspace(0, plan.duration, 129))
    axes.plot(com.real, com.imag, color=GREY, linewidth=0.7, zorder=2)
    axes.plot(placed.com.real, placed.com.imag, markersize=2.6, zorder=80, **DOT)


def spatial_figure(low: complex, high: complex) -> tuple[Figure, Axes]:
    """Return a figure whose axes hold a box, m, at equal scales, widened to a shape that suits a column."""
    middle = (low + high) / 2
    width = (high - low).real
    height = (high - low).imag
    width, height = max(width, height / TALLEST), max(height, FLATTEST * width)
    figure = new_figure(COLUMN, 0.66 + (COLUMN - 0.5) * height / width)
    axes = figure.add_subplot()
    frame_box(axes, middle - complex(width, height) / 2, middle + complex(width, height) / 2)
    axes.grid(False)
    step = round_below(max(width, height) / 4)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    axes.set(xlabel="horizontal (m)", ylabel="vertical (m)")
    return figure, axes


def draw_directions(axes: Axes) -> None:
    """Draw where the world's axes point, and a length, in place of the axes of the paper."""
    axes.set_axis_off()
    (left, right) = axes.get_xlim()
    low = axes.get_ylim()[0]
    size = DIRECTIONS * (right - left)
    corner = complex(left, low)
    middle = corner + size * (1 + 0.6j)
    for name, direction in zip("xyz", np.eye(3), strict=True):
        tip = middle + size * complex(CAMERA(direction))
        axes.annotate(
            "", (tip.real, tip.imag), (middle.real, middle.imag), arrowprops={**ARROW, "color": INK, "linewidth": 0.7}
        )
        label = middle + 1.3 * (tip - middle)
        axes.text(label.real, label.imag, name, ha="center", va="center", size=6.5)
    _draw_rule(
        axes, round_below((right - left) / 5), complex(right - 0.33 * (right - left), low + 0.4 * size), 0.15 * size
    )


def frame_box(axes: Axes, low: complex, high: complex) -> None:
    """Let axes show a box, m, at equal scales."""
    axes.set(xlim=(low.real, high.real), ylim=(low.imag, high.imag))
    axes.set_aspect("equal")


def key(figure: Figure, plan: Plan, spacing: float) -> None:
    """Tell above a picture what its marks mean."""
    takeoff = plan.problem.takeoff.frame
    landing = plan.problem.landing.frame
    frame: dict[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 3.6, "mew": 0.6, "mec": INK}
    path = Line2D([], [], color=GREY, linewidth=0.7, marker="o", markersize=2.6, markerfacecolor=INK, mew=0)
    entries: list[tuple[Any, str]] = [(path, f"CM every {spacing:.2g} s")]
    entries.append((Line2D([], [], markerfacecolor="white", **frame), takeoff))
    if landing != takeoff:
        entries.append((Line2D([], [], markerfacecolor=INK, **frame), landing))
    legend_above(figure, [*entries, (Patch(facecolor="white", edgecolor=INK, linewidth=0.8), "goal")])


def plan_names(plan: Trajectory, compare: Trajectory) -> tuple[str, str]:
    """Return names that distinguish two plans: with and without obstacles, or their problems' names."""
    many = len(plan.problem.obstacles)
    few = len(compare.problem.obstacles)
    if (many > 0) != (few > 0):
        names = "with obstacle", "without obstacle"
        return names if many else (names[1], names[0])
    if plan.problem.name != compare.problem.name:
        return plan.problem.name, compare.problem.name
    return "this plan", "other plan"


def comparison(plan: Plan, compare: Plan) -> Figure:
    """Draw a plan and, in black, the other plan's robot where that is deepest in an obstacle or its margin.

    Both robots are drawn at that instant, this plan's in full colour over its own faint snapshots, and the picture
    holds them and the obstacle. Where the other plan meets none it is the middle of the flight.
    """
    time, obstacle = worst_passage(plan, compare)
    placed = outlines.postures(plan, outlines.snapshot_times(plan))
    own = outlines.postures(plan, np.array([time]))
    other = replace(outlines.postures(compare, np.array([time])), radius=own.radius)
    shown = obstacle if obstacle is not None and obstacle.bounded else None
    passed = [] if shown is None else outlines.obstacle_outlines(shown, time, shown.margin)
    near = np.concatenate((own.low, own.high, other.low, other.high, *passed))
    figure, axes = spatial_figure(*outlines.box_around(near, CLOSE_UP))
    draw_surroundings(axes, plan, placed, time)
    draw_flight(axes, plan, placed, strengths=[BACKGROUND] * len(placed.times))
    draw_path(axes, compare, other)
    draw_posture(axes, other, 0, strength=1.0, zorder=70, rings=(("white", 1.6),), colour=INK)
    draw_posture(axes, own, 0, strength=1.0, zorder=71, rings=(("white", 1.6),))
    names = plan_names(plan, compare)
    colours = tuple(Patch(facecolor=colour) for colour in palette(int(own.part.max()) + 1))
    legend_above(figure, [(colours, f"{names[0]}, at {time:.2f} s"), (Patch(facecolor=INK), names[1])])
    return figure


def worst_passage(plan: Plan, compare: Plan) -> tuple[float, Obstacle | None]:
    """Return when the other plan is deepest in an obstacle of this one or its margin, s, and which; or mid-flight."""
    duration = min(plan.duration, compare.duration)
    times = np.linspace(0, duration, PASSAGE_SAMPLES)
    worst: tuple[float, float, Obstacle | None] = (-TOUCH, duration / 2, None)
    for obstacle in plan.problem.obstacles:
        left = compare.clearances(times, [obstacle]) - obstacle.margin
        if left.min() < worst[0]:
            worst = float(left.min()), float(times[left.argmin()]), obstacle
    return worst[1:]


def kinogram(plan: Plan) -> Figure:
    """Draw postures at even steps in time, side by side in rows; the centre of mass always on a row's line.

    They stand so near one another that none touches its neighbours.
    """
    placed = outlines.postures(plan, kinogram_times(plan))
    goal = outlines.posture_at(plan, plan.problem.final, plan.duration)
    low = outlines.pairs(placed.low - placed.com)
    high = outlines.pairs(placed.high - placed.com)
    low[-1] = np.minimum(low[-1], outlines.pairs(goal.low - goal.com))
    high[-1] = np.maximum(high[-1], outlines.pairs(goal.high - goal.com))
    left = -low[:, 0].reshape(-1, COLUMNS)
    right = high[:, 0].reshape(-1, COLUMNS)
    widest = max(float((right[:, :-1] + left[:, 1:]).max()), 2 * float(left[:, 0].max()), 2 * float(right[:, -1].max()))
    scale = widest * COLUMNS / (COLUMN - GAP * COLUMNS)  # m per inch of paper
    pitch = COLUMN * scale / COLUMNS  # m from one to the next
    above = high[:, 1].reshape(-1, COLUMNS).max(axis=1) + GAP / 2 * scale
    below = low[:, 1].reshape(-1, COLUMNS).min(axis=1) - GAP / 2 * scale
    tops = -np.cumsum([0.0, *(above - below + CAPTION * scale)])
    height = RULE * scale - float(tops[-1])
    figure = new_figure(COLUMN, height / scale)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    frame_box(axes, -1j * height, complex(COLUMN * scale))
    axes.set_axis_off()
    last = len(placed.times) - 1
    for index, time in enumerate(placed.times):
        row, column = divmod(index, COLUMNS)
        centre = complex((column + 0.5) * pitch, tops[row] - above[row])
        if index == last:
            rings = ((INK, 3.6), ("white", 2.4))
            draw_posture(axes, goal, 0, strength=0.0, zorder=3, rings=rings, shift=centre - complex(goal.com[0]))
        ring = (INK, 1.2) if index == 0 else ("white", 0.8)
        shift = centre - complex(placed.com[index])
        draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(ring,), shift=shift)
        axes.plot(centre.real, centre.imag, markersize=2.2, zorder=5, **DOT)
        caption = centre.imag + below[row] - 0.03 * scale
        axes.text(centre.real, caption, f"{time:.2f} s", ha="center", va="top", size=6.5)
    _draw_rule(axes, round_below(0.9 * pitch), complex(0.1, 0.07) * scale - 1j * height, 0.025 * scale)
    return figure


def kinogram_times(plan: Plan) -> Array:
    """Instants (K,) evenly spaced in time that fill two to four rows: the more the robot turns, the more."""
    times = np.linspace(0, plan.duration, 129)
    turned = float(outlines.turns(plan, times).sum(axis=0).max())
    rows = int(np.clip(math.ceil(turned / TURN / COLUMNS), *ROWS))
    return np.linspace(0, plan.duration, rows * COLUMNS)


def _draw_rule(axes: Axes, length: float, begin: complex, tick: float) -> None:
    """Draw a scale of a round length from a place, m."""
    left = begin.real
    height = begin.imag
    axes.plot([left, left + length], [height, height], color=INK, linewidth=0.8, solid_capstyle="butt")
    for end in (left, left + length):
        axes.plot([end, end], [height - tick, height + tick], color=INK, linewidth=0.8)
    axes.text(left + length + 2 * tick, height, f"{length:g} m", ha="left", va="center", size=6.5)


def moments(jump: JumpMotion, flying: int = 2, title: str = "") -> Figure:
    """Draw moments of a jump, ``4 + flying`` of them, from left to right over the ground, with forces and times."""
    placed = outlines.postures(jump, moment_times(jump, flying))
    left, right = (np.real(corner - placed.com) for corner in (placed.low, placed.high))
    widest = float(np.max(right - left))
    ground = float(placed.low.imag.min())
    centres = np.cumsum(np.append(BESIDE * widest - left[0], right[:-1] - left[1:] + APART * widest))
    shifts = np.asarray(centres - placed.com.real, np.complex128)
    width = float((centres + right).max()) + BESIDE * widest
    low = 1j * (ground - TIMES * width / WIDTH)
    high = complex(width, float(placed.high.imag.max()) + BESIDE * widest)
    figure = new_figure(WIDTH, LEGEND * (2 if title else 1) + WIDTH * (high - low).imag / width)
    axes = figure.add_subplot()
    frame_box(axes, low, high)
    axes.set_axis_off()
    axes.set_title(title, loc="left")
    axes.axhspan(low.imag, ground, color=PALE, alpha=0.5, linewidth=0, zorder=0)
    axes.axhline(ground, color=INK, linewidth=0.9, zorder=1)
    for index, (time, centre) in enumerate(zip(placed.times, centres, strict=True)):
        draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(("white", 1.0),), shift=shifts[index])
        axes.text(centre, low.imag, f"{time:.2f} s", ha="center", va="bottom", size=6.5)
    draw_forces(axes, jump, placed.times, shifts)
    standing = footing(jump)
    entries: list[tuple[Any, str]] = [(Patch(color=colour), f"on {name}") for name, colour in standing.colours.items()]
    legend_above(figure, [*entries, (Patch(alpha=0.0), standing.scale)])
    return figure


def draw_forces(axes: Axes, jump: JumpMotion, times: Array, shifts: ComplexArray) -> None:
    """Draw the forces on what stands at times (K,), s, and their friction cones, moved by shifts (K,), m."""
    standing = footing(jump)
    feet = standing.feet(times) + shifts[:, None]
    pushes = standing.metres_per_newton * standing.forces(times)
    for index, colour in enumerate(standing.colours.values()):
        for foot, push in zip(feet[:, index], pushes[:, index], strict=True):
            if np.isfinite(push):
                axes.fill(
                    *outlines.pairs(foot + standing.cone).T,
                    color=colour,
                    alpha=0.2,
                    linewidth=0,
                    zorder=3.5,
                    clip_on=False,
                )
            if abs(push) > SHORTEST:
                look = {**ARROW, "color": colour, "path_effects": [RING]}
                axes.annotate("", (*outlines.pairs(foot + push),), (*outlines.pairs(foot),), arrowprops=look, zorder=6)
