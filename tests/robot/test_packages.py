"""Robots that other packages give: files in them, xacro files, which are expanded, and robot_descriptions by name."""

import hashlib
import importlib
import json
import sys
import types

import numpy as np
import pytest
from places import ROOT
from typer.testing import CliRunner

import floatplan as fp
from floatplan.cli.commands import app
from floatplan.cli.option_values import is_robot
from floatplan.errors import InputError
from floatplan.robot.urdf import packages
from floatplan.robot.urdf.packages import description_path, robot_content

GYMNAST = ROOT / "urdf" / "gymnast.urdf"
KANGAROO = ROOT / "urdf" / "kangaroo.xml"
XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


@pytest.fixture
def xacro(tmp_path):
    """The gymnast as a xacro file, its first mass a property, its links in a file that it includes."""
    links = GYMNAST.read_text().partition(">")[2].replace('"3.0"', '"${mass}"', 1)
    (tmp_path / "links.xacro").write_text(
        f'<robot {XACRO}><xacro:macro name="links" params="mass">{links.replace("</robot>", "")}</xacro:macro></robot>'
    )
    file = tmp_path / "gymnast.urdf.xacro"
    file.write_text(
        f'<robot name="gymnast" {XACRO}><xacro:include filename="links.xacro"/>'
        '<xacro:links mass="${1.5 * 2}"/></robot>'
    )
    return file


