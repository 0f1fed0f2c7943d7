"""Study files spoiled at random, and small: what is hostile is what they say, not how many rows they ask for."""

from __future__ import annotations

import random
import shutil
import tomllib
from pathlib import Path
from typing import Any

import tomli_w
from fuzz_mutations import ROOT, spoiled

SOUND: tuple[dict[str, Any], ...] = (
    {
        "problem": "problems/somersault.toml",
        "vary": {
            "flight.angular_momentum": {"from": 3.0, "to": 4.0, "count": 3},
            "flight.duration": {"from": 1.0, "to": 1.2, "count": 2},
        },
        "plan": {"starts": 2},
        "result": {"map": ["flight.angular_momentum", "flight.duration", "torque_peak"], "folder": "out"},
    },
    {
        "problem": "problems/falling_cat.toml",
        "vary": {
            "sampling": "sobol",
            "samples": 4,
            "flight.duration": {"from": 0.5, "to": 1.5},
            "goal.positions.q2": {"from": -1.0, "to": 1.0},
        },
        "plan": {"prove": True},
    },
    {
        "problem": "problems/torque_limited.toml",
        "vary": {"motion.degree": [5, 9], "flight.duration": [0.7]},
        "plan": {"search": True},
    },
    {
        "problem": "problems/obstacle.toml",
        "vary": {"obstacles.0.center.0": [1.6], "flight.gravity": [9.81, 1.62]},
        "result": {"map": ["obstacles.0.center.0", "flight.gravity", "clearance"]},
    },
)
PATHS = (
    *("flight.duration", "flight.angular_momentum", "flight.gravity", "flight.horizontal_velocity", "motion.degree"),
    *("start.orientation", "goal.orientation", "start.positions.q1", "goal.positions.q1", "goal.velocities.q2"),
    *("obstacles.0.radius", "obstacles.0.center.1", "limits.torque", "limits.velocity"),
)
VALUES = (0, 0.001, 0.3, 0.9, 1, 2, 3.3, 5, 15, 30.0, 400.0, 1000.0, 1e4, 1e-9, 1e6, -1, -7.0, -1e4)
MOST = 4  # values of a key, rows drawn, starts of a row: more of them take longer, and nothing else


def prepare_study(rng: random.Random, folder: Path) -> list[str]:
    """Write a spoiled study with its problem, and return the arguments of its command, to be run in the folder."""
    sound = rng.choice(SOUND)
    shutil.copytree(ROOT / "urdf", folder / "urdf")
    (folder / "problems").mkdir()
    shutil.copy(ROOT / sound["problem"], folder / "problems")
    study = folder / "study.toml"
    study.write_text(tomli_w.dumps(sound), encoding="utf-8")
    if rng.random() < 0.6:
        study.write_text(tomli_w.dumps(_elsewhere(rng, sound)), encoding="utf-8")
    else:
        study.write_bytes(_small(spoiled(rng, study)))
    return ["study", str(study), "--jobs", "1", *rng.choice((["--json"], ["-q"], ["-o", "out"], ["--restart"]))]


def _elsewhere(rng: random.Random, sound: dict[str, Any]) -> dict[str, Any]:
    """The study with another number varied, or one over another range."""
    vary = dict(sound["vary"])
    kept = [path for path in vary if path not in ("sampling", "samples")]
    drawn = "sampling" in vary
    path = rng.choice((*kept, *PATHS))
    ends = sorted(rng.sample(VALUES, 2))
    ranged = {"from": ends[0], "to": ends[1]}
    vary[path] = ranged if drawn else rng.choice((ends, ends[:1], {**ranged, "count": 2}))
    plan = rng.choice((sound.get("plan", {}), {"starts": 3}, {"search": True}, {"prove": True}))
    return {**sound, "vary": vary, "plan": plan, "result": {"folder": "out"}}


def _small(content: bytes) -> bytes:
    """The file with fewer rows where it asks for many, as it is where it is no TOML."""
    try:
        return tomli_w.dumps(_fewer(tomllib.loads(content.decode("utf-8")))).encode("utf-8")
    except (ValueError, TypeError, RecursionError):
        return content


def _fewer(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _fewer_of(key, value) for key, value in content.items()}
    return content


def _fewer_of(key: str, value: Any) -> Any:
    if key in ("count", "samples", "starts") and isinstance(value, int) and MOST < value <= 10**6:
        return MOST
    if isinstance(value, list) and "." in key:
        return value[:MOST]
    return _fewer(value)
