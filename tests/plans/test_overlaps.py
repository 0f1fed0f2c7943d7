"""Links that overlap are said, by their true shapes in space; what is apart, overlaps at rest or is a joint, is not."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

import floatplan as fp
from floatplan.plans.overlaps import overlaps
from floatplan.robot.link_pairs import link_pairs

LINK = """<link name="{name}">
  <inertial><mass value="1"/><origin xyz="{half} 0 0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  {collision}
</link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
  <axis xyz="0 1 0"/><limit lower="-3.1" upper="3.1" effort="9" velocity="9"/></joint>"""


def bar(length, radius=0.03):
    """A cylinder along x from the origin."""
    placed = f'<origin xyz="{length / 2} 0 0" rpy="0 1.5707963267948966 0"/>'
    return f'<collision>{placed}<geometry><cylinder radius="{radius}" length="{length}"/></geometry></collision>'


SPECK = '<collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.001"/></geometry></collision>'


def ball(x, radius=0.05):
    return f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def chain(folder, shapes, sideways=0.0, length=0.4, **choices):
    """Links one behind the other along x, each ``sideways`` of the one before; all turn about y."""
    names = [f"link{number}" for number in range(len(shapes))]
    parts = [
        LINK.format(name=name, half=length / 2, collision=shape) for name, shape in zip(names, shapes, strict=True)
    ]
    parts += [
        JOINT.format(name=f"q{number}", parent=parent, child=child, at=f"{length} {sideways} 0")
        for number, (parent, child) in enumerate(itertools.pairwise(names), 1)
    ]
    path = folder / f"chain{len(shapes)}_{sideways}.urdf"
    path.write_text(f'<robot name="chain">{"".join(parts)}</robot>')
    return fp.Robot.from_urdf(path, **choices)


def straight(*ends):
    """Positions that go from one posture to another in a second."""
    first, last = map(np.asarray, ends)
    return lambda times: first + np.asarray(times)[:, None] * (last - first)


class TestDepth:
    """Against distances between balls and lines, by hand."""

    def test_of_two_balls_that_close(self, tmp_path):
        """Balls at both ends of a chain of three: their middles are apart by what the angles make."""
        robot = chain(tmp_path, [ball(0.0), SPECK, ball(0.37)])
        bent = np.array([2.0, 2.0])
        (found,) = overlaps(robot, straight([0.5, 0.5], bent), 1.0)
        least = min(
            abs(0.4 + 0.4 * np.exp(1j * a) + 0.37 * np.exp(1j * (a + b)))
            for a, b in np.linspace([0.5, 0.5], bent, 4001)
        )
        assert set(found.links) == {"link0", "link2"}
        assert found.depth == pytest.approx(0.1 - least, abs=2e-4)
        assert found.reference_depth == 0.0


class TestWhatIsNoOverlap:
    def test_beside_one_another(self, tmp_path):
        """What crosses in the plane's view passes at its side in space."""
        motion = straight([0.0, 0.0], [2.6, 2.6])
        shapes = [bar(0.4)] * 3
        assert overlaps(chain(tmp_path, shapes), motion, 1.0)
        assert not overlaps(chain(tmp_path, shapes, sideways=0.08), motion, 1.0)

    def test_at_the_joint(self, tmp_path):
        """Neighbours are in one another at their joint at any angle; with the far half only where it folds."""
        robot = chain(tmp_path, [bar(0.45), bar(0.4)])
        assert not overlaps(robot, straight([0.0], [2.5]), 1.0)
        (found,) = overlaps(robot, straight([0.0], [3.05]), 1.0)
        assert found.joint == "q1"

    def test_what_is_as_deep_at_rest(self, tmp_path):
        """Balls that are in one another wherever the joint between the others turns."""
        robot = chain(tmp_path, [ball(0.1, 0.1), SPECK, ball(0.0, 0.1)], length=0.05)
        deep = link_pairs(robot).distances(np.zeros((1, 2)))
        assert deep.min() < -0.05
        assert not overlaps(robot, straight([0.0, 0.0], [0.1, 0.1]), 1.0)


class TestWarning:
    def problem(self, robot, **parts):
        folded = fp.Posture(0.6, [0.0, 3.05])
        return fp.Problem(robot, fp.Posture(0.0, [0.0, 0.4]), folded, fp.Flight(0.8), **parts)

    def test_of_a_plan_names_both_links_and_the_depth(self):
        plan = fp.plan(self.problem(fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf")))
        (warning,) = [each for each in plan.warnings if each.kind == "overlap"]
        assert set(warning.subject.split()) == {"body1", "body2"}
        assert (warning.unit, warning.limit) == ("m", 0.0)
        assert warning.value > 0.02
        assert "as the bars that are drawn" in warning.message
        assert "limits.position of q2" in warning.message
        assert warning.to_dict() in list(plan.record.warnings)

    def test_of_links_that_self_clearance_is_asked_for(self):
        """The pair that is kept apart is not measured as it is drawn; the others are."""
        robot = fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf")
        asked = replace(self.problem(robot), self_clearances=(fp.SelfClearance(("body0", "body2")),))
        assert [each.kind for each in fp.plan(asked).warnings] == ["overlap"]


class TestBeyondSense:
    """What a flight of a blink takes of a robot whose file gives no limits."""

    @pytest.mark.parametrize("duration", [0.02, 0.035])
    def test_torques_and_rates(self, duration):
        robot = fp.Robot.from_urdf(ROOT / "urdf" / "gymnast.urdf")
        ends = fp.Posture(0.0, [0.3, 0.2]), fp.Posture(1.5, [-1.0, 0.5])
        plan = fp.plan(fp.Problem(robot, *ends, fp.Flight(duration, gravity=0.0)))
        found = {each.kind: each for each in plan.warnings}
        assert found["torque"].value == pytest.approx(plan.peaks.motor_torque.max())
        assert found["velocity"].value == pytest.approx(plan.peaks.velocity.max())
        weight_times_length = robot.mass * 9.80665 * robot.rod_length
        assert found["torque"].limit == pytest.approx(2 * weight_times_length)
