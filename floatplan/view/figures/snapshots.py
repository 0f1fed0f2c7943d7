"""Pictures of the moving robot: along the path of its centre of mass, side by side, and against another plan; jumps.

Side by side is the kinogram, read like text, for flights on one spot or of several rotations.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator

from floatplan.arrays import Array, ComplexArray
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.parts import Obstacle
from floatplan.problem.spatial_obstacles import Box
from floatplan.robot.shapes.capsules import convex_hull
from floatplan.view import outlines
from floatplan.view.jumps import footing
from floatplan.view.jumps import moments as moment_times
from floatplan.view.solids import CAMERA, obstacle_corners
from floatplan.view.style import COLUMN, PALETTE, faded, legend_above, new_figure, palette, round_below

FLATTEST = 0.45  # [-] height of a picture over its width, at least
TALLEST = 1.35  # [-] and at most: a picture fills neither a thin strip nor a page
DOT: dict[str, Any] = {"marker": "o", "linestyle": "none", "color": PALETTE.ink, "markeredgecolor": "white", "mew": 0.4}
ARROW = {"arrowstyle": "-|>,head_width=0.13,head_length=0.28", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}


@dataclass(frozen=True)
class KinogramLayout:
    """Postures side by side, in one column of a paper."""

    columns: int = 5
    rows: tuple[int, int] = (2, 4)  # fewest and most
    rotation: float = math.radians(60)  # [rad] of any body, from one posture to the next
    gap: float = 0.07  # [in] between neighbours
    caption: float = 0.19  # [in] for the line of text under a row
    rule: float = 0.16  # [in] for the scale under the last row


@dataclass(frozen=True)
class StripLayout:
    """Moments of a jump side by side, across both columns of a paper."""

    width: float = 2 * COLUMN + 0.3  # [in] of both columns with the gap between them
    gap: float = 0.12  # [-] between moments, in widths of the widest
    margin: float = 0.06  # [-] around them, in the same
    times: float = 0.22  # [in] for times under the ground
    legend: float = 0.25  # [in] for names above


KINOGRAM = KinogramLayout()
STRIP = StripLayout()


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
    if placed.depth is not None:
        floor = [outlines.pairs(CAMERA(line)) for line in outlines.grids(plan)]
        axes.add_collection(LineCollection(floor, colors=[PALETTE.pale], linewidths=0.6, zorder=0.6), autolim=False)
        higher_ground = outlines.platform(plan)
        if higher_ground is not None:
            _draw_platform(axes, higher_ground)
    step = outlines.ground_step(plan)
    if step is not None:
        axes.add_patch(_platform(*step))
    lines = outlines.ground_lines(plan, placed)
    for height, low, high in lines:
        if len(lines) == 1:
            axes.axhline(height, color=PALETTE.ink, linewidth=0.9, zorder=1)
        else:
            reach = 0.15 * (high - low).real
            axes.add_line(Line2D([low.real - reach, high.real + reach], [height] * 2, color=PALETTE.ink, linewidth=0.9))


def _platform(low: complex, high: complex) -> Rectangle:
    """Higher ground between two corners, m."""
    size = high - low
    look: dict[str, Any] = {
        "facecolor": faded(PALETTE.pale, 0.5),
        "edgecolor": PALETTE.ink,
        "linewidth": 0.9,
        "zorder": 0.5,
    }
    return Rectangle((low.real, low.imag), size.real, size.imag, **look)


def _draw_platform(axes: Axes, box: Box, shift: complex = 0j) -> None:
    """Draw higher ground in space as the camera sees it, moved in the picture, m: its outline, and its top."""
    corners = obstacle_corners(box)
    top = corners[corners[:, 2] > box.center[2]]
    faces = [outlines.pairs(convex_hull(CAMERA(points)) + shift) for points in (corners, top)]
    colours = [PALETTE.pale, faded(PALETTE.pale, 0.5)]
    look: dict[str, Any] = {"facecolors": colours, "edgecolors": [PALETTE.ink], "linewidths": 0.6}
    axes.add_collection(PolyCollection(faces, zorder=0.7, **look), autolim=False)


def draw_obstacle(axes: Axes, obstacle: Obstacle, times: Array) -> None:
    """Draw an obstacle and its margin at some instants (K,), s, from light to full where there are several."""
    strengths = 0.35 + 0.65 * np.arange(1, len(times) + 1) / len(times)
    for strength, time in zip(strengths, times, strict=True):
        look: dict[str, Any] = {"edgecolors": [faded(PALETTE.ink, strength)], "linewidths": 0.6}
        body = list(map(outlines.pairs, outlines.obstacle_outlines(obstacle, time, 0.0)))
        solid = PolyCollection(body, facecolors=[faded("#9a9a9a", strength)], zorder=1.5, **look)
        axes.add_collection(solid, autolim=False)
        if obstacle.margin > 0:
            ring = list(map(outlines.pairs, outlines.obstacle_outlines(obstacle, time, obstacle.margin)))
            look |= {"facecolors": "none", "linestyles": [(0, (2, 1.5))]}
            axes.add_collection(PolyCollection(ring, zorder=90, **look), autolim=False)


def draw_flight(axes: Axes, plan: Plan, placed: outlines.Postures, strengths: Sequence[float] | None = None) -> None:
    """Draw path, postures and goal onto axes in metres."""
    count = len(placed.times)
    draw_path(axes, plan, placed)
    goal = outlines.posture_at(plan, plan.problem.final, plan.duration)
    draw_posture(axes, goal, 0, strength=0.0, zorder=3 + count - 1.5, rings=((PALETTE.ink, 4.6), ("white", 3.2)))
    for index, strength in enumerate(strengths or np.linspace(0.30, 1, count)):  # the first is the palest
        rings = ((PALETTE.ink, 1.4),) if index == 0 else (("white", 1.0),)
        rings = rings if index < count - 1 else (("white", 2.4),)
        draw_posture(axes, placed, index, strength=strength, zorder=3 + index, rings=rings)


def draw_shadow(axes: Axes, placed: outlines.Postures, index: int, *, zorder: float, shift: complex = 0j) -> None:
    """Draw the shadow that a robot in space casts straight down on the ground, where there is one."""
    if placed.shadows is not None:
        hulls = [outlines.pairs(convex_hull(corners) + shift) for corners in placed.shadows[index]]
        look: dict[str, Any] = {"facecolors": [PALETTE.shadow], "edgecolors": [PALETTE.shadow], "linewidths": 0.4}
        axes.add_collection(PolyCollection(hulls, zorder=zorder, **look), autolim=False)


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
    colours = palette(int(placed.segment.max()) + 1)
    fills = [faded(colours[segment] if colour is None else colour, strength) for segment in placed.segment]
    polygons = []  # outline, colour and width of the line around it
    for ring, width in rings:
        polygons += [(link, faded(ring, 1.0), width) for link in links]
    for shape, faces, lights in placed.painted(index):
        polygons.append((links[shape], fills[shape], 0.0))
        if strength:
            polygons += [(face, fill, 0.2) for face, fill in zip(faces, lit(fills[shape], lights), strict=True)]
    mark = 0.95 * float(placed.radius.min())  # [m] full where it lands, hollow where it takes off; within its link
    takeoff = complex(placed.takeoff[index])
    landing = complex(placed.landing[index])
    for position, fill, size in (
        (landing, PALETTE.ink, mark),
        (takeoff, PALETTE.ink, mark),
        (takeoff, "white", 0.6 * mark),
    ):
        polygons.append((outlines.stadium(position, position, size), faded(fill, max(strength, 0.5)), 0.0))
    shapes, fills_of_shapes, widths = zip(*polygons, strict=True)
    shifted = [outlines.pairs(shape + shift) for shape in shapes]
    look: dict[str, Any] = dict.fromkeys(("facecolors", "edgecolors"), np.array(fills_of_shapes))  # a list takes longer
    axes.add_collection(
        PolyCollection(shifted, zorder=zorder, joinstyle="round", linewidths=widths, **look), autolim=False
    )


def lit(colour: Array, lights: Array) -> Array:
    """A colour (3,) as it is where so much light (N,) falls on it, 0 to 1: (N, 3), darker, or with white in it."""
    shade = 0.55 + lights[:, None]  # without light a little more than half of a colour remains
    return np.where(shade <= 1, colour * shade, 1 - (2 - shade) * (1 - colour))


def draw_path(axes: Axes, plan: Plan, placed: outlines.Postures) -> None:
    """Draw the path of the centre of mass, with a dot per snapshot."""
    com = outlines.com_path(plan, np.linspace(0, plan.duration, 129))
    axes.plot(com.real, com.imag, color=PALETTE.grey, linewidth=0.7, zorder=2)
    axes.plot(placed.com.real, placed.com.imag, markersize=2.6, zorder=80, **DOT)


def spatial_figure(low: complex, high: complex) -> tuple[Figure, Axes]:
    """Return a figure whose axes hold a box, m, at equal scales, widened to a shape that suits a column."""
    middle = (low + high) / 2
    narrow = (high - low).real
    low_height = (high - low).imag
    width = max(narrow, low_height / TALLEST)
    height = max(low_height, FLATTEST * narrow)
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
    """Draw the directions of the world's axes, and a length, instead of the axes of the paper."""
    axes.set_axis_off()
    left, right = axes.get_xlim()
    low = axes.get_ylim()[0]
    width = right - left
    size = 0.075 * width  # a corner of the picture that the robot seldom reaches
    middle = complex(left, low) + size * (1 + 0.6j)
    for name, direction in zip("xyz", np.eye(3), strict=True):
        tip = middle + size * complex(CAMERA(direction))
        axes.annotate(
            "",
            (tip.real, tip.imag),
            (middle.real, middle.imag),
            arrowprops={**ARROW, "color": PALETTE.ink, "linewidth": 0.7},
        )
        label = middle + 1.3 * (tip - middle)
        axes.text(label.real, label.imag, name, ha="center", va="center", size=6.5)
    _draw_rule(axes, round_below(width / 5), complex(right - 0.33 * width, low + 0.4 * size), 0.15 * size)


