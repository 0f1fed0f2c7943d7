"""What can be saved: the problem as a file, its plan, and the report."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

import floatplan as fp
from floatplan.studio.session.session import View
from floatplan.studio.work.tasks import words_of

Part: TypeAlias = Literal["problem", "plan", "report"]
NAMES: dict[Part, str] = {"problem": "problem.toml", "plan": "plan.json", "report": "report.html"}


class Saving:
    """Saves into a folder; a problem file that this session has not written is not overwritten."""

    def __init__(self) -> None:
        self._written: set[Path] = set()

    def save(self, view: View, part: Part, folder: str) -> str:
        """Write a file, and return what to say about it; nothing is raised."""
        try:
            path = Path(folder).expanduser() / NAMES[part]
            self._write(view, part, path)
        except OSError as error:
            return f"Not saved: {error.filename or folder}: {error.strerror or error}"
        except Exception as error:  # of a name, of a full disk, of what a report may find: the page goes on
            return f"Not saved: {words_of(error)}"
        return f"{path} is saved."

    def _write(self, view: View, part: Part, path: Path) -> None:
        if part == "problem" and path.exists() and path.resolve() not in self._written:
            raise fp.InputError("is there already", source=path, advice="choose another folder")
        if part == "problem":
            path.parent.mkdir(parents=True, exist_ok=True)
            fp.save_problem(view.problem, path)
            self._written.add(path.resolve())
            return
        if view.flown is None or not view.is_current or not view.flown.settled:
            raise fp.InputError("the plan is not settled yet", advice="wait a moment")
        plan = view.flown.complete_plan()
        path.parent.mkdir(parents=True, exist_ok=True)
        if part == "plan":
            plan.save(path)
        else:
            plan.show(path, browse=False)
