"""A drawn hop of a Go2 as a recorded motion that was spoiled, and its repair with planned stances, made once."""

from __future__ import annotations

from functools import cache

import numpy as np
from clip_landings import swung
from drawn_hops import Hop, draw_hops
from once import made_once

import floatplan as fp
from floatplan.clips.repair import ClipRepair

STRETCH = 1.3  # [-] in time, of the flight
SWING = 10.0  # [degree] of the base, about its long axis
RATE = 500.0  # [Hz] of the repaired motion


@cache
def drawn_hop() -> Hop:
    """The first one that is drawn."""
    (hop,) = draw_hops("go2", 1)
    return hop


def spoiled_hop() -> fp.Clip:
    """The same, its flight slower, and its base swung."""
    return swung(drawn_hop(), 50.0, STRETCH, SWING, np.array([1.0, 0.0, 0.0]))


def repaired_hop() -> tuple[fp.Clip, ClipRepair]:
    """Its repair."""
    repaired: tuple[fp.Clip, ClipRepair] = made_once(
        "repaired hop of a Go2", lambda: fp.repair_clip(spoiled_hop(), rate=RATE, stances="planned")
    )
    return repaired
