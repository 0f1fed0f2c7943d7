"""Plans of robots from MJCF: proved of the URDF that the plan file holds, and of nothing else."""

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from mjcf_samples import RandomModel
from places import URDF
from proof_plans import draw_coefficients, make_plan

import floatplan as fp
from floatplan.certificate.planar.inertia import cached_robot
from floatplan.errors import InputError

KANGAROO = URDF / "kangaroo.xml"


def flight(robot, **more):
    """A flight from one posture to another, with an obstacle to look at."""
    low, high = robot.position_limits.T
    ends = (low + share * (high - low) for share in (0.4, 0.5))
    postures = (fp.Posture(angle, positions) for angle, positions in zip((0.1, 0.3), ends, strict=True))
    far = fp.Circle(center=(3.0, 3.0), radius=0.2)
    return fp.Problem(robot, *postures, fp.Flight(duration=0.7), obstacles=[far], **more)


@pytest.fixture
def split(tmp_path):
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

    def test_the_urdf_in_the_file_is_what_is_proved(self, tmp_path):
        """A URDF that is changed is refused by its digest; one that has its digest is proved or refuted itself."""
        problem = replace(flight(fp.Robot.from_mjcf(KANGAROO)), obstacles=())
        file = fp.plan(problem, prove=True).save(tmp_path / "plan.json")
        certificate = fp.certify(file)
        (said,) = [finding for finding in certificate.findings if finding.kind == "resolved"]
        assert certificate.proved
        assert said.label == "robot.resolved: the proof is of this URDF, not of the MJCF that it was made from"
        assert fp.load_plan(file).certificate.findings == certificate.findings
        written = file.read_text()
        content = json.loads(written)
        resolved = content["robot"]["resolved"]
        assert resolved["sha256"] == hashlib.sha256(resolved["urdf"].encode()).hexdigest()
        mass = re.search(r'mass value="([^"]*)"', resolved["urdf"]).group(1)
        resolved["urdf"] = resolved["urdf"].replace(mass, repr(1.1 * float(mass)), 1)
        file.write_text(json.dumps(content))
        with pytest.raises(InputError, match=r"robot\.resolved\.urdf: its SHA-256 differs"):
            fp.certify(file)
        resolved["sha256"] = hashlib.sha256(resolved["urdf"].encode()).hexdigest()
        file.write_text(json.dumps(content))
        assert fp.certify(file).verdict == "refuted"
        resolved["urdf"] = "<robot"
        resolved["sha256"] = hashlib.sha256(b"<robot").hexdigest()
        file.write_text(json.dumps(content))
        with pytest.raises(InputError, match=r"robot\.resolved\.urdf: is not well-formed"):
            fp.certify(file)

    def test_shapes_of_another_urdf_prove_nothing(self, tmp_path):
        file = fp.plan(flight(fp.Robot.from_mjcf(KANGAROO))).save(tmp_path / "plan.json")
        content = json.loads(file.read_text())
        resolved = content["robot"]["resolved"]
        resolved["urdf"] = resolved["urdf"].replace('radius="0.09"', 'radius="0.08"')
        resolved["sha256"] = hashlib.sha256(resolved["urdf"].encode()).hexdigest()
        file.write_text(json.dumps(content))
        certificate = fp.certify(file)
        (finding,) = certificate.findings
        assert certificate.verdict == "undecided"
        assert "robot.resolved is another" in finding.label

    def test_a_file_without_it_is_undecided(self):
        record = fp.plan(replace(flight(fp.Robot.from_mjcf(KANGAROO)), obstacles=())).record
        certificate = fp.certify(replace(record, robot=replace(record.robot, resolved=None)))
        (finding,) = certificate.findings
        assert certificate.verdict == "undecided"
        assert finding.label.startswith("robot: the MJCF is not read: the plan file does not hold the URDF")


def test_an_inertia_from_a_mesh_is_proved(tmp_path):
    """It is as MuJoCo's compiler has it, in the URDF that the plan file holds."""
    corners = "0 0 0  0.1 0 0  0 0.1 0  0 0 -0.3"
    write_mesh(tmp_path / "shin.obj", corners)
    mesh = '<asset><mesh name="shin" file="shin.obj"/></asset><worldbody>'
    text = KANGAROO.read_text().replace("<worldbody>", mesh, 1)
    geom = '<geom type="mesh" mesh="shin" contype="0" conaffinity="0"/>'
    file = tmp_path / "meshed.xml"
    file.write_text(re.sub(r'<geom name="shank"[^>]*>', geom, text))
    plan = fp.plan(replace(flight(fp.Robot.from_mjcf(file)), obstacles=()), prove=True)
    assert plan.certificate.proved


def write_mesh(file, corners):
    numbers = corners.split()
    places = [f"v {' '.join(numbers[first : first + 3])}" for first in range(0, len(numbers), 3)]
    file.write_text("\n".join([*places, "f 1 3 2", "f 1 2 4", "f 2 3 4", "f 1 4 3"]))


def drawn_case(tmp_path, seed):
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
    proved = cached_robot(file.read_bytes(), file, record.robot)
    assert set(proved.frames) == set(robot.frames)
    assert proved.with_collision == {shape.link for shape in robot.shapes}
    assert fp.certify(record).proved
    return True


@pytest.mark.parametrize("seed", [11])
def test_a_drawn_motion_is_proved(tmp_path, seed):
    assert drawn_case(tmp_path, seed)


@pytest.mark.long
def test_drawn_motions_of_many_robots_are_proved(tmp_path):
    assert sum(drawn_case(tmp_path, seed) for seed in range(8)) > 4
