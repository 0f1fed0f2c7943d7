"""Inertias of rotors from ``<rotor_params>`` of an SRDF file: the default of ``armature``."""

import json

import numpy as np
import pinocchio as pin
import pytest
from robot_samples import TWO_LINKS, joint, robot_text

import floatplan as fp
from floatplan.plans.reading import recorded_robot
from floatplan.problem.file import load_robot, save_problem

PAIR = robot_text(joint("j", "a", "b"), joint("k", "b", "c"), joint("s", "a", "d", kind="prismatic"), links="abcd")
HEAD = '<robot name="sample"><rotor_params>'
TAIL = "</rotor_params></robot>"


def rotor(name, mass, gear):
    return f'<joint name="{name}" mass="{mass}" gear_ratio="{gear}"/>'


BOTH = f"{HEAD}{rotor('j', 2e-5, 30)}{rotor('k', 1.5e-5, -80)}{TAIL}"
FELT = {"j": 2e-5 * 30**2, "k": 1.5e-5 * 80**2}


def written(folder, srdf, *, urdf=PAIR, name="robot.srdf"):
    (folder / "robot.urdf").write_text(urdf)
    if srdf is not None:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(srdf)
    return folder / "robot.urdf"


@pytest.mark.parametrize("name", ["robot.srdf", "other.srdf"])
def test_they_are_what_pinocchio_reads(tmp_path, name):
    path = written(tmp_path, BOTH, name=name)
    robot = fp.Robot.from_urdf(path)
    assert robot.armature == pytest.approx(FELT)
    assert robot.rotor_file == tmp_path / name
    model = pin.buildModelFromUrdf(str(path))
    assert pin.loadRotorParameters(model, str(tmp_path / name), False)
    felt = model.rotorInertia * model.rotorGearRatio**2
    own = [robot.model.armature[robot.model.joints[robot.model.getJointId(each)].idx_v] for each in ("j", "k")]
    theirs = [felt[model.joints[model.getJointId(each)].idx_v] for each in ("j", "k")]
    assert own == pytest.approx(theirs)


@pytest.mark.parametrize(
    ("armature", "expected"),
    [(0.0, {"j": 0.0, "k": 0.0}), (0.3, {"j": 0.3, "k": 0.3}), ({"k": 0.2}, {"k": 0.2}), ({}, {})],
)
def test_what_is_asked_comes_before_all_of_them(tmp_path, armature, expected):
    robot = fp.Robot.from_urdf(written(tmp_path, BOTH), armature=armature)
    assert dict(robot.armature) == expected
    assert robot.rotor_file is None


def test_what_the_urdf_gives_comes_before_them(tmp_path):
    urdf = PAIR.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics armature="0.004"/>', 1)
    assert fp.Robot.from_urdf(written(tmp_path, BOTH, urdf=urdf)).armature == pytest.approx(FELT | {"j": 0.004})


LOCKED = ("locked, because joints that slide are not planned: s = 0 m",)
WRONG = {
    "not XML": "<robot",
    "another root": "<mujoco/>",
    "a text": f"{HEAD}{rotor('j', 'light', 30)}{rotor('k', 1e-5, 30)}{TAIL}",
    "no gear": f'{HEAD}<joint name="j" mass="1e-5"/>{TAIL}',
    "negative": f"{HEAD}{rotor('j', -1e-5, 30)}{TAIL}",
    "too large": f"{HEAD}{rotor('j', 1e5, 1e5)}{TAIL}",
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_one_is_left_out_with_a_word(tmp_path, name):
    """A robot that is read alone is read beside it too."""
    robot = fp.Robot.from_urdf(written(tmp_path, WRONG[name]))
    assert not robot.armature
    (warning,) = (each for each in robot.warnings if each not in LOCKED)
    assert warning.startswith("rotors of robot.srdf are left out: ")


def test_plans_of_before_and_after_keep_their_rotors(tmp_path):
    """A plan file says what its rotors are; an SRDF file that comes later changes nothing."""
    path = written(tmp_path, None)
    ends = {"start": fp.Posture(0.0, [0.1, 0.2]), "goal": fp.Posture(0.3, [0.9, 0.5])}
    problem = {**ends, "flight": fp.Flight(duration=0.5)}
    before = fp.plan(fp.Problem(fp.Robot.from_urdf(path), **problem)).save(tmp_path / "before.json")
    written(tmp_path, BOTH)
    with_rotors = fp.Problem(fp.Robot.from_urdf(path), **problem)
    after = fp.plan(with_rotors, prove=True)
    assert after.certificate.proved
    file = after.save(tmp_path / "after.json")
    assert not fp.load_plan(before).robot.armature
    assert fp.certify(before).proved
    assert fp.load_plan(file).robot.armature == pytest.approx(FELT)
    assert fp.replay(file).orientation_error < 1e-6
    (tmp_path / "robot.srdf").unlink()
    assert recorded_robot(after.record.robot, file).armature == pytest.approx(FELT)
    assert fp.certify(file).proved
    content = json.loads(file.read_text())
    content["robot"]["armature"] = {}
    file.write_text(json.dumps(content))
    assert not fp.certify(file).proved
    torques = np.abs(fp.plan(with_rotors).at(0.25).torques)
    assert torques == pytest.approx(np.abs(after.at(0.25).torques))


def test_problem_files_that_are_written_hold_them(tmp_path):
    robot = fp.Robot.from_urdf(written(tmp_path, BOTH))
    problem = fp.Problem(robot, fp.Posture(0.0, [0.1, 0.2]), fp.Posture(0.3, [0.9, 0.5]), fp.Flight(duration=0.5))
    file = save_problem(problem, tmp_path / "problem.toml")
    (tmp_path / "robot.srdf").unlink()
    assert load_robot(file).armature == pytest.approx(FELT)


def test_info_says_where_they_are_from(tmp_path, floatplan):
    path = written(tmp_path, BOTH)
    shown = " ".join(floatplan("info", path).stdout.split())
    assert "armature, kg m^2 j = 0.018, k = 0.096; rotor_params of robot.srdf, unless armature is given" in shown
    facts = json.loads(floatplan("info", path, "--json").stdout)
    assert facts["armature"] == pytest.approx(FELT)
    assert facts["rotor_file"] == str(tmp_path / "robot.srdf")
    (tmp_path / "two.urdf").write_text(TWO_LINKS)
    assert "armature" not in floatplan("info", tmp_path / "two.urdf").stdout
