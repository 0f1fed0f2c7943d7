"""What can be saved: the problem as a file, its plan, and the report."""

from __future__ import annotations

import os
from itertools import chain, count
from pathlib import Path
from typing import Literal, TypeAlias

import floatplan as fp
from floatplan.studio.session.session import View
from floatplan.studio.work.tasks import words_of

Part: TypeAlias = Literal["problem", "plan", "report"]
NAMES: dict[Part, str] = {"problem": "problem.toml", "plan": "plan.json", "report": "report.html"}


class Saving:
    """Saves into a folder; what this session has not written, or others have changed since, is not overwritten."""

    def __init__(self) -> None:
        self._written: dict[Path, tuple[int, int]] = {}

    def save(self, view: View, part: Part, folder: str) -> str:
        """Write a file, and return what to say about it; nothing is raised."""
        try:
            asked = Path(folder).expanduser() / NAMES[part]
            path = self._free(asked)
            self._write(view, part, path)
            self._written[path.resolve()] = _version(path)
        except Exception as error:  # of a name, of a full disk, of what a report may find: the page goes on
            return f"Not saved: {words_of(error)}"
        return f"{path} is saved." if path == asked else f"{path} is saved: there is another {asked.name} already."

    def _free(self, path: Path) -> Path:
        """The path itself, or one with a number in its name, where nothing is or what this session wrote last."""
        names = (path.with_stem(f"{path.stem}-{number}") for number in count(2))
        return next(each for each in chain((path,), names) if not os.path.lexists(each) or self._is_own(each))

    def _is_own(self, path: Path) -> bool:
        return path.is_file() and self._written.get(path.resolve()) == _version(path)

    def _write(self, view: View, part: Part, path: Path) -> None:
        if part == "problem":
            fp.save_problem(view.problem, path)
            return
        if view.flown is None or not view.is_current or not view.flown.settled:
            raise fp.InputError("the plan is not settled yet", advice="wait a moment")
        plan = view.flown.complete_plan()
        if part == "plan":
            plan.save(path)
        else:
            plan.show(path, browse=False)


def _version(path: Path) -> tuple[int, int]:
    """What changes when a file is written anew."""
    state = path.stat()
    return state.st_ino, state.st_mtime_ns
