"""Links without geometry are segments, and planner and certificate see the same ones: also above locked slides."""

from dataclasses import replace

import numpy as np
import pytest
from proof_plans import draw_coefficients, make_plan
from proof_records import certify_record
from robot_samples import joint, robot_text

from floatplan.certificate.planar.clearance import shape_weights
from floatplan.certificate.planar.inertia import kept_robot
from floatplan.plans.plan import rebuild
from floatplan.robot.robot import Robot

SLIDE = (0.3, -0.4)  # [m] horizontal, vertical: where a locked prismatic joint holds its child


def slider(folder, position):
    """Links a, b, c; b slides on a along (0.6, -0.8), and c turns on b. Nothing has geometry."""
    axis = f'<axis xyz="{SLIDE[0] / 0.5} 0 {SLIDE[1] / 0.5}"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
    ends = '<parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/>'
    slide = f'<joint name="s" type="prismatic">{ends}{axis}</joint>'
    path = folder / "slider.urdf"
    path.write_text(robot_text(slide, joint("j", "b", "c"), links="abc"))
    return Robot.from_urdf(path, plane="xz", locked={"s": position})


@pytest.mark.parametrize("position", [0.0, 0.5, -0.25])
def test_a_link_ends_where_the_urdf_puts_its_childrens_joints(tmp_path, position):
    """Also where one of them is a locked prismatic joint: what it slides along is the child's."""
    robot = slider(tmp_path, position)
    at = complex(*SLIDE) / 0.5 * position
    wanted = [("a", 0j, 0.3 + 0j), ("b", 0.3 + at, 0.3 + 0j), ("b", 0.3 + at, 0.6 + at), ("c", 0.6 + at, 0.6 + at)]
    wanted = [item for item in wanted if item[0] == "c" or item[1] != item[2]]

    def places(segments):
        return sorted(
            (link, *(round(part, 12) + 0.0 for end in ends for part in (end.real, end.imag)))
            for link, *ends in segments
        )

    anchors = [0j, complex(robot.tree.anchor[1])]
    planned = [(s.link, s.start + anchors[s.body], s.end + anchors[s.body]) for s in robot.shapes]
    assert places(planned) == places(wanted)
    record = make_plan(robot, draw_coefficients(np.random.default_rng(2), 1, 0.7), duration=0.7)
    proved = kept_robot(robot.path.read_bytes(), robot.path, record.robot)
    center = sum(proved.weights[0])  # of mass, at planned positions zero, from the root's origin and turned round
    seen = [
        (shape.link, *(complex(sum(proved.weights[end.body]) - center + end.local) for end in (shape.start, shape.end)))
        for shape in shape_weights(proved, None).shapes
    ]
    seen = [(link, *(complex(end.real, proved.sigma * end.imag) for end in ends)) for link, *ends in seen]
    assert places(seen) == places(wanted)


def test_an_obstacle_beside_a_slide_is_judged_by_the_same_segments(tmp_path):
    """A circle on the slide, where neither the parent's nor the child's own segment is."""
    robot = slider(tmp_path, 0.5)
    coefficients = 0.1 * draw_coefficients(np.random.default_rng(2), 1, 0.2)
    base = make_plan(robot, coefficients, duration=0.2, angular_momentum=0.0, orientation=0.0, velocity=(0.0, 0.0))
    hit = {"kind": "circle", "center": [0.3 + SLIDE[0] / 2, SLIDE[1] / 2], "radius": 0.01, "window": [0.0, 0.02]}
    record = replace(base, problem=base.problem | {"obstacles": [hit]}, clearance_min=0.0)
    assert certify_record(record).verdict == "refuted"
    beside = hit | {"center": [0.3 + SLIDE[0], 0.0]}
    clearance = certify_record(
        replace(base, problem=base.problem | {"obstacles": [beside]}, clearance_min=0.0)
    ).clearance_min
    record = replace(base, problem=base.problem | {"obstacles": [beside]}, clearance_min=clearance)
    assert certify_record(record).proved
    assert rebuild(record).peaks.clearance == pytest.approx(clearance, abs=1e-5)
