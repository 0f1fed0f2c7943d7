"""The project as it is delivered: package, wheel, scripts."""

import datetime
import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
import release
import yaml
from check_links import broken_links
from needed import skip_or_fail
from places import ROOT

import floatplan

DEVELOPERS = ("test", "docs", "dev", "bench")  # extras
HEAVY = ("numpy", "pinocchio", "proxsuite", "scipy", "matplotlib", "rich", "yourdfpy", "flint", "viser")


def python(*arguments, cwd=ROOT, **environment):
    return subprocess.run(
        [sys.executable, *arguments],
        check=True,
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **environment},
    ).stdout


@pytest.mark.parametrize("code", ["import floatplan", "import floatplan.cli"])
def test_imports_are_light(code):
    loaded = python("-c", f"{code}, sys; print(*sys.modules)").split()
    assert not set(HEAVY) & set(loaded)


def test_a_plan_imports_only_what_it_uses(tmp_path):
    (tmp_path / "plan.json").touch()  # of an older run, of which pictures and other formats may have been made
    code = "import sys, floatplan.cli\ntry: floatplan.cli.main()\nfinally: print(*sys.modules)"
    loaded = python("-c", code, "plan", "problems/handstand.toml", "--quiet", "-o", str(tmp_path)).split()
    assert {"numpy", "pinocchio", "flint"} <= set(loaded)
    assert not {*HEAVY, "pydantic", "multiprocessing.forkserver", "numpy.ma"} - {
        "numpy",
        "pinocchio",
        "proxsuite",
        "flint",
    } & set(loaded)
    of_space = "floatplan.certificate.spatial"
    assert not [name for name in loaded if name.startswith(of_space)]  # this flight is in a plane


@pytest.mark.parametrize("name", floatplan.__all__)
def test_public_names_are_there(name):
    assert getattr(floatplan, name) is not None
    assert name in dir(floatplan)


def test_every_public_name_has_its_place_in_the_api_reference():
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "api").glob("*.md"))
    listed = re.findall(r"^\.\. auto(?:class|function|exception|module):: (?:floatplan\.)?(\w+)$", pages, re.MULTILINE)
    assert sorted(listed) == sorted(set(floatplan.__all__) - {"__version__"})


def documented(of, member):
    """Whether a class, or one that it is derived from, says what a member is: in a docstring of its own, or by name."""
    for base in of.__mro__:
        own = vars(base).get(member)
        function = getattr(own, "fget", None) or getattr(own, "func", None) or getattr(own, "__func__", own)
        if inspect.isroutine(function) and function.__doc__:
            return True
        text = inspect.cleandoc(vars(base).get("__doc__") or "")
        if re.search(rf"^(?:\w+, )*{member}(?:, \w+)*(?: : .*)?$|``{member}``", text, re.MULTILINE):
            return True
    return False


def test_every_public_member_is_documented():
    without, count = [], 0
    for name in floatplan.__all__[1:]:
        value = getattr(importlib.import_module(floatplan._HOMES[name]), name)  # tests wrap some that are imported
        assert value.__doc__, name
        if inspect.isclass(value):
            own = [base for base in value.__mro__ if base.__module__.startswith("floatplan.")]
            members = {member for base in own for member in (*vars(base), *vars(base).get("__annotations__", {}))}
            public = {member for member in members if not member.startswith("_")}
            attributes = inspect.cleandoc(value.__doc__).partition("Attributes\n-")[2]
            twice = {each for each in public if re.search(rf"^(?:\w+, )*{each}\b", attributes, re.MULTILINE)}
            assert not [each for each in twice if isinstance(inspect.getattr_static(value, each, None), property)]
            count += len(public)
            without += [f"{name}.{member}" for member in sorted(public) if not documented(value, member)]
    assert (without, count > 500) == ([], True)


@pytest.mark.long
def test_the_pages_are_built_without_a_warning_and_their_links_lead_somewhere(tmp_path):
    if importlib.util.find_spec("sphinx") is None:
        skip_or_fail("Sphinx is not installed: the extra docs")
    python("-m", "sphinx", "-q", "--fail-on-warning", "-d", str(tmp_path / "cache"), "docs", str(tmp_path / "pages"))
    assert "floatplan.Plan.at" in (tmp_path / "pages" / "api" / "plans.html").read_text(encoding="utf-8")
    broken = broken_links(tmp_path / "pages")
    assert [link for link in broken if ": reports/" not in link] == [], "reports are made by scripts/docs"


def test_links_of_the_documents_lead_somewhere():
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", path.read_text(encoding="utf-8")):
            assert (path.parent / link).exists(), f"{path.name}: {link}"


def test_files_that_the_guide_names_are_there():
    guide = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    package = [path.as_posix() for path in (ROOT / "floatplan").rglob("*.py")]
    for name in re.findall(r"`([\w/]+\.py)`", guide):
        assert (ROOT / name).is_file() or any(path.endswith(f"/{name}") for path in package), name


def test_the_way_to_a_jump_names_what_there_is():
    guide = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    way = guide.partition("\nFrom a request to a jump")[2].partition("\nThe kernel (")[0]
    paths = [*(ROOT / "floatplan" / "jumps").rglob("*.py"), ROOT / "floatplan" / "planning" / "planner.py"]
    text = "\n".join(path.read_text(encoding="utf-8") for path in paths)
    defined = set(re.findall(r"^\s*(?:def|class) (\w+)", text, re.MULTILINE))
    named = re.findall(r"`([\w.]+?)(?:\(\))?`", way)
    unknown = [name for name in named if not set(name.removeprefix("fp.").split(".")) <= defined]
    assert (len(named) > 20, unknown) == (True, [])


