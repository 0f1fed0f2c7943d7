"""The README and the pages of docs/: every snippet runs, in the order in which a reader meets it."""

import json
import re
import shlex
import tomllib
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import jsonschema
import pytest
from jumps import find_jumps_once, jump_once, plan_on_fewer_nodes, roll, try_few_gains
from long_cases import cases
from places import ROOT

import floatplan as fp
from floatplan.problem.file import as_problem
from floatplan.view.figures import animation, figures

PAGES = sorted(path.relative_to(ROOT).as_posix() for path in (*ROOT.glob("docs/**/*.md"), ROOT / "README.md"))
WITH_JUMP = "README.md with its jump"
LONG = {  # README without its jump: always
    WITH_JUMP,
    *(f"docs/{page}.md" for page in ("in_flight", "index", "jump", "studies", "tutorial")),
    *(f"docs/howto/{page}.md" for page in ("bench", "export", "flip_for_learning", "flip_in_mujoco")),
    *(f"docs/howto/{page}.md" for page in ("jump_to_controller", "jumps_in_space", "obstacles", "own_robot")),
    *(f"docs/howto/{page}.md" for page in ("reference_motions", "space")),
}
VERDICTS = (
    "floatplan takeoff",
    "floatplan plan",
    "floatplan replay",
)  # commands that may find that something is not so


def blocks(page, *languages):
    """Language and text of a page's code blocks."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for language, block in re.findall(r"^```(\w+)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if language in languages:
            yield language, block


def commands(block):
    """Lines of a shell block that call floatplan, without their comments."""
    for line in block.replace("\\\n", " ").splitlines():
        command = " ".join(shlex.split(line, comments=True))
        if command.startswith("floatplan "):
            yield command


def with_snippets(*languages):
    """Pages that have such blocks."""
    return [page for page in PAGES if any(blocks(page, *languages))]


@pytest.fixture
def jumps_once(monkeypatch):
    """A jump takes seconds: pages that ask for the same one are given what the first found.

    Those in space are not searched for: ``test_jump_in_space.py`` finds the roll, and others take a minute, all of
    which the benchmark's section contact-in-space flies. ``test_stunts.py`` holds that ``init`` asks for this roll,
    ``test_init.py`` that links of its jumps do not overlap, which takes another search.
    """
    plan_on_fewer_nodes(monkeypatch)
    find_jumps_once(monkeypatch)
    monkeypatch.setattr("floatplan.initial.flight._with_separated_links", lambda first, *_: first)

    def jump(problem, *arguments, **options):
        problem = as_problem(problem)
        if problem.robot.base != "free-flyer":
            return jump_once(problem, *arguments, **options)
        found = copy(roll())  # with its check
        object.__setattr__(found, "problem", replace(found.problem, name=problem.name))
        return found

    monkeypatch.setattr(fp, "jump", jump)


@pytest.fixture
def few_flights(monkeypatch):
    """A jump is flown twice where a page asks for many flights, a search for gains tries few, pictures are coarse.

    ``test_report.py`` counts all pictures of a film.
    """
    try_few_gains(monkeypatch)
    monkeypatch.setattr(animation, "FILM", replace(animation.FILM, rate=4.0))
    monkeypatch.setattr(figures, "rendered", partial(figures.rendered, dpi=60))
    fly = fp.replay_jump

    def replay_jump(*arguments, flights=1, **options):
        return fly(*arguments, flights=min(flights, 2), **options)

    monkeypatch.setattr(fp, "replay_jump", replay_jump)
    follow = fp.bench

    def bench(*arguments, flights=50, **options):
        return follow(*arguments, flights=min(flights, 2), **options)

    monkeypatch.setattr(fp, "bench", bench)


@pytest.mark.usefixtures("jumps_once", "few_flights")
@pytest.mark.parametrize("page", cases([*with_snippets("python", "sh"), WITH_JUMP], LONG))
def test_snippets_run(page, floatplan, monkeypatch):
    if page not in LONG:
        monkeypatch.setattr("floatplan.simulation.closed_loop.PERIOD", 1 / 200)  # as often as it corrects
    passed_over = ("floatplan jump", "floatplan init") if page == "README.md" else ()  # they look for jumps
    page = page.split()[0]
    for name in ("problems", "urdf"):
        Path(name).symlink_to(ROOT / name)
    names = {}
    for language, block in blocks(page, "python", "sh"):
        if language == "python":
            exec(compile(block, page, "exec"), names)  # the project's own text
            continue
        for command in commands(block):
            if command.startswith(passed_over):
                continue
            folders = len(list(Path.cwd().glob("runs/*")))
            words = shlex.split(command)[1:]
            if command.startswith("floatplan jump problems/jumps/space/") and folders:
                words.append("--no-report")  # it would show the same roll, as ``jumps_once`` has it
            run = floatplan(*words)
            may_fail = command.startswith(VERDICTS) and page != "README.md"
            assert run.code == 0 or (run.code == 1 and may_fail), (command, run)
            if page == "README.md" and command.startswith(("floatplan plan", "floatplan jump", "floatplan study")):
                assert len(list(Path.cwd().glob("runs/*"))) > folders, f"{command}: its results lie among others"


@pytest.mark.parametrize("page", with_snippets("toml"))
def test_toml_is_as_the_schema_says(page, floatplan):
    """A study file, or tables of a problem file, some of them left out."""
    schemas = {kind: json.loads(floatplan("schema", kind).stdout) for kind in ("problem", "study")}
    schemas["problem"].pop("required")
    for _, block in blocks(page, "toml"):
        content = tomllib.loads(block)
        jsonschema.Draft202012Validator(schemas["study" if "vary" in content else "problem"]).validate(content)
