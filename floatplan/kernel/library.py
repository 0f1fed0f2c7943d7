"""The compiled kernel as ctypes sees it: found beside this file, or not there; the structures of ``kernel.hpp``."""

from __future__ import annotations

import ctypes
import os
from ctypes import POINTER, Structure, c_double, c_int64, c_uint64, c_void_p
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np

from floatplan.kernel.build import FOLDER, LIBRARY, sources_digest

SWITCH = "FLOATPLAN_KERNEL"  # environment variable: "off" for the Python solver
INSTRUCTIONS = ("baseline instructions", "AVX2", "AVX-512")
STAGES = 3
SPREADS = 6


class Doubles(c_void_p):
    """Where doubles begin, see :func:`address`."""


class Integers(c_void_p):
    """Where integers of 64 bits begin."""


class Robot(Structure):
    """Of :mod:`floatplan.kernel.bodies`."""

    _fields_ = (
        *((name, c_int64) for name in ("joints", "bodies", "width")),
        ("free", Integers),
        ("real", Doubles),
        ("imaginary", Doubles),
        ("is_real", c_int64),
        *((name, Integers) for name in ("from_", "first", "joint")),
        ("ratio", Doubles),
    )


class Grid(Structure):
    """Nodes of a quadrature, and the basis of p there."""

    _fields_ = (("nodes", c_int64), *((name, Doubles) for name in ("weights", "value", "slope", "tail")))


class Powers(Structure):
    """The basis in powers of s, as sums of two doubles."""

    _fields_ = tuple((name, Doubles) for name in ("columns", "columns_low", "lost", "lost_low"))


class Stage(Structure):
    """When a stage of the search ends."""

    _fields_ = (
        *((name, c_double) for name in ("feasibility", "optimality", "quadrature_error")),
        ("iterations", c_int64),
    )


class Settings(Structure):
    """Every constant of the search."""

    _fields_ = (
        ("stages", Stage * STAGES),
        *(
            (name, c_double)
            for name in (
                *("longest_step", "coarsely_resolved", "too_wild", "hopeless", "tolerance", "unresolved"),
                *("smallest_tail", "largest_tail", "armijo", "penalty_factor", "penalty_kept", "shortest_step"),
                *("shortening_least", "shortening_most", "largest_multiplier", "damping", "slack_penalty"),
                *("largest_curvature", "polished", "hopeless_way", "changed_branches", "step_to_rank"),
                "agreement",
            )
        ),
        *(
            (name, c_int64)
            for name in (
                *("slow_evaluations", "slow_steps", "polishing_steps", "most_rounds", "most_iterations"),
                *("first_level", "levels", "finer", "level_of_starts", "candidates", "followed"),
                *("ranked_rounds", "steps_to_rank"),
                *("starts", "most_starts", "easy_iterations", "wanted_after_failure"),
                *("starts_to_agree", "agreeing"),
            )
        ),
        ("seed", c_uint64),
        ("spreads", c_double * SPREADS),
    )


class Batch(Structure):
    """Problems and their answers."""

    _fields_ = (
        ("count", c_int64),
        *((name, Doubles) for name in ("duration", "momentum", "change", "boundary", "start")),
        *(
            (name, Integers)
            for name in ("status", "iterations", "evaluations", "instants", "starts", "solved", "branch")
        ),
        *((name, Doubles) for name in ("objective", "residual", "z", "coefficients")),
    )


class Foreseen(Structure):
    """What a law of corrections foresees of the motion that it chose."""

    _fields_ = (("miss", c_double), ("share", c_double), ("evaluated", c_int64))


class Flight(Structure):
    """A flight that is corrected; of :mod:`floatplan.inflight.compiled`."""

    _fields_ = (
        *(
            (name, c_int64)
            for name in (
                *("joints", "groups", "bodies", "width", "instants", "nodes", "gap_nodes", "memory", "blocks"),
                *("torque_rows", "most_rows", "most_rows_of_all", "capsules"),
            )
        ),
        *((name, c_double) for name in ("turn", "goal", "length_scale")),
        *((name, Doubles) for name in ("centre", "amplitude", "turns")),
        ("group", Integers),
        *(
            (name, Doubles)
            for name in (
                *("weights", "value", "first", "second", "free_value", "free_first", "free_second", "whitening"),
                *("table", "points", "of_values", "at_landing", "gap", "gap_weights"),
            )
        ),
        ("block_first", Integers),
        *((name, Doubles) for name in ("aim", "softness")),
        *((name, Integers) for name in ("row_kind", "row_joint")),
        *((name, Doubles) for name in ("row_limit", "row_slope", "row_turns", "row_ratios")),
        *((name, Integers) for name in ("row_shape", "row_other")),
        *(
            (name, Doubles)
            for name in ("row_window", "obstacles", "radius", "ends_real", "ends_imaginary", "s", "integrals")
        ),
        *((name, c_double) for name in ("sigma", "acceleration", "far", "weighed", "settled", "shorter", "kept")),
        ("scales", c_double * 2),
        *((name, c_int64) for name in ("evaluations_near", "evaluations_far")),
        *(
            (name, Doubles)
            for name in (
                *("mass", "nominal_inertia", "own_real", "own_imaginary", "weights_real", "weights_imaginary"),
                *("nominal_real", "nominal_imaginary", "wander", "deviations"),
            )
        ),
        *((name, c_double) for name in ("angle_variance", "rate_variance", "largest_error", "surprising")),
        ("most_surprises", c_int64),
        *((name, Doubles) for name in ("state", "covariance")),
        ("surprises", Integers),
        *(
            (name, Doubles)
            for name in ("rows_real", "rows_imaginary", "merged_real", "merged_imaginary", "inertia", "motions")
        ),
        *((name, c_int64) for name in ("newest", "known")),
        *(
            (name, c_double)
            for name in ("began", "measured", "now", "landing", "measured_orientation", "measured_rate")
        ),
        *(
            (name, Doubles)
            for name in ("measured_positions", "measured_velocities", "positions", "velocities", "map", "path")
        ),
        *((name, c_double) for name in ("turn_before", "turn_after", "expected_rate", "aside", "variance", "noise")),
        *((name, c_int64) for name in ("evaluations", "is_warm")),
        *((name, Doubles) for name in ("warm_start", "coefficients", "worst")),
        ("foreseen", Foreseen),
        *(
            (name, Doubles)
            for name in ("scratch", "law_memory", "ahead_memory", "filter_memory", "gap_memory", "drift")
        ),
    )


