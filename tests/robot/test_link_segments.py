"""Links without geometry are segments, and planner and certificate see the same ones: also above locked slides."""

from dataclasses import replace

import numpy as np
import pytest
from proof_plans import draw_coefficients, make_plan
from proof_records import certify_record
from robot_samples import joint, robot_text

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
