"""Shares of limits over time, measured where a motion was planned; and the curves below the scene, as HTML."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from html import escape
from typing import Any

import numpy as np

from floatplan.arguments import short
from floatplan.arrays import Array
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.problem import Problem
from floatplan.view.jumps import footing, limit_shares

NEARLY = 0.9  # [-] share of a limit from which a use is amber


class Colour(StrEnum):
    """Colours of the panel."""

    GREEN = "#1a7f4b"
    AMBER = "#985a00"
    RED = "#c0182b"
    BLUE = "#1f5fbf"
    GREY = "#7a7f87"
    BLACK = "#3a3f45"


@dataclass(frozen=True, eq=False)
class Shares:
    """Shares of the limits of one kind, over a motion, at even instants.

    Attributes
    ----------
    title : "torque" or "rate"
    unit : of the values where nothing limits
    limited : whether they are shares of limits
    names : of the motors or joints, each with a curve of its own
    values : (K, N) magnitudes
    """

    title: str
    unit: str
    limited: bool
    names: tuple[str, ...]
    values: Array

    @property
    def peak(self) -> float:
        """The largest."""
        return float(self.values.max(initial=0.0))


def shares(motion: Trajectory) -> tuple[Shares, ...]:
    """Shares of the limits on torque and rate that a motion uses: of the problem's, else of the URDF's, if any."""
    state = motion.state(np.linspace(0.0, motion.duration, 401))
    problem = _limited(motion.whole_problem)
    torque, rate = limit_shares(problem, state)
    motors = np.minimum(problem.motor_torque_limits, problem.motor_stall)
    return (
        _of_kind("torque", "N m", problem.robot.motors, motors, torque, state.motor_torques),
        _of_kind("rate", "rad/s", problem.robot.joints, problem.velocity_limits, rate, state.velocities),
    )


def _limited(problem: Problem) -> Problem:
    """The problem, with the URDF's limits where it has none."""
    of_file = (("torque", problem.robot.motor_torque_limits), ("velocity", problem.robot.motor_velocity_limits))
    added: dict[str, Any] = {}
    for key, limits in of_file:
        is_unlimited = getattr(problem.limits, key) == "none" and not problem.limits.motor
        if is_unlimited and np.isfinite(limits).any():
            added[key] = "urdf"
    return replace(problem, limits=replace(problem.limits, **added)) if added else problem


def _of_kind(title: str, unit: str, names: Sequence[str], limits: Array, used: Array, values: Array) -> Shares:
    """The shares of what has a limit; or the values, where nothing has. Curves that look alike are one."""
    limited = bool(np.isfinite(limits).any())
    curves = np.abs(used if limited else values).T
    difference = 0.01 * max(float(curves.max()), 1e-9)  # of the largest value: less cannot be seen
    distinct = list[int]()
    for index, curve in enumerate(curves):
        if limited and np.isinf(limits[index]):
            continue
        if all(np.abs(curve - curves[other]).max() > difference for other in distinct):
            distinct.append(index)
    return Shares(title, "" if limited else unit, limited, tuple(names[index] for index in distinct), curves[distinct])


def colour_of(use: float) -> str:
    """Of a share of a limit; rounding of a use of all of it is not red."""
    if use < NEARLY:
        return Colour.GREEN
    return Colour.AMBER if use <= 1 + 1e-9 else Colour.RED


def curves_card(motion: Trajectory, used: Sequence[Shares]) -> str:
    """The curves, each in the colours of how near it is to its limit; above them, of a jump, its contacts."""
    plots = "".join(_plot(shares, motion.duration) for shares in used)
    bands = _bands(motion) if isinstance(motion, JumpMotion) else ""
    axis = f'<div class="time"><span>0</span><span>{motion.duration:.3g} s</span></div>'
    return (
        f'<section class="fp curves" id="floatplan-curves" aria-label="Torque and rate over time">'
        f'<div class="plots">{bands}{plots}{axis}<i class="now"></i></div></section>'
    )


def instant_mark(share: float) -> str:
    """Where the player is, as a share of the motion: a line through the curves."""
    return f"<style>:root{{--fp-now:{min(max(share, 0.0), 1.0):.4f}}}</style>"


