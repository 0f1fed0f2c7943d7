"""The certificate and the mesh files: proved are the shapes of the files that the plan was made with, or nothing."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from proof_plans import draw_coefficients, make_plan
from robot_samples import inertial, joint

import floatplan as fp
from floatplan.errors import InputError
from floatplan.plans.plan import load_plan
from floatplan.plans.reading import load_record
from floatplan.robot import Robot

MESH = "package://meshes/part.stl"
SPHERE = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'


def write_mesh(folder, size=0.2):
    (folder / "meshes").mkdir(exist_ok=True)
    trimesh.creation.box((size, size, size)).export(folder / "meshes" / "part.stl")


def clear_plan(folder, **asked):
    """The file of a plan whose links, one of them a box from a mesh, stay clear of a circle."""
    write_mesh(folder)
    part = f'<collision><geometry><mesh filename="{MESH}"/></geometry></collision>'
    links = f'<link name="a">{inertial()}{part}</link><link name="b">{inertial()}{SPHERE}</link>'
    (folder / "robot.urdf").write_text(f'<robot name="r">{links}{joint("j", "a", "b")}</robot>')
    robot = Robot.from_urdf(folder / "robot.urdf")
    record = make_plan(robot, draw_coefficients(np.random.default_rng(1), 1, 0.6), duration=0.6)
    circle = {"kind": "circle", "center": [3.0, 3.0], "radius": 0.5, "margin": 0.0}
    record = replace(record, problem=record.problem | ({"obstacles": [circle]} | asked))
    if record.problem["obstacles"]:
        distances = fp.certify(replace(record, clearance_min=0.0))
        record = replace(record, clearance_min=distances.clearance_min)
    return record.save(folder / "plan.json")


def without_hashes(path):
    content = json.loads(path.read_text())
    del content["robot"]["meshes"]
    path.write_text(json.dumps(content))
    return path


def test_the_hash_of_the_mesh_is_in_the_plan(tmp_path):
    path = clear_plan(tmp_path)
    assert list(load_record(path).robot.meshes) == [MESH]
    assert fp.certify(path).proved
    assert load_plan(path).robot.meshes == load_record(path).robot.meshes


def test_a_mesh_that_grew_is_refused(tmp_path):
    path = clear_plan(tmp_path)
    write_mesh(tmp_path, 2.0)
    for judge in (fp.certify, load_plan, lambda path: fp.certify(load_record(path))):
        with pytest.raises(InputError, match="collision mesh has changed") as caught:
            judge(path)
        assert caught.value.element == f"robot.meshes of {MESH}"


def test_a_mesh_that_is_gone_is_refused(tmp_path):
    path = clear_plan(tmp_path)
    (tmp_path / "meshes" / "part.stl").unlink()
    for judge in (fp.certify, load_plan):
        with pytest.raises(InputError, match="not found") as caught:
            judge(path)
        assert caught.value.source == str(path)


def test_a_mesh_without_a_hash_leaves_clearance_undecided(tmp_path):
    certificate = fp.certify(without_hashes(clear_plan(tmp_path)))
    assert certificate.verdict == "undecided"
    assert certificate.clearance_min is None
    verdicts = {finding.label: finding.verdict for finding in certificate.findings}
    open_questions = {label for label, verdict in verdicts.items() if verdict == "undecided"}
    assert open_questions == {f"hash of mesh {MESH}", "obstacles[0] circle", "recorded clearance_min"}
    assert json.loads(json.dumps(certificate.to_dict()))["verdict"] == "undecided"


def test_a_mesh_that_changes_between_two_looks_is_noticed(tmp_path):
    clear_plan(tmp_path)
    robot = Robot.from_urdf(tmp_path / "robot.urdf")
    assert list(robot.meshes) == [MESH]
    write_mesh(tmp_path, 2.0)
    with pytest.raises(InputError, match="has changed since the robot was read"):
        _ = robot.shapes


def test_a_plan_that_is_alive_is_judged_by_the_mesh_that_it_was_made_with(tmp_path):
    plan = load_plan(clear_plan(tmp_path))
    assert plan.clearances(0.0) > 0
    write_mesh(tmp_path, 2.0)
    assert fp.certify(plan).proved
    with pytest.raises(InputError, match="has changed"):
        load_plan(plan.save(tmp_path / "again.json"))