def test_the_version_is_the_project_s():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert floatplan.__version__ == project["version"]


class TestRelease:
    def test_every_file_names_the_same_version(self):
        assert set(release.versions().values()) == {floatplan.__version__}

    def test_the_recipe_needs_what_the_project_needs(self):
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())["requirements"]
        conda = {"pin": "pinocchio", "matplotlib": "matplotlib-base", "mujoco": "mujoco-python"}

        def named(requirements, sign):
            pairs = (re.split(f"{sign}(?=[<>])", each, maxsplit=1) for each in requirements if each != "python")
            return {conda.get(name, name): bounds for name, bounds in pairs}

        assert named(recipe["run"], " ") == named(project["dependencies"], "")
        extras = [
            each for name, group in project["optional-dependencies"].items() if name not in DEVELOPERS for each in group
        ]
        assert named(recipe["run_constraints"], " ").items() <= named(extras, "").items()

    def test_only_the_job_of_a_tag_may_publish(self):
        publishing = []
        for path in (ROOT / ".github" / "workflows").glob("*.yml"):
            workflow = yaml.safe_load(path.read_text())
            assert workflow["permissions"] == {}
            for name, job in workflow["jobs"].items():
                for command in (step["run"] for step in job.get("steps", ()) if "run" in step):
                    for script in re.findall(r"(?:scripts|\.ci)/[\w.]+", command):
                        assert (ROOT / script).is_file(), script
                if set(job["permissions"].items()) - {("contents", "read")}:
                    publishing.append((path.name, name, job["if"], job["needs"]))
        tagged = "github.event_name == 'push' && github.ref_type == 'tag'"
        assert publishing == [("release.yml", "publish", tagged, "packages")]

    def test_a_prepared_version_is_ready_and_no_other_is(self, tmp_path):
        (tmp_path / "recipe").mkdir()
        for name in (*release.NAMED, "CHANGELOG.md"):
            shutil.copy(ROOT / name, tmp_path / name)
        day = datetime.date(2001, 2, 3)
        for version in ("7.0.0rc1", "7.0.0"):
            log = tmp_path / "CHANGELOG.md"
            log.write_text("# Changelog\n\n## [Unreleased]\n" + log.read_text().partition("## [Unreleased]\n")[2])
            assert release.missing(f"v{version}", tmp_path)
            release.prepare(version, day, tmp_path)
            assert release.missing(f"v{version}", tmp_path) == []
        assert release.missing("v7.0.0rc1", tmp_path)
        assert tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]["version"] == "7.0.0"
        cited = yaml.safe_load((tmp_path / "CITATION.cff").read_text())
        assert (cited["version"], cited["date-released"]) == ("7.0.0", day)


def test_no_test_imports_another():
    """What tests share is in ``tests/helpers``."""
    tests = [path for path in (ROOT / "tests").rglob("*.py") if "helpers" not in path.parts]
    names = {path.stem for path in tests}
    for path in tests:
        statement = r"^\s*(?:from ([\w.]+) import|import ([\w., ]+)$)"
        found = re.findall(statement, path.read_text(encoding="utf-8"), re.MULTILINE)
        imports = [module for modules in found for module in modules]
        others = {*names, "tests"} - {path.stem}  # a process of its own may import its functions
        assert not set(re.findall(r"\w+", " ".join(imports))) & others, path


class TestScripts:
    @pytest.mark.parametrize(
        "name",
        [
            *("scripts/demo", "scripts/test", "scripts/check", "scripts/docs", "scripts/build"),
            *("scripts/try_installed", "scripts/environment", ".ci/run"),
        ],
    )
    def test_can_be_run(self, name):
        path = ROOT / name
        assert os.access(path, os.X_OK)
        subprocess.run(["bash", "-n", str(path)], check=True)

    def test_readme_commands_are_scripts(self):
        text = (ROOT / "README.md").read_text()
        block = text.split("## Two commands")[1].split("```")[1]
        commands = [line.split("#")[0].strip() for line in block.splitlines()[1:] if line]
        assert commands == ["scripts/demo", "scripts/test"]

    def test_continuous_integration_runs_the_readme_s_test_command_and_that_the_checks(self):
        commands = (ROOT / ".ci" / "run").read_text().splitlines()[-2:]
        assert commands == ["scripts/test", "exec scripts/check --long"]
        assert (ROOT / "scripts" / "test").read_text().splitlines()[-1] == "exec scripts/check"

    @pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
    def test_an_unfit_python_is_refused(self, tmp_path):
        for name in ("scripts", "pyproject.toml"):
            source = ROOT / name
            shutil.copytree(source, tmp_path / name) if source.is_dir() else shutil.copy(source, tmp_path)
        old = tmp_path / "old-python"
        old.write_text('#!/bin/sh\n[ "$1" = --version ] && { echo Python 3.9.1; exit 0; }\nexit 1\n')
        old.chmod(0o755)
        done = subprocess.run(
            [tmp_path / "scripts" / "environment"],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHON": str(old)},
        )
        assert done.returncode == 2
        assert "CPython 3.11 or later" in done.stderr
        assert "Python 3.9.1" in done.stderr
        assert not (tmp_path / ".venv").exists()
