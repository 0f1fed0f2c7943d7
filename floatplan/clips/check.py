"""The check of a clip: a verdict on each of its flights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from floatplan.arguments import made, positive
from floatplan.clips.clip import Clip
from floatplan.clips.judge import FlightJudgement, judge_flight
from floatplan.pool import one_thread
from floatplan.tables import GRAVITY

LEVELS_APART = 0.3  # [m] from the lowest to the highest ground of a clip, above which it is remarked


@dataclass(frozen=True, eq=False)
class ClipCheck:
    """The result of the check of a clip.

    Attributes
    ----------
    clip : Clip
    flights : tuple of FlightJudgement
        In the order of time.
    gravity : m/s^2
    """

    clip: Clip
    flights: tuple[FlightJudgement, ...]
    gravity: float = GRAVITY

    @property
    def ok(self) -> bool:
        """Whether no flight is unphysical."""
        return all(flight.verdict != "unphysical" for flight in self.flights)

    @cached_property
    def physical(self) -> int:
        """How many flights are physical."""
        return sum(flight.verdict == "physical" for flight in self.flights)

    @property
    def unphysical_share(self) -> float:
        """Share of the flights that are unphysical; 0 of none."""
        return sum(flight.verdict == "unphysical" for flight in self.flights) / max(len(self.flights), 1)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What was assumed of the clip, a sentence each: when it was read, and of the ground under it."""
        heights = self.clip.ground.heights
        low = round(float(heights.min()), 2) + 0.0  # which is not -0.00
        high = round(float(heights.max()), 2)
        if high - low <= LEVELS_APART:
            return self.clip.remarks
        levels = f"still feet are taken to stand on ground from {low:.2f} to {high:.2f} m high"
        return (*self.clip.remarks, f"{levels}: of a robot that hangs, or of a level ground, give its height, --ground")

    def table(self) -> list[dict[str, Any]]:
        """One row a flight, with the keys of the command line's ``--json``."""
        return [_row(flight) for flight in self.flights]

    def to_dict(self) -> dict[str, Any]:
        """Everything, as the command line's ``--json`` has it."""
        return {
            "file": str(self.clip.path),
            "model": self.clip.robot.source,
            "fps": self.clip.fps,
            "frames": self.clip.frames,
            "feet": list(self.clip.scene.foot_names),
            "remarks": list(self.remarks),
            "flights": self.table(),
        }

    def __repr__(self) -> str:
        return f"ClipCheck({self.clip.path.name!r}, {self.physical} of {len(self.flights)} flights physical)"


@one_thread
def check_clip(clip: Clip, gravity: float = GRAVITY) -> ClipCheck:
    """Judge the flights of a clip.

    Parameters
    ----------
    clip : Clip
    gravity : m/s^2

    Returns
    -------
    ClipCheck
        Its ``ok`` says that no flight is unphysical; "undecided" is one of too few frames to judge the fall.

    Raises
    ------
    InputError
        No foot can be identified, or the robot has no shapes.
    """
    made(Clip, advice="fp.load_clip reads one")(clip, "clip")
    positive(unit="m/s^2")(gravity, "gravity")
    return ClipCheck(clip, tuple(judge_flight(clip, flight, gravity) for flight in clip.flights), gravity)


def _row(judged: FlightJudgement) -> dict[str, Any]:
    flight = judged.flight
    rotation = judged.rotation
    return {
        "begin": flight.begin,
        "end": flight.end,
        "frames": flight.frames,
        "verdict": judged.verdict,
        "fall": or_none(judged.fall.fall),
        "fall_interval": or_none(judged.fall.interval),
        "sideways": or_none(judged.fall.sideways),
        "angular_momentum": None if rotation is None else np.asarray(rotation.angular_momentum).tolist(),
        "turn_rms": None if rotation is None else rotation.rms,
        "turn_noise": None if rotation is None else rotation.noise,
        "rate_share": share_table(judged.rate_share),
        "torque_share": share_table(judged.torque_share),
        "wrench": {"force": or_none(judged.wrench[0]), "moment": or_none(judged.wrench[1])},
        "feet": {"floating": judged.floating, "sinking": judged.sinking, "sliding": judged.sliding},
        "faults": list(judged.faults),
    }


def or_none(value: float) -> float | None:
    """Return a number as JSON has it: None of what is not finite."""
    return value if math.isfinite(value) else None


def share_table(share: tuple[float, str] | None) -> dict[str, Any] | None:
    """Return the largest share of a limit and whose it is, as JSON has it; None without limits."""
    return None if share is None else {"share": share[0], "joint": share[1]}
