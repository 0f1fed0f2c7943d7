"""Recorded motions: true hops of three robots, and the same ones spoiled, as the judge of clips sees them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator

import numpy as np
from drawn_hops import HOPPERS, Hop, clip_of, draw_hop, drifted, noisy, rounded, shifted, stretched
from measuring import Counts, heading, table

from floatplan.clips.check import check_clip
from floatplan.clips.clip import Clip

RATES = (30.0, 50.0, 200.0)  # [Hz] of frames
NOISE = (0.2, 1e-3)  # [degree, m] in every frame
TRUE = ("exact", "rounded", "noisy")
VERDICTS = ("physical", "unphysical", "undecided", "afloat", "other flights")


def drawn(count: int) -> Iterator[tuple[str, Hop, float, np.random.Generator]]:
    """Hops with the seeds 0, 1, .., the robots and rates in turns, and the generator for what is done to each."""
    names = tuple(HOPPERS)
    for seed in range(count):
        rng = np.random.default_rng(seed)
        name = names[seed % len(names)]
        hop = None
        while hop is None:
            hop = draw_hop(name, rng)
        yield name, hop, RATES[seed // len(names) % len(RATES)], rng


def versions(hop: Hop, fps: float, rng: np.random.Generator) -> Iterator[tuple[str, Clip]]:
    """The hop as it is, and spoiled, each with its name."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    yield "exact", clip_of(hop, fps)
    yield "rounded", rounded(clip_of(hop, fps))
    yield "noisy", noisy(clip_of(hop, fps), rng, *NOISE)
    for factor in (1.05, 1.3):
        yield f"stretched by {factor}", stretched(hop, fps, factor)
    for degrees in (6.0, 12.0):
        yield f"drifts by {degrees:g} degrees", drifted(hop, fps, degrees, axis)
    for metres in (0.05, 0.1):
        yield f"shifts by {100 * metres:g} cm", shifted(hop, fps, metres, axis)
    yield "stretched by 1.1, noisy", noisy(stretched(hop, fps, 1.1), rng, *NOISE)
    yield "drifts by 6 degrees, noisy", noisy(drifted(hop, fps, 6.0, axis), rng, *NOISE)
    yield "shifts by 5 cm, noisy", noisy(shifted(hop, fps, 0.05, axis), rng, *NOISE)


def clips(counts: Counts) -> None:
    """Verdicts on true hops and on spoiled ones; false alarms, and faults that are not found, with their seeds."""
    heading("Recorded motions: verdicts on drawn hops")
    verdicts: Counter[tuple[str, str]] = Counter()
    wrong = []
    begin = time.process_time()
    judged = 0
    for seed, (name, hop, fps, rng) in enumerate(drawn(counts.clips)):
        for version, clip in versions(hop, fps, rng):
            flights = check_clip(clip).flights
            judged += 1
            verdict = flights[0].verdict if len(flights) == 1 else "other flights"
            verdicts[version, verdict] += 1
            expected = "physical" if version in TRUE else "unphysical"
            if verdict not in (expected, "undecided"):
                wrong.append(f"{name}, seed {seed}, {fps:g} Hz, {version}: {verdict}")
    seconds = time.process_time() - begin
    names = dict.fromkeys(version for version, _ in verdicts)
    table(["clip", *VERDICTS], [[name, *(str(verdicts[name, verdict]) for verdict in VERDICTS)] for name in names])
    alarms = sum(verdicts[version, "unphysical"] + verdicts[version, "afloat"] for version in TRUE)
    print(f"false alarms: {alarms} in {3 * counts.clips} clips of true hops, seeds 0 to {counts.clips - 1}")
    print("undecided, of too few frames for the fall to be known to 1.5 m/s^2, is neither found nor a false alarm")
    print("other flights: a shift downwards brings feet to the ground before their time")
    print(f"processor time {1e3 * seconds / judged:.0f} ms a clip, with drawing")
    for line in wrong:
        print(line)
    print()
