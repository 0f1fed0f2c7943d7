"""What messages say: each once, options as they are typed, and of each fault the file that holds it."""

import signal
import subprocess
import sys

import pytest
from places import ROOT

GYMNAST, PROBLEMS = ROOT / "urdf" / "gymnast.urdf", ROOT / "problems"
EXAMPLE = PROBLEMS / "new_configuration.toml"
ROBOT = ("plan", GYMNAST, "--start", "0,0,0", "--goal", "1,0,0", "--duration", "1")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("plan", GYMNAST), [f"command line: --{name}: is missing" for name in ("start", "goal", "duration")]),
        ((*ROBOT[:-1], "-1"), ["command line: --duration: -1.0 s is not positive"]),
        ((*ROBOT, "--start-velocities", "1,2,3"), ["command line: --start-velocities: 3 values for 2 joints"]),
        ((*ROBOT, "--takeoff", "toe"), ["command line: --takeoff: the robot has no frame 'toe'"]),
        ((*ROBOT, "--plane", "up"), ['command line: --plane: "up" is not']),
        ((*ROBOT, "--degree", "4"), ["command line: --degree: 4 is outside"]),
        ((*ROBOT, "--objective", "beauty"), ["command line: --objective: "]),
        ((*ROBOT, "--angular-momentum", "much"), ["command line: --angular-momentum: must be a number"]),
        ((*ROBOT, "--locked", "q9=1"), ['command line: --locked "q9": no joint is called']),
        (("info", GYMNAST, "--plane", "up"), ['command line: --plane: "up" is not']),
        (("plan", EXAMPLE, "--duration", "0"), ["command line: --duration: 0.0 s is not positive"]),
        (("plan", EXAMPLE, "--seed", "9" * 30), ["--seed: 9"]),
        (("plan", EXAMPLE, "--rate", "0"), ["--rate: 0.0 Hz"]),
        (("plan", EXAMPLE, "--starts", "10000"), ["--starts: 10000"]),
        (("study", PROBLEMS / "studies" / "first.toml", "--engine", "x"), ["--engine: must be"]),
    ],
)
def test_options_are_named_as_they_are_typed(floatplan, words, told):
    run = floatplan(*words)
    assert run.code == 2
    lines = run.stderr.splitlines()
    assert len(lines) == len(told)
    assert all(line.startswith(f"error: {start}") for line, start in zip(lines, told, strict=True)), lines


def test_a_file_has_the_blame_for_what_it_says_of_the_robot(floatplan, tmp_path):
    path = tmp_path / "up.toml"
    text = EXAMPLE.read_text().replace("../urdf", str(GYMNAST.parent))
    for key, value in (("plane", '"up"'), ("joints", '["q9"]'), ("locked", "{ q9 = 1 }"), ("reference", '"sitting"')):
        path.write_text(text.replace("[robot]", f"[robot]\n{key} = {value}"))
        for command in ("plan", "info"):
            run = floatplan(command, path)
            assert run.stderr.startswith(f"error: {path}: robot.{key}"), run.stderr
    path.write_text(text.replace("gymnast.urdf", "nowhere.urdf"))
    missing = f"error: {path}: robot.urdf: there is no file '{GYMNAST.parent / 'nowhere.urdf'}'"
    assert floatplan("plan", path).stderr.startswith(missing)


@pytest.mark.parametrize("command", ["init", "studio", "info"])
@pytest.mark.parametrize(
    "content", ['<link name="x"/><link name="x"/>', "", '<link name="x"><inertial><mass value="a"/></inertial></link>']
)
def test_a_refused_urdf_is_named(floatplan, tmp_path, command, content):
    path = tmp_path / "bad.urdf"
    path.write_text(f'<robot name="a">{content}</robot>')
    run = floatplan(command, path)
    assert (run.code, run.stderr.startswith(f"error: {path}: ")) == (2, True), run.stderr


def test_a_fault_is_told_once(floatplan, tmp_path):
    path = tmp_path / "wrong.toml"
    text = EXAMPLE.read_text().replace("../urdf", str(GYMNAST.parent)).split("[limits]")[0]
    text = text.replace('takeoff = { frame = "foot" }', 'takeoff = { frame = "toe" }')
    path.write_text(text.replace('landing = { frame = "foot" }\n', "") + "[limits]\ntorque = -1\n")
    lines = floatplan("plan", path).stderr.splitlines()
    assert sorted(line.split(": ")[2] for line in lines) == ["flight.takeoff.frame", "limits.torque"]


@pytest.mark.parametrize("where", ["typer", "floatplan.cli.study"])
def test_interrupted_while_it_is_imported(where):
    code = (
        "import os, signal, sys, floatplan.cli\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {where!r}: os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "floatplan.cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (128 + signal.SIGINT, "", "")