def frame_box(axes: Axes, low: complex, high: complex) -> None:
    """Let axes show a box, m, at equal scales."""
    axes.set(xlim=(low.real, high.real), ylim=(low.imag, high.imag))
    axes.set_aspect("equal")


def key(figure: Figure, plan: Plan, spacing: float) -> None:
    """Explain the marks of a picture above it."""
    takeoff = plan.problem.takeoff.frame
    landing = plan.problem.landing.frame
    frame: dict[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 3.6, "mew": 0.6, "mec": PALETTE.ink}
    path = Line2D(
        [], [], color=PALETTE.grey, linewidth=0.7, marker="o", markersize=2.6, markerfacecolor=PALETTE.ink, mew=0
    )
    entries: list[tuple[Any, str]] = [(path, f"CM every {spacing:.2g} s")]
    entries.append((Line2D([], [], markerfacecolor="white", **frame), takeoff))
    if landing != takeoff:
        entries.append((Line2D([], [], markerfacecolor=PALETTE.ink, **frame), landing))
    legend_above(figure, [*entries, (Patch(facecolor="white", edgecolor=PALETTE.ink, linewidth=0.8), "goal")])


def plan_names(plan: Trajectory, compare: Trajectory) -> tuple[str, str]:
    """Return names that distinguish two plans: with and without obstacles, or their problems' names."""
    is_obstructed = len(plan.problem.obstacles) > 0
    if is_obstructed != (len(compare.problem.obstacles) > 0):
        names = "with obstacle", "without obstacle"
        return names if is_obstructed else (names[1], names[0])
    if plan.problem.name != compare.problem.name:
        return plan.problem.name, compare.problem.name
    return "this plan", "other plan"