class FlightStep(IntEnum):
    """What :attr:`Kernel.flight` does."""

    REMEMBER = 0
    EXPECT = 1
    LEARN = 2
    ADAPT = 3
    REWRITE = 4
    CORRECT = 5


class Moments(Structure):
    """What a tree's motors need, of :mod:`floatplan.kernel.peaks`."""

    _fields_ = (
        *((name, c_int64) for name in ("bodies", "motors")),
        ("group", Integers),
        *((name, Doubles) for name in ("real", "imaginary", "turns", "amplitude")),
    )


class Interpolation(Structure):
    """Chebyshev nodes and a finer grid."""

    _fields_ = (
        *((name, c_int64) for name in ("nodes", "points")),
        *((name, Doubles) for name in ("curvature", "to_cosines", "to_fine")),
    )


class Peaks(Structure):
    """Plans and their largest torques and rates."""

    _fields_ = (
        *((name, c_int64) for name in ("count", "levels", "velocities")),
        ("resolved", c_double),
        *((name, Doubles) for name in ("duration", "momentum", "coefficients", "peaks")),
    )


def address(values: np.ndarray[Any, Any]) -> int:
    """Where an array begins in memory."""
    return int(values.__array_interface__["data"][0])


class Kernel:
    """The library, loaded."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.plan = library.floatplan_plan
        self.plan.argtypes = [
            *(POINTER(Robot), POINTER(Grid), Integers, POINTER(Powers), POINTER(Settings), POINTER(Batch)),
            c_int64,
        ]
        self.plan.restype = c_int64
        self.flight = library.floatplan_flight
        self.flight.argtypes = [POINTER(Flight), c_int64, c_int64]
        self.flight.restype = None
        self.peaks = library.floatplan_peaks
        self.peaks.argtypes = [
            *(POINTER(Robot), POINTER(Moments), POINTER(Grid), POINTER(Interpolation), POINTER(Settings)),
            *(POINTER(Peaks), c_int64),
        ]
        self.peaks.restype = c_int64
        self.watch = library.floatplan_watch  # see watch.py
        self.watch.argtypes = [c_void_p, c_void_p, c_int64, c_void_p, c_int64, c_void_p, c_int64]
        self.watch.restype = None
        self.minima = library.floatplan_minima
        self.minima.argtypes = [c_void_p, c_void_p, c_void_p, c_void_p, c_int64]
        self.minima.restype = None
        self.quadratic = library.floatplan_quadratic  # see quadratic.py
        self.quadratic.argtypes = [c_void_p, c_int64]
        self.quadratic.restype = c_int64
        library.floatplan_instructions.restype = c_int64
        self.instructions = int(library.floatplan_instructions())


@cache
def _loaded() -> tuple[Kernel | None, str]:
    """The kernel, and why it is not there."""
    path = FOLDER / LIBRARY
    if not path.is_file():
        return None, "not compiled"
    try:
        library = ctypes.CDLL(str(path))
        library.floatplan_sources.restype = ctypes.c_char_p
        if library.floatplan_sources().decode() != sources_digest():
            return None, "compiled from other sources: python -m floatplan.kernel.build"
        return Kernel(library), ""
    except (OSError, AttributeError) as error:
        return None, f"cannot be loaded: {error}"


def kernel() -> Kernel | None:
    """Return the compiled kernel; None where it is not built, or switched off by ``FLOATPLAN_KERNEL=off``."""
    return None if os.environ.get(SWITCH, "").lower() == "off" else _loaded()[0]


def description() -> str:
    """Say in a few words which solver makes plans without inequalities."""
    found = kernel()
    if found:
        return f"compiled kernel ({INSTRUCTIONS[found.instructions]})"
    return f"Python solver (compiled kernel {_loaded()[1] or f'switched off by {SWITCH}'})"
