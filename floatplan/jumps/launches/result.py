"""The result of a search for a stance that meets a plan: the least limits that do, and whose they are."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from floatplan.jumps.check import SHARES, limit_shares, limited_names, sentences_on, stance_figures
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.problem.problem import Problem
from floatplan.tables import RELATIVE

LIMIT_WORDS = {
    "torque": "torque of {}",
    "torque_speed": "torque-speed curve of {}",
    "velocity": "{}'s rate",
    "held_torque": "torque of {}, held",
}


@dataclass(frozen=True, eq=False)
class Launch:
    """A stance from standing to a takeoff, or from a landing to standing, with the least common factor on the limits.

    Attributes
    ----------
    ok : whether there is one within the limits, and holds at 2 kHz
    ratio : largest share of its limits that a torque or rate takes, at least; infinite where there is none
    limit : of the figures ``torque``, ``torque_speed``, ``velocity`` and ``held_torque`` the one; "" where none is
    joint : the motor whose share it is; or the joint, of a rate, or of the torque of a leader with its followers; ""
        where there is none
    sentences : for a person
    figures : as of :class:`floatplan.jumps.check.JumpCheck`
    impossible : whether it is shown that there is none, because of what stands where the flight begins or ends
    broken : what does not hold at 2 kHz, but for the limits
    """

    ok: bool
    ratio: float
    limit: str
    joint: str
    sentences: tuple[str, ...]
    figures: dict[str, float]
    impossible: bool = False
    broken: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the result as builtin data: what ``floatplan plan --launch --json`` prints of an end."""
        return {
            "ok": self.ok,
            "joint": self.joint,
            "limit": self.limit,
            "impossible": self.impossible,
            "ratio": self.ratio if math.isfinite(self.ratio) else None,
            "sentences": list(self.sentences),
        }


def launch_of_stances(motion: JumpMotion, end: str) -> Launch:
    """Return what the stances of one side of a flight come to, in a plane or in space."""
    problem = motion.problem
    request = motion.request
    figures = stance_figures(motion)
    limit = max(SHARES, key=lambda name: figures[name])
    ratio = figures[limit]
    joint = largest_user(problem, [stance.at(stance.grid.times) for stance in motion.stances], limit)
    figures.pop("obstacles", None)  # those of a flight may be where it begins: a ground a little below its feet
    others = {name: value for name, value in figures.items() if name not in SHARES}
    failing, _ = sentences_on(request, others)
    broken = tuple(", ".join(words) for words in failing)
    limit_words = LIMIT_WORDS[limit].format(joint)
    if ratio > 1:
        summary = f"no stance was found within the limits (least factor {ratio:.2f}, {limit_words})"
    elif broken:
        summary = "no stance was found that holds between the program's nodes"
    elif ratio > 0:
        summary = f"reachable, with {1 - ratio:.0%} to spare ({limit_words})"
    else:
        summary = "reachable; nothing is limited"
    sentences = (f"{end.capitalize()}: {summary}.", *broken)
    return Launch(ratio <= 1 and not broken, ratio, limit, joint, sentences, figures, broken=broken)


def largest_user(problem: Problem, states: Iterable[JumpState], limit: str) -> str:
    """Return the motor or joint whose share of a limit, of ``SHARES``, is the largest in any of the states."""
    names = limited_names(problem.robot, limit)
    shares = [limit_shares(problem, state)[limit] for state in states]
    largest = np.concatenate(shares).max(axis=0)
    if limit == "torque":  # a motor before its joint, whose share is the same but for rounding
        largest[len(problem.robot.motors) :] *= 1 - RELATIVE
    return names[int(largest.argmax())]