def comparison(plan: Plan, compare: Plan) -> Figure:
    """Draw a plan and, in black, the other plan's robot where that is deepest in an obstacle or its margin.

    Both robots are shown at that instant, this plan's in full colour over its own faint snapshots, and the picture
    contains them and the obstacle. Where the other plan meets none it is the middle of the flight.
    """
    time, obstacle = worst_passage(plan, compare)
    placed = outlines.postures(plan, outlines.snapshot_times(plan))
    own = outlines.postures(plan, np.array([time]))
    other = replace(outlines.postures(compare, np.array([time])), radius=own.radius)
    shown = obstacle if obstacle is not None and obstacle.bounded else None
    passed = [] if shown is None else outlines.obstacle_outlines(shown, time, shown.margin)
    near = np.concatenate((own.low, own.high, other.low, other.high, *passed))
    figure, axes = spatial_figure(*outlines.box_around(near, 0.12))  # a close-up of the passage
    draw_surroundings(axes, plan, placed, time)
    draw_flight(axes, plan, placed, strengths=[0.3] * len(placed.times))
    draw_path(axes, compare, other)
    draw_posture(axes, other, 0, strength=1.0, zorder=70, rings=(("white", 1.6),), colour=PALETTE.ink)
    draw_posture(axes, own, 0, strength=1.0, zorder=71, rings=(("white", 1.6),))
    names = plan_names(plan, compare)
    colours = tuple(Patch(facecolor=colour) for colour in palette(int(own.segment.max()) + 1))
    legend_above(figure, [(colours, f"{names[0]}, at {time:.2f} s"), (Patch(facecolor=PALETTE.ink), names[1])])
    return figure


