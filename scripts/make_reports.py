"""Plans the problems that docs/gallery.md shows and writes their reports into build/reports, for ``scripts/docs``."""

from __future__ import annotations

import re
from pathlib import Path

import floatplan as fp

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "gallery.md"
FOLDERS = ("gallery", "space", "")  # below problems/
REPORTS = ROOT / "build" / "reports" / "reports"  # what is in build/reports is copied into the pages' folder


def problem_file(name: str) -> Path:
    """The one problem of that name, of the gallery, in space or of the paper's."""
    (path,) = (path for folder in FOLDERS if (path := ROOT / "problems" / folder / f"{name}.toml").is_file())
    return path


def main() -> None:
    """Write them all; one that cannot be planned and proved is an error, in space one that cannot be planned."""
    REPORTS.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(re.findall(r'href="reports/(\w+)\.html"', PAGE.read_text(encoding="utf-8"))):
        plan = fp.plan(fp.load_problem(problem_file(name)), prove=True)
        proved = plan.certificate is not None and plan.certificate.proved
        if not plan.ok or (plan.robot.in_plane and not proved):
            raise SystemExit(f"{name}: {plan.explanation}")
        plan.show(REPORTS / f"{name}.html", browse=False)


if __name__ == "__main__":
    main()
