"""Prepares a release: ``scripts/release.py 0.3.0`` puts the version into every file that names it, the changelog too.

With a tag, ``scripts/release.py v0.3.0``, it changes nothing and says whether all is ready for that.
"""

from __future__ import annotations

import datetime
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NAMED = {  # where each file names the version
    "pyproject.toml": r'(?m)^(version = ")([^"]+)(")$',
    "CITATION.cff": r"(?m)^(version: )(\S+)()$",
    "recipe/recipe.yaml": r"(?m)^(  version: )(\S+)()$",
}
LATEST = re.compile(r"(?m)^## \[(\S+)\]")  # heading of the changelog
VERSION = re.compile(r"\d+\.\d+\.\d+((a|b|rc)\d+)?")


def versions(root: Path = ROOT) -> dict[str, str]:
    """The version that each file names."""
    return {name: re.findall(where, (root / name).read_text("utf-8"))[0][1] for name, where in NAMED.items()}


def missing(tag: str, root: Path = ROOT) -> list[str]:
    """What a tag's release lacks, in words."""
    found = [f"{name} names {version}" for name, version in versions(root).items() if f"v{version}" != tag]
    (latest, *_) = LATEST.findall((root / "CHANGELOG.md").read_text("utf-8"))
    return found + [f"CHANGELOG.md begins with {latest}"] * (f"v{latest}" != tag)


def prepare(version: str, day: datetime.date, root: Path = ROOT) -> None:
    """Put a version into all files, and a new one's day where it is cited."""
    for name, where in NAMED.items():
        text = re.sub(where, rf"\g<1>{version}\g<3>", (root / name).read_text("utf-8"), count=1)
        if name == "CITATION.cff":
            text = re.sub(r"(?m)^date-released: .*\n", "", text)
            text = re.sub(r"(?m)^(version: .*)$", rf"\1\ndate-released: {day}", text)
        (root / name).write_text(text, "utf-8")
    log = (root / "CHANGELOG.md").read_text("utf-8")
    (root / "CHANGELOG.md").write_text(log.replace("## [Unreleased]\n", f"## [{version}] - {day}\n", 1), "utf-8")


def main() -> None:
    (word,) = sys.argv[1:] or [""]
    if not VERSION.fullmatch(word.removeprefix("v")):
        sys.exit("usage: scripts/release.py VERSION, as 0.3.0, to prepare it; or its tag, as v0.3.0, to check it")
    if not word.startswith("v"):
        prepare(word, datetime.datetime.now(datetime.UTC).date())
        word = f"v{word}"
    if lacks := missing(word):
        sys.exit("\n".join((f"{word} is not ready:", *lacks)))
    print(f"{word} is ready")


if __name__ == "__main__":
    main()