def worst_passage(plan: Plan, compare: Plan) -> tuple[float, Obstacle | None]:
    """Return when the other plan is deepest in an obstacle of this one or its margin, s, and which; or mid-flight."""
    duration = min(plan.duration, compare.duration)
    times = np.linspace(0, duration, 513)
    # 1 mm: standing on the ground is not running into it
    worst: tuple[float, float, Obstacle | None] = (-1e-3, duration / 2, None)
    for obstacle in plan.problem.obstacles:
        depth = compare.clearances(times, [obstacle]) - obstacle.margin
        if depth.min() < worst[0]:
            worst = float(depth.min()), float(times[depth.argmin()]), obstacle
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
    columns = KINOGRAM.columns
    left = -low[:, 0].reshape(-1, columns)
    right = high[:, 0].reshape(-1, columns)
    widest = max(float((right[:, :-1] + left[:, 1:]).max()), 2 * float(left[:, 0].max()), 2 * float(right[:, -1].max()))
    scale = widest * columns / (COLUMN - KINOGRAM.gap * columns)  # m per inch of paper
    pitch = COLUMN * scale / columns  # m from one to the next
    above = high[:, 1].reshape(-1, columns).max(axis=1) + KINOGRAM.gap / 2 * scale
    below = low[:, 1].reshape(-1, columns).min(axis=1) - KINOGRAM.gap / 2 * scale
    tops = -np.cumsum([0.0, *(above - below + KINOGRAM.caption * scale)])
    height = KINOGRAM.rule * scale - float(tops[-1])
    figure = new_figure(COLUMN, height / scale)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    frame_box(axes, -1j * height, complex(COLUMN * scale))
    axes.set_axis_off()
    last = len(placed.times) - 1
    for index, time in enumerate(placed.times):
        row, column = divmod(index, columns)
        centre = complex((column + 0.5) * pitch, tops[row] - above[row])
        if index == last:
            rings = ((PALETTE.ink, 3.6), ("white", 2.4))
            draw_posture(axes, goal, 0, strength=0.0, zorder=3, rings=rings, shift=centre - complex(goal.com[0]))
        ring = (PALETTE.ink, 1.2) if index == 0 else ("white", 0.8)
        shift = centre - complex(placed.com[index])
        draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(ring,), shift=shift)
        axes.plot(centre.real, centre.imag, markersize=2.2, zorder=5, **DOT)
        caption = centre.imag + below[row] - 0.03 * scale
        axes.text(centre.real, caption, f"{time:.2f} s", ha="center", va="top", size=6.5)
    _draw_rule(axes, round_below(0.9 * pitch), complex(0.1, 0.07) * scale - 1j * height, 0.025 * scale)
    return figure


def kinogram_times(plan: Plan) -> Array:
    """Instants (K,) evenly spaced in time that fill two to four rows: the more the robot rotates, the more."""
    times = np.linspace(0, plan.duration, 129)
    rotation = float(outlines.turns(plan, times).sum(axis=0).max())
    rows = int(np.clip(math.ceil(rotation / KINOGRAM.rotation / KINOGRAM.columns), *KINOGRAM.rows))
    return np.linspace(0, plan.duration, rows * KINOGRAM.columns)


def _draw_rule(axes: Axes, length: float, begin: complex, tick: float) -> None:
    """Draw a scale of a round length from a position, m."""
    left = begin.real
    height = begin.imag
    axes.plot([left, left + length], [height, height], color=PALETTE.ink, linewidth=0.8, solid_capstyle="butt")
    for end in (left, left + length):
        axes.plot([end, end], [height - tick, height + tick], color=PALETTE.ink, linewidth=0.8)
    axes.text(left + length + 2 * tick, height, f"{length:g} m", ha="left", va="center", size=6.5)


