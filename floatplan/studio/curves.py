"""Shares of limits over time, measured where a motion was planned; and the curves below the scene, as HTML."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any

import numpy as np

from floatplan.arguments import short
from floatplan.arrays import Array
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.problem import Problem
from floatplan.view.jumps import footing, limit_shares

SAMPLES = 401  # [-] instants of a curve
ALIKE = 0.01  # [-] of a limit: a follower whose curve differs by less from its leader's is not drawn
NEARLY = 0.9  # [-] shares of a limit from which a use is amber, and red
FULL = 1 + 1e-9
GREEN = "#1a7f4b"
AMBER = "#985a00"
RED = "#c0182b"
BLUE = "#1f5fbf"
ROOM = 1.15  # [-] of the largest that is drawn: height of a plot
FLYING = "#c9d8ee"  # the phase without contacts
RIGHT = 60.0  # [%] of the width from which labels are on the left of their places


@dataclass(frozen=True, eq=False)
class Shares:
    """What is used of the limits of one kind, over a motion, at even instants.

    Attributes
    ----------
    title : "torque" or "rate"
    unit : in which they are told where nothing limits
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
    """What a motion uses of the limits on torque and rate: of those asked for, else of the URDF's, if there are any."""
    state = motion.state(np.linspace(0.0, motion.duration, SAMPLES))
    problem = _limited(motion.whole_problem)
    torque, rate = limit_shares(problem, state)
    motors = np.minimum(problem.motor_torque_limits, problem.motor_stall)
    return (
        _told("torque", "N m", problem.robot.motors, motors, torque, state.motor_torques),
        _told("rate", "rad/s", problem.robot.joints, problem.velocity_limits, rate, state.velocities),
    )


def _limited(problem: Problem) -> Problem:
    """The problem, with the URDF's limits in the place of none."""
    of_file = (("torque", problem.robot.motor_torque_limits), ("velocity", problem.robot.motor_velocity_limits))
    missing: dict[str, Any] = {
        key: "urdf"
        for key, limits in of_file
        if np.isfinite(limits).any() and getattr(problem.limits, key) == "none" and not problem.limits.motor
    }
    return replace(problem, limits=replace(problem.limits, **missing)) if missing else problem


def _told(title: str, unit: str, names: Sequence[str], limits: Array, used: Array, values: Array) -> Shares:
    """The shares of what has a limit; or the values, where nothing has. Curves that are alike are one."""
    limited = bool(np.isfinite(limits).any())
    kept = list[int]()
    drawn = np.abs(used if limited else values).T
    for index, curve in enumerate(drawn):
        alike = (np.abs(curve - drawn[each]).max() <= ALIKE * max(float(drawn.max()), 1e-9) for each in kept)
        if (not limited or np.isfinite(limits[index])) and not any(alike):
            kept.append(index)
    return Shares(title, "" if limited else unit, limited, tuple(names[index] for index in kept), drawn[kept])


def colour_of(use: float) -> str:
    """Of a share of a limit."""
    return GREEN if use < NEARLY else AMBER if use <= FULL else RED


def curves_card(motion: Trajectory, used: Sequence[Shares]) -> str:
    """The curves, each in the colours of how near it is to its limit; above them, of a jump, what stands when."""
    plots = "".join(_plot(each, motion.duration) for each in used)
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
    top = ROOM * max(peak, 1.0 if used.limited else 1e-9)
    across = np.linspace(0.0, 1000.0, count)
    paths = "".join(
        f'<path d="M{" ".join(f"{x:.0f},{y:.1f}" for x, y in zip(across, 100 - 100 * curve / top, strict=True))}"'
        f' stroke="{f"url(#fp-{used.title})" if used.limited else BLUE}"><title>{escape(name)}</title></path>'
        for name, curve in zip(used.names, used.values, strict=True)
    )
    row, column = np.unravel_index(used.values.argmax(), used.values.shape) if used.values.size else (0, 0)
    left = 100.0 * column / max(count - 1, 1)
    high = 100.0 * (1 - peak / top)
    name = used.names[row] if used.names else ""
    told = f"{peak:.0%}" if used.limited else f"{short(peak, 3)} {used.unit}"
    side = f"right:{100 - left:.1f}%" if left > RIGHT else f"left:{left:.1f}%"
    place = f"{side};top:min({high:.1f}%,100% - 1.3em)"
    colour = colour_of(peak) if used.limited else BLUE
    title = f"{used.title} / limit" if used.limited else f"{used.title}, {used.unit}"
    words = f"{title}: {told} at most, {name}, at {duration * left / 100:.2f} s"
    return (
        f'<div class="plot" role="img" aria-label="{escape(words)}">'
        f'<svg viewBox="0 0 1000 100" preserveAspectRatio="none" aria-hidden="true">{_limit(used, top)}{paths}</svg>'
        f'<span>{title}</span><b style="{place};color:{colour}">{told} {escape(name)}</b></div>'
    )


