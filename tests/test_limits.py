"""docs/limits.md says what the program does."""

import re

import pytest

from floatplan import errors, files, tables
from floatplan.cli import clips
from floatplan.clips import formats
from floatplan.export import table
from floatplan.planning import options
from floatplan.plans import reading, trajectory
from floatplan.problem import family, file, resolution
from floatplan.robot.mjcf import text as mjcf_text
from floatplan.robot.shapes import collisions, links
from floatplan.robot.urdf import check, tree
from floatplan.simulation import closed_loop, gains, integration
from floatplan.studies import file as study_file
from floatplan.studies import study

SIZES = {  # as numbers where the program names no constant
    "planned joints": resolution.MOST_JOINTS,
    "joints of a URDF that move": check.MOST_JOINTS,
    "fixed joints of a URDF": check.MOST_FIXED_JOINTS,
    "polynomial degree": tables.HIGHEST_DEGREE,
    "problems of a family": family.MOST_PROBLEMS,
    "obstacles, and pairs of links to keep apart": tables.MOST_OBSTACLES,
    "obstacles times shapes of links": resolution.MOST_DISTANCES,
    "collision elements, where shapes matter": links.MOST_COLLISIONS,
    "a recorded motion, and what it holds when unpacked": f"{formats.LARGEST_CLIP // 1_000_000} MB",
    "frames of a recorded motion": formats.MOST_FRAMES,
    "columns of a recorded motion's CSV": formats.MOST_COLUMNS,
    "recorded motions of one command": clips.MOST_CLIPS,
    "processes of a search or a study, threads of a batch": options.MOST_JOBS,
    "rows of a study": study_file.MOST_ROWS,
    "motions that a study writes": study.MOST_MOTIONS,
    "keys that a study varies": 32,
    "solved starts of a search, and of a study's row": tables.RANGES["starts"].high,
    "unsolved starts of a row, at each degree": options.ATTEMPTS,
    "rows on a study's page": 200_000,
    "rows of a table or an export": trajectory.MOST_ROWS,
    "steps of a replay in MuJoCo": integration.MOST_STEPS,
    "periods (1 ms) of a flight in closed loop": closed_loop.MOST_PERIODS,
    "flights in closed loop": closed_loop.MOST_FLIGHTS,
    "corrections a second": f"{1 / closed_loop.PERIOD:.0f}",
    "places of links in an export to MCAP or of a reference motion: instants times links": table.MOST_PLACES,
    "evaluations of the dynamics in a replay": integration.MOST_EVALUATIONS,
    "bandwidth of a replay's feedback": f"{gains.FASTEST:.0f} rad/s",
    "a problem file, a study file": f"{file.LARGEST_PROBLEM // 10**6} MB",
    "a plan file, a URDF, an SRDF file": f"{files.LARGEST_PLAN // 10**6} MB",
    "a mesh": f"{collisions.LARGEST_MESH // 10**6} MB",
    "elements of an MJCF with what it includes": 20_000,
    "bodies of an MJCF": 1000,
    "files that an MJCF is read with": mjcf_text.MOST_FILES,
    "tables and lists within each other, in any file": files.DEEPEST,
    "characters of a name": errors.LENGTHS.name,
}


@pytest.fixture(scope="module")
def page(root):
    return (root / "docs" / "limits.md").read_text(encoding="utf-8")


def rows(page, heading):
    section = page.split(f"## {heading}\n")[1].split("\n## ")[0]
    cells = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row] for row in cells[2:]]


def test_ranges(page):
    written = {key.strip("`"): tuple(rest) for key, *rest in rows(page, "Numbers of problem and plan files")}
    elsewhere = {"position", "height", "degree", "starts", "seed", "count"}
    known = {key: allowed for key, allowed in tables.RANGES.items() if key not in elsewhere}
    assert written == {key: (f"{r.low:g}", f"{r.high:g}", r.unit) for key, r in known.items()}


def test_sizes(page):
    assert dict(rows(page, "Sizes")) == {what: str(most) for what, most in SIZES.items()}
    assert files.LARGEST_URDF == files.LARGEST_PLAN


@pytest.mark.parametrize(
    "number",
    [
        f"{resolution.NARROWEST:g} rad wide",
        f"at most {reading.LARGEST_ANGLE:g} rad",
        f"above {reading.LARGEST:g}",
        f"above {reading.LARGEST_RESULT:g}",
        f"below {tree.LARGEST:g}",
        f"at least {tables.RANGES['mass'].low:g} kg",
        *(f"`.{kind}`" for kind in collisions.MESH_KINDS),
    ],
)
def test_other_numbers(page, number):
    assert re.search(re.escape(number).replace(r"\ ", r"\s"), page)