def moments(jump: JumpMotion, flying: int = 2, title: str = "") -> Figure:
    """Draw moments of a jump, ``flying`` in each flight, from left to right over the ground, with forces and times."""
    placed = outlines.postures(jump, moment_times(jump, flying))
    stood = _ground_points(jump, placed)
    left_of_cones, right_of_cones = _sides_of_cones(jump, placed.times, stood)
    left = np.minimum(np.real(placed.low - stood), left_of_cones)
    right = np.maximum(np.real(placed.high - stood), right_of_cones)
    widest = float(np.max(right - left))
    margin = STRIP.margin * widest
    centres = np.cumsum(np.append(margin - left[0], right[:-1] - left[1:] + STRIP.gap * widest))
    ground = float(placed.low.imag.min()) if placed.shadows is None else 0.0
    shifts = np.asarray(centres + 1j * ground - stood, np.complex128)
    width = float((centres + right).max()) + margin
    nearest = ground if placed.shadows is None else _ends_of_shadows(placed, shifts)[0] - margin
    low = 1j * (nearest - STRIP.times * width / STRIP.width)
    high = complex(width, float((placed.high + shifts).imag.max()) + margin)
    figure = new_figure(STRIP.width, STRIP.legend * (2 if title else 1) + STRIP.width * (high - low).imag / width)
    axes = figure.add_subplot()
    frame_box(axes, low, high)
    axes.set_axis_off()
    axes.set_title(title, loc="left")
    if placed.shadows is None:
        axes.axhspan(low.imag, ground, color=PALETTE.pale, alpha=0.5, linewidth=0, zorder=0)
        axes.axhline(ground, color=PALETTE.ink, linewidth=0.9, zorder=1)
    else:
        farthest = _ends_of_shadows(placed, shifts)[1] + margin
        axes.axhspan(low.imag, farthest, color=PALETTE.pale, alpha=0.3, linewidth=0, zorder=0)
    com = outlines.com_positions(jump, placed.times)
    around = 0.6 * outlines.robot_size(jump)  # [m] of higher ground next to a moment
    for index, (time, centre) in enumerate(zip(placed.times, centres, strict=True)):
        draw_shadow(axes, placed, index, zorder=0.9, shift=shifts[index])
        if placed.shadows is not None:
            higher_ground = outlines.platform(jump, (com[index] - around, com[index] + around))
            if higher_ground is not None:
                _draw_platform(axes, higher_ground, shifts[index])
        elif jump.step is not None and jump.step.above_low(placed.com[index].real) > 0:
            height = jump.step.high - jump.step.low
            axes.add_patch(
                _platform(centre + left[index] + 1j * ground, centre + right[index] + 1j * (ground + height))
            )
        draw_posture(axes, placed, index, strength=1.0, zorder=4, rings=(("white", 1.0),), shift=shifts[index])
        axes.text(centre, low.imag, f"{time:.2f} s", ha="center", va="bottom", size=6.5)
    draw_forces(axes, jump, placed.times, shifts)
    standing = footing(jump)
    entries: list[tuple[Any, str]] = [(Patch(color=colour), f"on {name}") for name, colour in standing.colours.items()]
    legend_above(figure, [*entries, (Patch(alpha=0.0), standing.scale)])
    return figure


def _ground_points(jump: JumpMotion, placed: outlines.Postures) -> ComplexArray:
    """Positions (K,), m, on the ground below the centre of mass at the times of postures."""
    if placed.shadows is None:
        return np.asarray(placed.com.real + 1j * placed.low.imag.min())
    below = outlines.com_positions(jump, placed.times).copy()
    below[:, 2] = jump.ground
    return CAMERA(below)


def _sides_of_cones(jump: JumpMotion, times: Array, stood: ComplexArray) -> tuple[Array, Array]:
    """How far friction cones reach to the left and right of positions (K,), m; nowhere where nothing stands."""
    standing = footing(jump)
    stands = np.isfinite(standing.forces(times))
    feet = np.real(standing.feet(times) - stood[:, None])
    cone = standing.cone.real
    left = np.where(stands, feet + cone.min(), np.inf).min(axis=1)
    right = np.where(stands, feet + cone.max(), -np.inf).max(axis=1)
    return left, right


def _ends_of_shadows(placed: outlines.Postures, shifts: ComplexArray) -> tuple[float, float]:
    """Lowest and highest position of shadows in the picture, moved by shifts (K,), m."""
    assert placed.shadows is not None
    heights = (placed.shadows + shifts[:, None, None]).imag
    return float(heights.min()), float(heights.max())


def draw_forces(axes: Axes, jump: JumpMotion, times: Array, shifts: ComplexArray) -> None:
    """Draw the forces on what stands at times (K,), s, and their friction cones, moved by shifts (K,), m."""
    standing = footing(jump)
    feet = standing.feet(times) + shifts[:, None]
    pushes = standing.metres_per_newton * standing.forces(times)
    outline = withStroke(linewidth=2.8, foreground="white")
    for index, colour in enumerate(standing.colours.values()):
        for foot, push in zip(feet[:, index], pushes[:, index], strict=True):
            if np.isfinite(push):
                cone = outlines.pairs(foot + standing.cone).T
                axes.fill(*cone, color=colour, alpha=0.2, linewidth=0, zorder=3.5, clip_on=False)
            if abs(push) > 0.01:  # [m] shorter arrows would be all head
                look = {**ARROW, "color": colour, "path_effects": [outline]}
                axes.annotate("", (*outlines.pairs(foot + push),), (*outlines.pairs(foot),), arrowprops=look, zorder=6)
