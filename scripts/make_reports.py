"""Plans the problems that docs/gallery.md shows and writes their reports into build/reports, for ``scripts/docs``."""

from __future__ import annotations

import re
from pathlib import Path

import floatplan as fp

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "gallery.md"
REPORTS = ROOT / "build" / "reports" / "reports"  # what is in build/reports is copied into the pages' folder


def problem_file(name: str) -> Path:
    """The problem of that name, of the gallery or of the others."""
    return next(path for path in ROOT.glob(f"problems/**/{name}.toml"))


def main() -> None:
    """Write them all; one that cannot be planned and proved is an error."""
    REPORTS.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(re.findall(r'href="reports/(\w+)\.html"', PAGE.read_text(encoding="utf-8"))):
        plan = fp.plan(fp.load_problem(problem_file(name)), prove=True)
        if plan.certificate is None or not plan.certificate.proved:
            raise SystemExit(f"{name}: {plan.explanation}")
        plan.show(REPORTS / f"{name}.html", browse=False)


if __name__ == "__main__":
    main()