class TestXacro:
    def test_is_the_robot_that_it_makes(self, xacro):
        made, written = fp.Robot.from_urdf(xacro), fp.Robot.from_urdf(GYMNAST)
        assert (made.mass, made.joints, made.name) == (written.mass, written.joints, "gymnast")
        np.testing.assert_array_equal(made.tree.mass, written.tree.mass)
        assert made.sha256 == hashlib.sha256(robot_content(xacro)).hexdigest()
        assert is_robot(str(xacro))

    @pytest.mark.parametrize(
        ("content", "advice"),
        [
            ('<xacro:macro name="leg" params="side"><link name="${side}"/></xacro:macro>', "as it only defines macros"),
            pytest.param(
                '<xacro:property name="mass" value="2"/>', "give the file that has them", marks=pytest.mark.long
            ),
        ],
    )
    def test_one_that_makes_no_link_is_told_to_be_called_by_another(self, tmp_path, content, advice):
        file = tmp_path / "parts.xacro"
        file.write_text(f'<robot name="parts" {XACRO}>{content}</robot>')
        with pytest.raises(InputError, match=r"parts.xacro: has no <link>") as caught:
            fp.Robot.from_urdf(file)
        assert advice in caught.value.advice
        assert "let its name end" not in str(caught.value)

    def test_a_plan_is_proved_of_what_the_file_makes(self, xacro, tmp_path):
        text = (ROOT / "problems" / "new_configuration.toml").read_text()
        problem = tmp_path / "problem.toml"
        problem.write_text(text.replace("../urdf/gymnast.urdf", xacro.name))
        plan = fp.plan(fp.load_problem(problem), prove=True)
        assert plan.certificate.proved
        file = plan.save(tmp_path / "plan.json")
        assert fp.certify(file).proved
        # Its hash is that of the URDF: which file makes it does not matter, what it makes does.
        urdf = tmp_path / "made.urdf"
        urdf.write_bytes(robot_content(xacro))
        xacro.write_text(xacro.read_text() + "<!-- a word -->")
        assert fp.certify(file, urdf=urdf).proved
        part = tmp_path / "links.xacro"
        part.write_text(part.read_text().replace('"2.5"', '"2.6"'))
        with pytest.raises(fp.InputError, match=r"SHA-256 differs|has changed"):
            fp.certify(file)

    @pytest.mark.parametrize(
        ("value", "said"),
        [
            ("${1 / 0}", "division"),
            *[
                pytest.param(*case, marks=pytest.mark.long)
                for case in (
                    ("${[0] * 10 ** 10}", "Memory"),
                    ("${unknown}", "unknown"),
                    ("$(find nowhere)", "nowhere"),
                    ("${__import__('os').getpid()}", "__"),
                )
            ],
        ],
    )
    def test_what_it_cannot_make_is_one_error(self, xacro, value, said):
        xacro.write_text(xacro.read_text().replace("${1.5 * 2}", value))
        with pytest.raises(fp.InputError, match=f"xacro refuses it: .*{said}") as caught:
            fp.Robot.from_urdf(xacro)
        assert str(xacro) in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_ends_after_a_while(self, xacro, monkeypatch):
        monkeypatch.setattr(packages, "LONGEST", 0.4)
        xacro.write_text(xacro.read_text().replace("${1.5 * 2}", "${10 ** 10 ** 9}"))
        with pytest.raises(fp.InputError, match=r"more than 0\.4 s"):
            robot_content(xacro)

    def test_a_file_that_makes_too_much_is_refused(self, xacro, monkeypatch):
        monkeypatch.setattr(packages, "LARGEST_URDF", 1000)
        with pytest.raises(fp.InputError, match=r"larger than|makes a URDF of more"):
            robot_content(xacro)

    def test_without_xacrodoc_the_message_names_the_extra(self, xacro, monkeypatch):
        monkeypatch.setattr(packages, "find_spec", lambda name: None)
        with pytest.raises(fp.InputError, match=r'extra "xacro".*pip install .*\[xacro\]'):
            fp.Robot.from_urdf(xacro)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A stand-in for robot_descriptions, with modules as that has them."""
    folder = tmp_path / "robot_descriptions"
    folder.mkdir()
    modules = {
        "__init__": "",
        "tumbler_description": f"print('Cloning ...')\nURDF_PATH = {str(GYMNAST)!r}\n",
        "tumbler_mj_description": f"MJCF_PATH = {str(KANGAROO)!r}\n",
        "absent_description": f"URDF_PATH = {str(tmp_path / 'absent.urdf')!r}\n",
        "silent_description": "import os\nos._exit(0)\n",
        "unreachable_description": "import subprocess\nsubprocess.run(['git', 'clone', 'https://localhost:1/a', "
        "'nowhere'], check=True)\n",
    }
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "robot_descriptions"]:
        monkeypatch.delitem(sys.modules, name)
    importlib.invalidate_caches()
    description_path.cache_clear()
    yield folder
    description_path.cache_clear()


class TestDescriptions:
    @pytest.mark.parametrize(
        "address",
        ["tumbler_description", pytest.param("robot_descriptions:tumbler_description", marks=pytest.mark.long)],
    )
    def test_are_found_by_name(self, package, address, tmp_path):
        robot = fp.Robot.from_urdf(address)
        assert (robot.path, robot.source) == (GYMNAST, address)
        model = fp.Robot.from_mjcf(address.replace("tumbler_", "tumbler_mj_"))
        assert (model.path, model.kind) == (KANGAROO, "mjcf")
        assert description_path("tumbler_mj_description", None) == KANGAROO
        assert is_robot(address)
        text = (ROOT / "problems" / "new_configuration.toml").read_text()
        problem = tmp_path / "problem.toml"
        problem.write_text(text.replace("../urdf/gymnast.urdf", address))
        plan = fp.plan(fp.load_problem(problem), prove=True)
        assert plan.certificate.proved
        file = plan.save(tmp_path / "plan.json")
        assert json.loads(file.read_text())["robot"]["urdf"] == address
        assert fp.certify(file).proved

    @pytest.mark.parametrize(
        ("address", "said"),
        [
            ("tumblr_description", "has no tumblr_description; it has tumbler_description"),
            ("unreachable_description", "robot_descriptions pull unreachable_description"),
            *[
                pytest.param(*case, marks=pytest.mark.long)
                for case in (
                    ("absent_description", "gives no URDF of it; it gives URDF_PATH"),
                    ("tumbler_mj_description", "gives no URDF of it; it gives MJCF_PATH"),
                    ("silent_description", "ended with 0, and said nothing; bring it here first"),
                )
            ],
        ],
    )
    def test_what_the_package_does_not_give_is_one_error(self, package, address, said):
        with pytest.raises(fp.InputError, match=said) as caught:
            fp.Robot.from_urdf(address)
        assert str(caught.value).startswith(address)
        assert "\n" not in str(caught.value)

    def test_without_the_package_the_message_says_what_to_do(self, monkeypatch):
        monkeypatch.setattr(packages, "find_spec", lambda name: None)
        description_path.cache_clear()
        with pytest.raises(
            fp.InputError, match=r"not installed; .*pip install robot_descriptions; .*example-robot-data"
        ):
            fp.Robot.from_urdf("go2_description")


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    """A package that ships robots and cannot be imported, one without ``__init__.py``, and modules of one file."""
    place = tmp_path / "site"
    models = place / "shipped_robots" / "models"
    models.mkdir(parents=True)
    (place / "shipped_robots" / "__init__.py").write_text("raise RuntimeError('nobody asked for this')\n")
    (models / "kangaroo.xml").write_bytes(KANGAROO.read_bytes())
    (models / "gymnast.urdf").write_bytes(GYMNAST.read_bytes())
    (place / "robots_in_parts").mkdir()
    (place / "robots_in_parts" / "gymnast.urdf").write_bytes(GYMNAST.read_bytes())
    (place / "one_module.py").touch()
    (place / "secret.urdf").write_bytes(GYMNAST.read_bytes())
    monkeypatch.syspath_prepend(place)
    monkeypatch.setitem(sys.modules, "without_spec", types.ModuleType("without_spec"))
    importlib.invalidate_caches()
    return place


class TestFilesInPackages:
    @pytest.mark.parametrize(
        ("address", "kind", "original"),
        [
            ("package:shipped_robots/models/kangaroo.xml", "mjcf", KANGAROO),
            ("package:shipped_robots/models/gymnast.urdf", "urdf", GYMNAST),
            ("package:robots_in_parts/gymnast.urdf", "urdf", GYMNAST),
        ],
    )
    def test_are_read_without_importing_the_package(self, shipped, address, kind, original):
        robot = fp.Robot.from_file(address)
        assert (robot.kind, robot.source, robot.sha256) == (
            kind,
            address,
            hashlib.sha256(original.read_bytes()).hexdigest(),
        )
        assert robot.path.is_relative_to(shipped)
        assert is_robot(address)
        assert "shipped_robots" not in sys.modules

    def test_problem_and_plan_files_keep_the_address(self, shipped, tmp_path, monkeypatch):
        """A plan is read and proved wherever the package is, and where it is not, one line says what to install."""
        address = "package:shipped_robots/models/gymnast.urdf"
        text = (ROOT / "problems" / "new_configuration.toml").read_text()
        file = tmp_path / "problem.toml"
        file.write_text(text.replace("../urdf/gymnast.urdf", address))
        problem = fp.load_problem(file)
        saved = fp.save_problem(problem, tmp_path / "elsewhere" / "saved.toml")
        assert fp.load_problem(saved).robot.source == address
        plan = fp.plan(problem).save(tmp_path / "elsewhere" / "plan.json")
        monkeypatch.chdir(ROOT)
        assert fp.load_plan(plan).robot.source == address
        assert fp.certify(plan).proved
        (shipped / "shipped_robots").rename(shipped / "gone")
        importlib.invalidate_caches()
        with pytest.raises(InputError, match=r"shipped_robots is not installed; .*-m pip install shipped_robots"):
            fp.load_problem(saved)
        with pytest.raises(InputError, match="shipped_robots is not installed"):
            fp.load_plan(plan)

    @pytest.mark.parametrize(
        ("address", "reason", "advice"),
        [
            ("package:absent_robots/a.xml", "absent_robots is not installed", "-m pip install absent_robots"),
            ("package:without_spec/a.xml", "without_spec is not installed", "pip install"),
            ("package:shipped_robots/kangaro.xml", "has no file 'kangaro.xml'", "it has models/kangaroo.xml"),
            ("package:shipped_robots/models", "has no file 'models'", "its files are in"),
            ("package:shipped_robots/../secret.urdf", r"has no file '../secret.urdf'", "it has models/gymnast.urdf"),
            ("package:shipped_robots//etc/passwd", "has no file '/etc/passwd'", "its files are in"),
            ("package:one_module/a.xml", "one_module has no file", "it is a module"),
            ("package:shipped_robots", "does not name a file in a package", "package:NAME/PATH"),
            ("package:shipped_robots/", "does not name a file in a package", "package:NAME/PATH"),
            ("package://shipped_robots/models/kangaroo.xml", "does not name a file in a package", "package:NAME/PATH"),
            ("package:../secret.urdf", "does not name a file in a package", "package:NAME/PATH"),
            ("package:shipped_robots.models/kangaroo.xml", "does not name a file in a package", "package:NAME/PATH"),
        ],
    )
    def test_what_is_no_such_file_is_one_error(self, shipped, address, reason, advice):
        with pytest.raises(InputError, match=reason) as caught:
            fp.Robot.from_file(address)
        assert caught.value.source == address
        assert advice in (caught.value.advice or "")
        assert "\n" not in str(caught.value)

    def test_on_a_command_line_the_exit_code_is_2(self, shipped):
        result = CliRunner().invoke(app, ["info", "package:absent_robots/a.xml"])
        assert result.exit_code == 2
        assert "pip install absent_robots" in " ".join(result.stderr.split())
