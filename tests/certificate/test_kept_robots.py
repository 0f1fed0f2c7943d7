"""What is kept from proof to proof follows from the URDF's content and the record's roles, never from a file's name."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import pytest
from proof_plans import URDF, example_a
from proof_records import certify_record

from floatplan.certificate.planar.inertia import PlanarRobot, kept_robot, planar_robot
from floatplan.certificate.robots.kept import MOST, _kept
from floatplan.certificate.robots.urdf import read_urdf
from floatplan.errors import InputError
from floatplan.plans.record import RobotRecord


@pytest.fixture
def record(tmp_path) -> RobotRecord:
    """The robot of example A, with its file where it can be changed."""
    file = tmp_path / "robot.urdf"
    given = example_a().robot
    file.write_bytes((URDF / given.urdf.rpartition("/")[2]).read_bytes())
    return replace(given, urdf=str(file))


def kept(file: Path, record: RobotRecord) -> PlanarRobot:
    return kept_robot(file.read_bytes(), file, record)


def heavier(record: RobotRecord, file) -> RobotRecord:
    """Change every mass in the file; the record is of the file as it is then."""
    text = re.sub(r'<mass value="([^"]+)"', lambda m: f'<mass value="{2 * float(m[1])}"', file.read_text())
    file.write_text(text)
    return replace(record, sha256=hashlib.sha256(file.read_bytes()).hexdigest())


def test_the_same_content_and_roles_are_read_once(record, tmp_path):
    file = tmp_path / "robot.urdf"
    (tmp_path / "again.urdf").write_bytes(file.read_bytes())
    assert kept(file, record) is kept(tmp_path / "again.urdf", record)


def test_another_content_under_the_same_name_is_another_robot(record, tmp_path):
    file = tmp_path / "robot.urdf"
    before = kept(file, record)
    changed = heavier(record, file)
    after = kept(file, changed)
    anew = planar_robot(read_urdf(file.read_bytes(), file), changed)
    assert (after.inertia.re.mid == anew.inertia.re.mid).all()
    assert (after.inertia.re.mid != before.inertia.re.mid).any()
    with pytest.raises(InputError, match="SHA-256 differs"):
        kept(file, record)


def test_other_roles_are_another_robot(record, tmp_path):
    file, first, last = tmp_path / "robot.urdf", record.joints[0], record.joints[-1]
    whole = kept(file, record)
    locked = [replace(record, joints=record.joints[:-1], locked={last: angle}) for angle in (0.0, 0.5, -0.5)]
    coupling = {"leader": first, "ratio": 0.5, "offset": 0.0}
    coupled = replace(record, joints=record.joints[:-1], coupled={last: coupling})
    others = [kept(file, each) for each in (*locked, coupled, replace(record, joints=record.joints[::-1]))]
    assert len({id(robot) for robot in (whole, *others)}) == 6
    assert kept(file, replace(locked[1])) is others[1]


def test_the_file_is_looked_at_every_time(record, tmp_path):
    plan = replace(example_a(), robot=record)
    assert certify_record(plan).verdict == certify_record(plan).verdict == certify_record(example_a()).verdict
    heavier(record, tmp_path / "robot.urdf")
    with pytest.raises(InputError, match="SHA-256 differs"):
        certify_record(plan)
    (tmp_path / "robot.urdf").unlink()
    with pytest.raises(InputError, match="no such file"):
        certify_record(plan)


def test_no_more_than_a_few_are_kept(record, tmp_path):
    last = record.joints[-1]
    for step in range(2 * MOST):
        kept(tmp_path / "robot.urdf", replace(record, joints=record.joints[:-1], locked={last: 0.1 * step}))
        assert len(_kept) <= MOST