def _limit(used: Shares, top: float) -> str:
    """The limit as a line, and the colours of shares as a gradient from the bottom to the top of a plot."""
    if not used.limited:
        return ""
    ends = [(0.0, GREEN), (NEARLY, GREEN), (NEARLY, AMBER), (1.0, AMBER), (1.0, RED), (top, RED)]
    stops = "".join(f'<stop offset="{share / top:.4f}" stop-color="{colour}"/>' for share, colour in ends)
    level = 100 - 100 / top
    return (
        f'<linearGradient id="fp-{used.title}" gradientUnits="userSpaceOnUse" x1="0" y1="100" x2="0" y2="0">{stops}'
        f'</linearGradient><rect width="1000" height="{level:.2f}" fill="{RED}" opacity=".1"/>'
        f'<path d="M0,{level:.2f} H1000" stroke="{RED}" stroke-dasharray="4 3"/>'
    )


def phase_colours(jump: JumpMotion) -> list[list[str]]:
    """Colours of what stands, of each phase of a jump; that of the flight has its own."""
    standing = footing(jump)
    return [
        [standing.colours[name] for name, contact in standing.contacts.items() if contact.names[0] in phase.contacts]
        or [FLYING]
        for phase in jump.phases
    ]


def _bands(jump: JumpMotion) -> str:
    """The phases of a jump, each in the colours of what stands, one above the other."""
    bands = list[str]()
    words = list[str]()
    for phase, colours in zip(jump.phases, phase_colours(jump), strict=True):
        lasts = phase.end - phase.begin
        stands = ", ".join(phase.contacts) or "flight"
        words.append(f"{lasts:.3f} s: {stands}")
        place = f"left:{100 * phase.begin / jump.duration:.2f}%;width:{100 * lasts / jump.duration:.2f}%"
        ink = "" if phase.contacts else ";color:#1d2126;text-shadow:none"
        look = f"{place};background:{stripes(colours)}{ink}"
        told = f"<span>{lasts:.2f} s</span><span>{escape(stands)}</span>"  # what does not fit is left out
        bands.append(f'<div style="{look}" title="{escape(words[-1])}">{told}</div>')
    return f'<div class="phases" role="img" aria-label="Phases: {escape("; ".join(words))}">{"".join(bands)}</div>'


def stripes(colours: Sequence[str]) -> str:
    """CSS of colours one above the other."""
    height = 100 / len(colours)
    stops = (f"{each} {height * row:.0f}% {height * (row + 1):.0f}%" for row, each in enumerate(colours))
    return f"linear-gradient({','.join(stops)})"


def bar_style(colours: Sequence[Sequence[str]], ends: Sequence[float]) -> str:
    """Make the slider of a jump's phases a bar, from their colours and their ends as shares of its length."""
    layers = []
    for phase, begin, end in zip(colours, (0.0, *ends), ends, strict=False):
        width = max(end - begin, 1e-3)
        layers.append(f"{stripes(phase)} {100 * begin / max(1 - width, 1e-3):.2f}% 0/{100 * width:.2f}% 100% no-repeat")
    return f"<style>:root{{--fp-phases:{','.join(layers)},#e8eaed}}</style>"