def _plot(used: Shares, duration: float) -> str:
    peak = used.peak
    count = used.values.shape[1]
    top = 1.15 * max(peak, 1.0 if used.limited else 1e-9)  # a little above the largest value or the limit
    across = np.linspace(0.0, 1000.0, count)
    stroke = f"url(#fp-{used.title})" if used.limited else Colour.BLUE
    paths = ""
    for name, curve in zip(used.names, used.values, strict=True):
        points = " ".join(f"{x:.0f},{y:.1f}" for x, y in zip(across, 100 - 100 * curve / top, strict=True))
        paths += f'<path d="M{points}" stroke="{stroke}"><title>{escape(name)}</title></path>'
    row, column = np.unravel_index(used.values.argmax(), used.values.shape) if used.values.size else (0, 0)
    left = 100.0 * column / max(count - 1, 1)
    high = 100.0 * (1 - peak / top)
    name = used.names[row] if used.names else ""
    value = f"{peak:.0%}" if used.limited else f"{short(peak, 3)} {used.unit}"
    # on the right of a plot a label is on the left of its point
    side = f"right:{100 - left:.1f}%" if left > 60.0 else f"left:{left:.1f}%"
    position = f"{side};top:min({high:.1f}%,100% - 1.3em)"
    colour = colour_of(peak) if used.limited else Colour.BLUE
    title = f"{used.title} / limit" if used.limited else f"{used.title}, {used.unit}"
    words = f"{title}: {value} at most, {name}, at {duration * left / 100:.2f} s"
    return (
        f'<div class="plot" role="img" aria-label="{escape(words)}">'
        f'<svg viewBox="0 0 1000 100" preserveAspectRatio="none" aria-hidden="true">{_limit(used, top)}{paths}</svg>'
        f'<span>{title}</span><b style="{position};color:{colour}">{value} {escape(name)}</b></div>'
    )


def _limit(used: Shares, top: float) -> str:
    """The limit as a line, and the colours of shares as a gradient from the bottom to the top of a plot."""
    if not used.limited:
        return ""
    ends = [
        (0.0, Colour.GREEN),
        (NEARLY, Colour.GREEN),
        (NEARLY, Colour.AMBER),
        (1.0, Colour.AMBER),
        (1.0, Colour.RED),
        (top, Colour.RED),
    ]
    stops = "".join(f'<stop offset="{share / top:.4f}" stop-color="{colour}"/>' for share, colour in ends)
    level = 100 - 100 / top
    return (
        f'<linearGradient id="fp-{used.title}" gradientUnits="userSpaceOnUse" x1="0" y1="100" x2="0" y2="0">{stops}'
        f'</linearGradient><rect width="1000" height="{level:.2f}" fill="{Colour.RED}" opacity=".1"/>'
        f'<path d="M0,{level:.2f} H1000" stroke="{Colour.RED}" stroke-dasharray="4 3"/>'
    )


def phase_colours(jump: JumpMotion) -> list[list[str]]:
    """Colours of the contacts of each phase of a jump; the flight, which has none, has a colour of its own."""
    standing = footing(jump)
    result = []
    for phase in jump.phases:
        names = [name for name, contact in standing.contacts.items() if contact.names[0] in phase.contacts]
        result.append([standing.colours[name] for name in names] or ["#c9d8ee"])
    return result


def _bands(jump: JumpMotion) -> str:
    """The phases of a jump, each in the colours of its contacts, one above the other."""
    bands = list[str]()
    words = list[str]()
    for phase, colours in zip(jump.phases, phase_colours(jump), strict=True):
        lasts = phase.end - phase.begin
        stands = ", ".join(phase.contacts) or "flight"
        words.append(f"{lasts:.3f} s: {stands}")
        position = f"left:{100 * phase.begin / jump.duration:.2f}%;width:{100 * lasts / jump.duration:.2f}%"
        ink = "" if phase.contacts else ";color:#1d2126;text-shadow:none"
        look = f"{position};background:{stripes(colours)}{ink}"
        label = f"<span>{lasts:.2f} s</span><span>{escape(stands)}</span>"  # CSS cuts off what is too wide
        bands.append(f'<div style="{look}" title="{escape(words[-1])}">{label}</div>')
    return f'<div class="phases" role="img" aria-label="Phases: {escape("; ".join(words))}">{"".join(bands)}</div>'


def stripes(colours: Sequence[str]) -> str:
    """CSS of colours one above the other."""
    height = 100 / len(colours)
    stops = ",".join(f"{colour} {height * row:.0f}% {height * (row + 1):.0f}%" for row, colour in enumerate(colours))
    return f"linear-gradient({stops})"


def bar_style(colours: Sequence[Sequence[str]], ends: Sequence[float]) -> str:
    """Make the slider of a jump's phases a bar, from their colours and their ends as shares of its length."""
    layers = []
    for phase, begin, end in zip(colours, (0.0, *ends), ends, strict=False):
        width = max(end - begin, 1e-3)
        layers.append(f"{stripes(phase)} {100 * begin / max(1 - width, 1e-3):.2f}% 0/{100 * width:.2f}% 100% no-repeat")
    return f"<style>:root{{--fp-phases:{','.join(layers)},#e8eaed}}</style>"
