"""Hostile MJCF files: MuJoCo compiles in a process with bounds, without what is not planned with."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest

import floatplan as fp
from floatplan.errors import InputError
from floatplan.robot.mjcf import process
from floatplan.robot.mjcf.compiled import compiled_mjcf
from floatplan.robot.mjcf.text import MjcfText

ROBOT = """
<mujoco>{before}<worldbody><body name="base"><freejoint/><geom size="0.1"/>
  <body name="arm" pos="0 0 0.3"><joint name="arm" axis="0 1 0" range="-60 60"/>
    <geom type="capsule" size="0.05 0.1"/>{inside}</body></body></worldbody>{after}</mujoco>"""
MUSCLE = '<actuator><muscle joint="arm" {}/></actuator>'
ENDLESS = '<compiler><lengthrange mode="all" inttotal="1e7" useexisting="false"/></compiler>'  # days of simulation


def robot_file(folder, before="", inside="", after=""):
    path = folder / "robot.xml"
    path.write_text(ROBOT.format(before=before, inside=inside, after=after))
    return path


def many_motors(attributes):
    motors = 30 * f'<general joint="arm" {attributes}/>'
    return f"<actuator>{motors}</actuator>"


NEVER_PLANNED_WITH = {
    "ranges of lengths": (ENDLESS, "", '<actuator><motor joint="arm"/></actuator>'),
    "of muscles, by default": ("", "", 20 * MUSCLE.format("")),
    "of muscles, in the file": (ENDLESS.replace("all", "muscle"), "", MUSCLE.format("")),
    "delayed controls": ("", "", many_motors('nsample="20000000" delay="1"')),
    "delays of a class": (
        '<default><general nsample="20000000" delay="1" interp="cubic"/></default>',
        "",
        many_motors(""),
    ),
    "activations": ("", "", many_motors('dyntype="user" actdim="200000000"')),
    "memory": ('<size memory="100G" nuser_body="100000000"/>', "", ""),
    "pictures": (
        "",
        "",
        '<asset><texture name="t" type="2d" builtin="flat" width="60000" height="60000"/>'
        '<material name="m" texture="t"/></asset>',
    ),
    "terrain": ("", "", '<asset><hfield name="h" nrow="50000" ncol="50000" size="1 1 1 1"/></asset>'),
    "numbers of nobody": ("", "", '<custom><numeric name="n" size="900000000"/></custom>'),
    "solvers": (
        '<option iterations="2000000000" noslip_iterations="2000000000" tolerance="0" solver="PGS" timestep="1e-9"/>',
        '<geom size="0.3"/>',
        '<worldbody><geom type="plane" size="1 1 1"/></worldbody>',
    ),
    "sensors": ("", "", '<sensor><user name="s" dim="500000000" needstage="pos"/></sensor>'),
}


@pytest.mark.parametrize("case", NEVER_PLANNED_WITH)
def test_what_is_not_planned_with_is_left_out(tmp_path, monkeypatch, case):
    """The file is the robot that it would be without; each of these would take minutes or gigabytes."""
    monkeypatch.setattr(process, "LONGEST", 20.0)
    robot = fp.Robot.from_mjcf(robot_file(tmp_path, *NEVER_PLANNED_WITH[case]))
    alone = fp.Robot.from_mjcf(robot_file(tmp_path))
    assert robot.joints == alone.joints == ("arm",)
    assert robot.mass == pytest.approx(alone.mass, rel=1e-12) or case == "solvers"


REFUSED = {
    "many bodies": ("", '<replicate count="100000000"><geom size="1"/></replicate>', ""),
    "bodies of a grid": ("", '<composite type="cable" count="9999999 1 1" size="1"/>', ""),
    "what bends": ("", '<flexcomp name="f" type="grid" count="2000 2000 2000" spacing="1 1 1"/>', ""),
    "another model": ("", "", '<asset><model name="m" file="robot.xml"/></asset>'),
    "attached": ("", '<attach model="m" body="base" prefix="a"/>', ""),
    "code": ("", "", '<extension><plugin plugin="mujoco.sdf.torus"/></extension>'),
    "a mesh without a file": ("", "", '<asset><mesh name="m" builtin="supersphere" params="9999 1 1"/></asset>'),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_makes_much_out_of_little_is_refused(tmp_path, case):
    with pytest.raises(InputError, match=r"not read|can be read"):
        fp.Robot.from_mjcf(robot_file(tmp_path, *REFUSED[case]))


def endless(folder):
    """What reading would have left out, so that compiling it does not end."""
    text = ROBOT.format(before=ENDLESS, inside="", after=MUSCLE.format(""))
    return MjcfText(fromstring(text), folder / "endless.xml")


def test_compiling_ends_in_time_and_the_next_file_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(process, "LONGEST", 0.2)
    with pytest.raises(InputError, match=r"MuJoCo takes more than 0\.2 s to compile it"):
        compiled_mjcf(endless(tmp_path))
    monkeypatch.undo()
    assert fp.Robot.from_mjcf(robot_file(tmp_path, inside='<geom size="0.04"/>')).joints == ("arm",)


def test_memory_is_bounded(tmp_path):
    text = ROBOT.format(before="", inside="", after=many_motors('dyntype="user" actdim="60000000"'))
    with pytest.raises(InputError, match=r"MuJoCo refuses it: .*memory|MuJoCo ended with code|too much memory"):
        compiled_mjcf(MjcfText(fromstring(text), tmp_path / "large.xml"))
    assert fp.Robot.from_mjcf(robot_file(tmp_path, inside='<geom size="0.06"/>')).joints == ("arm",)


def test_a_process_that_was_killed_is_started_anew(tmp_path):
    fp.Robot.from_mjcf(robot_file(tmp_path, inside='<geom size="0.07"/>'))
    running = process._process
    os.kill(running._process.pid, signal.SIGKILL)
    running._process.wait()
    assert fp.Robot.from_mjcf(robot_file(tmp_path, inside='<geom size="0.08"/>')).joints == ("arm",)


INTERRUPTED = """
import signal
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background has it ignored
from test_mjcf_safety import endless
from floatplan.robot.mjcf import process
from floatplan.robot.mjcf.compiled import compiled_mjcf
asked = process.CompilerProcess._response
def tell(self, *given):
    print(self._process.pid, flush=True)
    return asked(self, *given)
process.CompilerProcess._response = tell
compiled_mjcf(endless(Path.cwd()))
"""


def test_ctrl_c_ends_it_at_once(tmp_path):
    command = [sys.executable, "-c", INTERRUPTED, str(Path(__file__).parent)]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        compiler = int(run.stdout.readline())
        run.send_signal(signal.SIGINT)
        _, errors = run.communicate(timeout=30)  # of 60 s that compiling may take
    assert run.returncode != 0
    assert "KeyboardInterrupt" in errors
    with pytest.raises(ProcessLookupError):
        os.kill(compiler, 0)
