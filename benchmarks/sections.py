"""Measures floatplan, and its peers beside it, in one run, and prints tables.

Usage: ``python scripts/benchmark.py [--quick] [SECTION ...]``; sections: speed quality starts free random rest
forward obstacle witness growth inflight startup many studies single jump hops launch contact contact-in-space
guesses-in-space space proofs clips clip-repair clip-landings guard; all of them where none is named. Needs the extra
``bench``.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from clip_landings import clip_landings
from clip_repair_section import clip_repair
from clip_section import clips
from clip_stances_section import clip_stances
from constraint_sections import forward, obstacle, witness
from guard import guard
from inflight_sections import inflight
from jump_sections import contact, contact_in_space, guesses_in_space, hops, jump_section, launch_section
from many_section import many
from measuring import FULL, QUICK, Counts
from proof_section import proofs
from search_sections import free_section, random_section, rest_section, starts_section
from single_section import single
from space_sections import space
from speed_sections import growth, quality, speed
from startup_sections import startup
from study_section import studies

SECTIONS: dict[str, Callable[[Counts], None]] = {
    "speed": speed,
    "quality": quality,
    "starts": starts_section,
    "free": free_section,
    "random": random_section,
    "rest": rest_section,
    "forward": forward,
    "obstacle": obstacle,
    "witness": witness,
    "growth": growth,
    "inflight": inflight,
    "startup": startup,
    "many": many,
    "studies": studies,
    "single": single,
    "jump": jump_section,
    "hops": hops,
    "launch": launch_section,
    "contact": contact,
    "contact-in-space": contact_in_space,
    "guesses-in-space": guesses_in_space,
    "space": space,
    "proofs": proofs,
    "clips": clips,
    "clip-repair": clip_repair,
    "clip-landings": clip_landings,
    "clip-stances": clip_stances,
    "guard": guard,
}


def machine() -> str:
    """Return one line on the machine and the versions."""
    packages = ("numpy", "scipy", "pin", "proxsuite", "casadi")
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    load = os.getloadavg()[0]
    processor = _processor() or platform.machine()
    return f"{processor}, {os.cpu_count()} cores, load {load:.1f}; Python {platform.python_version()}, {versions}"


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if not information.exists():
        return platform.processor()
    lines = information.read_text(encoding="utf-8").splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the sections asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"of: {' '.join(SECTIONS)}")
    parser.add_argument("--quick", action="store_true", help="fewer turns and problems")
    asked = parser.parse_args(arguments)
    unknown = [name for name in asked.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"unknown section: {' '.join(unknown)}; there are: {' '.join(SECTIONS)}")
    print(f"{machine()}\n")
    for name in asked.sections or SECTIONS:
        SECTIONS[name](QUICK if asked.quick else FULL)


if __name__ == "__main__":
    main()
