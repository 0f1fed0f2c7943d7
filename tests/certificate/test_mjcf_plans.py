"""Plans of robots from MJCF, proved by the certificate's own reader: it and the planner's read the same robot."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mjcf_samples import RandomModel
from proof_plans import draw_coefficients, make_plan

import floatplan as fp
from floatplan.certificate.planar.inertia import kept_robot
from floatplan.errors import InputError

KANGAROO = Path(__file__).parents[2] / "urdf" / "kangaroo.xml"
LEG = '<body name="shank" pos="0.22 0 -0.2">'


def flight(robot: fp.Robot, **more) -> fp.Problem:
    """A flight from one posture to another, with an obstacle to look at."""
    low, high = robot.position_limits.T
    ends = (low + share * (high - low) for share in (0.4, 0.5))
    postures = (fp.Posture(angle, positions) for angle, positions in zip((0.1, 0.3), ends, strict=True))
    far = fp.Circle(center=(3.0, 3.0), radius=0.2)
    return fp.Problem(robot, *postures, fp.Flight(duration=0.7), obstacles=[far], **more)


@pytest.fixture
def split(tmp_path) -> Path:
    """The kangaroo, its leg in a file that it includes."""
    head, leg, tail = re.split(r"(<body name=\"shank\".*?</body>\s*</body>)", KANGAROO.read_text(), flags=re.DOTALL)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "leg.xml").write_text(f"<mujocoinclude>{leg}</mujocoinclude>")
    file = tmp_path / "kangaroo.xml"
    file.write_text(f'{head}<include file="parts/leg.xml"/>{tail}')
    return file


class TestKangaroo:
    def test_a_plan_is_proved_and_no_number_of_its_files_may_change(self, split, tmp_path):
        plan = fp.plan(flight(fp.Robot.from_mjcf(split), limits=fp.Limits(torque="urdf")), prove=True)
        assert plan.certificate.proved
        file = plan.save(tmp_path / "plan.json")
        assert fp.certify(file).proved
        for changed in (split, tmp_path / "parts" / "leg.xml"):
            text = changed.read_text()
            number = re.search(r'(?:fromto|pos)="(-?[0-9.]+)', text).group(1)
            changed.write_text(text.replace(number, f"{float(number) + 1e-9:.10f}", 1))
            with pytest.raises(InputError, match=r"SHA-256 differs|has changed"):
                fp.certify(file)
            changed.write_text(text)
        assert fp.certify(file).proved

    def test_an_include_whose_hash_is_not_recorded_is_not_read(self, split):
        plan = fp.plan(replace(flight(fp.Robot.from_mjcf(split)), obstacles=()))
        record = plan.record
        assert set(record.robot.meshes) == {"parts/leg.xml"}
        unknown = replace(record, robot=replace(record.robot, meshes={}))
        certificate = fp.certify(unknown)
        (finding,) = certificate.findings
        assert (certificate.verdict, finding.label) == (
            "undecided",
            'robot: the included "parts/leg.xml" is not read: it has no hash of its own in the plan',
        )

    def test_a_limit_that_its_actuators_give_is_proved(self):
        robot = fp.Robot.from_mjcf(KANGAROO)
        plan = fp.plan(flight(robot, limits=fp.Limits(torque="urdf")), prove=True)
        limits = {
            finding.subject[0]: finding.limit for finding in plan.certificate.findings if finding.kind == "torque"
        }
        assert limits == dict(zip(robot.joints, robot.torque_limits.tolist(), strict=True))


class TestNotRead:
    """A robot that the planner reads and the certificate does not: its plans stay, undecided."""

    @pytest.fixture
    def file(self, tmp_path) -> Path:
        corners = "0 0 0  0.1 0 0  0 0.1 0  0 0 -0.3"
        mesh = f'<asset><mesh name="shin" vertex="{corners}"/></asset><worldbody>'
        text = KANGAROO.read_text().replace("<worldbody>", mesh, 1)
        file = tmp_path / "meshed.xml"
        file.write_text(
            re.sub(r'<geom name="shank"[^>]*>', '<geom type="mesh" mesh="shin" contype="0" conaffinity="0"/>', text)
        )
        write_mesh(tmp_path / "shin.obj", corners)
        file.write_text(file.read_text().replace(f'name="shin" vertex="{corners}"', 'name="shin" file="shin.obj"'))
        return file

    def test_its_plan_is_undecided_and_says_why(self, file, tmp_path, floatplan):
        plan = fp.plan(replace(flight(fp.Robot.from_mjcf(file)), obstacles=()), prove=True)
        assert plan.ok
        assert plan.certificate.verdict == "undecided"
        reason = 'robot: body "shank": inertia from a mesh is not read'
        assert plan.explanation.endswith(f"Not proved: {reason}.")
        saved = fp.load_plan(plan.save(tmp_path / "plan.json"))
        assert [finding.label for finding in saved.certificate.findings] == [reason]
        assert not np.isfinite(saved.certificate.torque_peak).any()
        done = floatplan("certify", tmp_path / "plan.json", "--json")
        assert (done.code, json.loads(done.stdout)["verdict"]) == (1, "undecided")
        assert "inertia from a mesh" in " ".join(floatplan("certify", tmp_path / "plan.json").stdout.split())


def write_mesh(file: Path, corners: str) -> None:
    numbers = corners.split()
    places = [f"v {' '.join(numbers[first : first + 3])}" for first in range(0, len(numbers), 3)]
    file.write_text("\n".join([*places, "f 1 3 2", "f 1 2 4", "f 2 3 4", "f 1 4 3"]))


def drawn_case(tmp_path: Path, seed: int) -> bool:
    """A motion of a random robot, with joints coupled and locked, is proved; False where none can be planned."""
    file, rng = tmp_path / "random.xml", np.random.default_rng(seed)
    file.write_bytes(RandomModel(seed, planar=True).xml)
    try:
        robot = fp.Robot.from_mjcf(file, plane="xz")
        if len(robot.joints) > 3:
            leader, locked, *_, follower = robot.joints
            robot = fp.Robot.from_mjcf(
                file, plane="xz", locked={locked: 0.3}, coupled={follower: fp.Coupling(leader, 0.5, 0.2)}
            )
    except InputError as error:
        if error.element != "joints" and "singular" not in error.reason:  # no joint, or two about one axis
            raise
        return False
    frames = tuple(map(str, rng.choice(list(robot.frames), 2)))
    coefficients = draw_coefficients(rng, len(robot.joints), 0.7)
    record = make_plan(robot, coefficients, duration=0.7, frames=frames, instants=20001)
    proved = kept_robot(file.read_bytes(), file, record.robot)
    assert set(proved.frames) == set(robot.frames)
    assert proved.with_collision == {shape.link for shape in robot.shapes}
    assert fp.certify(record).proved
    return True


@pytest.mark.parametrize("seed", [11])
def test_a_drawn_motion_is_proved(tmp_path, seed):
    assert drawn_case(tmp_path, seed)


@pytest.mark.long
def test_drawn_motions_of_many_robots_are_proved(tmp_path):
    assert sum(drawn_case(tmp_path, seed) for seed in range(16)) > 8
