"""Robots that other packages give: xacro files, which are expanded, and robots of robot_descriptions by their names."""

import hashlib
import importlib
import json
import sys

import numpy as np
import pytest
from places import ROOT

import floatplan as fp
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
            ('<xacro:property name="mass" value="2"/>', "give the file that has them"),
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
        assert fp.load_plan(file).robot.sha256 == plan.robot.sha256
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
