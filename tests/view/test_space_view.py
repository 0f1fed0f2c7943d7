"""Flights in space as pictures, page and scene show them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from browser import Browser
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.robot.shapes.solids import LinkSolid
from floatplan.view import outlines
from floatplan.view.figures.figures import figures
from floatplan.view.report.data import motion_data
from floatplan.view.report.report import write_report
from floatplan.view.sampled import SampledPlan
from floatplan.view.solids import AZIMUTH, CAMERA, ELEVATION, rendered_solids


@pytest.fixture(scope="module")
def diver(planned: Callable[[str], fp.Plan]) -> fp.Plan:
    return planned("space/diver_half_twist")


@pytest.fixture(scope="module")
def arm(planned: Callable[[str], fp.Plan]) -> fp.Plan:
    return planned("space/free_ur5")


def attitudes(plan: fp.Plan, times: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(plan.at(times).orientation).as_matrix()


def world_points(plan: fp.Plan, time: float, solid: LinkSolid) -> np.ndarray:
    """Corners of a solid by Pinocchio's model of the file itself, which floatplan's pictures do not use."""
    model = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer())
    data = model.createData()
    pin.framesForwardKinematics(model, data, plan.q(time))
    own = plan.robot.model
    name = own.names[solid.body]
    placement = data.oMi[1 if solid.body == 1 else model.getJointId(name)]
    return solid.points @ placement.rotation.T + placement.translation


def test_solids_are_drawn_where_the_robot_has_them(diver: fp.Plan) -> None:
    times = np.array([0.0, 0.45, 1.1])
    poses = outlines.bodies(diver, times)
    for solid in diver.robot.solids:
        for index, time in enumerate(times):
            expected = world_points(diver, time, solid)
            np.testing.assert_allclose(poses.points(solid.body, solid.points)[index], expected, atol=1e-9)
            lowest = expected[:, 2].min() - np.linalg.norm(solid.axes, axis=0).max()
            assert poses.lowest(solid)[index] == pytest.approx(lowest, abs=1e-9)
    feet = poses.frame(diver.robot, "feet")
    np.testing.assert_allclose(feet[0], diver.problem.takeoff.position, atol=1e-9)


def test_angles_and_momentum_are_the_motion_s(diver: fp.Plan, arm: fp.Plan) -> None:
    times = np.linspace(0.0, 1.4, 57)
    columns = SampledPlan.of(diver, times).columns
    angles = np.stack([columns[f"orientation.{index}"] for index in range(3)], axis=1)
    np.testing.assert_allclose(Rotation.from_euler("YXZ", angles).as_matrix(), attitudes(diver, times), atol=1e-9)
    assert np.degrees(angles[-1]) == pytest.approx([360, 0, 180], abs=1e-6)  # not wrapped
    assert np.abs(np.diff(angles, axis=0)).max() < 1.0
    np.testing.assert_allclose(columns["momentum"], 54.7708, atol=1e-3)
    np.testing.assert_allclose(columns["momentum_base"] + columns["momentum_joints"], columns["momentum"])
    limits = diver.robot.motor_torque_limits
    np.testing.assert_allclose(columns["torque_use.3"], diver.at(times).motor_torques[:, 3] / limits[3])
    columns = SampledPlan.of(arm, times).columns  # h is zero: base and joints balance
    assert np.abs(columns["momentum"]).max() < 1e-9
    assert np.abs(columns["momentum_base"]).max() > 0.1


def test_the_page_s_robot_is_the_robot(diver: fp.Plan, browser: Browser, tmp_path: Path) -> None:
    """It plays, turns and comes nearer, places links as the plan does, and asks nothing of a network."""
    page = write_report(diver, tmp_path / "report.html")
    browser.open(page)
    browser.run("floatplan.player.pause(); floatplan.player.seek(0.5)")
    script = (
        "const m = floatplan.motion, p = m.posture(0.5);"
        "return m.data.robot.links.map(l => l.points.map(at => m.place(p, { body: l.body, at })))"
    )
    poses = outlines.bodies(diver, np.array([0.5]))
    for found, solid in zip(browser.run(script), rendered_solids(diver.robot), strict=True):
        np.testing.assert_allclose(found, poses.points(solid.body, solid.points)[0], atol=1e-6)
    state, told = (
        diver.at(0.5),
        "return [...document.querySelectorAll('.value')].map(e => [e.dataset.key, e.dataset.value])",
    )
    numbers = {key: float(value) for key, value in browser.run(told) if value}
    for index in range(7):
        assert numbers[f"velocities.{index}"] == pytest.approx(state.velocities[index], abs=1e-5)
        assert numbers[f"motor_torques.{index}"] == pytest.approx(state.motor_torques[index], abs=1e-4)
    assert numbers["momentum"] == pytest.approx(54.7708, abs=1e-3)
    assert [label for label in shown_options(browser) if label in ("forces", "angular momentum")] == [
        "angular momentum"
    ]
    assert browser.complaints() == []
    assert browser.requests() == [page.as_uri()]


def shown_options(browser: Browser) -> list[str]:
    return browser.run(
        "return [...document.querySelectorAll('#options label:not([hidden])')].map(e => e.innerText.trim())"
    )


@pytest.mark.long
def test_it_is_turned_by_mouse_by_touch_and_from_the_keyboard(diver: fp.Plan, browser: Browser, tmp_path: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    browser.open(write_report(diver, tmp_path / "report.html"))
    camera = "const { angles, zoom } = floatplan.stage.camera; return [...angles, zoom]"
    drawn = "return document.querySelector('#backdrop .trail').getAttribute('points')"
    azimuth, elevation, zoom = browser.run(camera)
    assert [azimuth, elevation] == pytest.approx([AZIMUTH, ELEVATION])
    before, stage = browser.run(drawn), browser.driver.find_element(By.ID, "stage")
    ActionChains(browser.driver).move_to_element(stage).click_and_hold().move_by_offset(-50, 30).release().perform()
    turned, raised, _ = browser.run(camera)
    assert turned - azimuth == pytest.approx(raised - elevation + 20 * 0.009, abs=0.02)
    assert browser.run(drawn) != before
    points = [{"x": x, "y": 300, "id": identity} for identity, x in enumerate((180, 220))]
    touch = "Input.dispatchTouchEvent"
    browser.driver.execute_cdp_cmd(touch, {"type": "touchStart", "touchPoints": points})
    points[0]["x"], points[1]["x"] = 140, 260
    browser.driver.execute_cdp_cmd(touch, {"type": "touchMove", "touchPoints": points})
    browser.driver.execute_cdp_cmd(touch, {"type": "touchEnd", "touchPoints": []})
    assert browser.run(camera)[2] > 1.5 * zoom
    browser.run(
        "const view = document.getElementById('view'); view.value = '-90 90'; view.dispatchEvent(new Event('change'))"
    )
    assert browser.run(camera) == pytest.approx([-np.pi / 2, np.pi / 2, 1.0])
    ActionChains(browser.driver).double_click(stage).perform()
    assert browser.run(camera) == pytest.approx([azimuth, elevation, 1.0])
    assert browser.complaints() == []


def test_obstacles_are_drawn_where_they_are(planned: Callable[[str], fp.Plan]) -> None:
    """In pictures, in the page with their faces, and in the scene; a half-space is a grid."""
    past_a_bar = planned("space/diver_past_a_bar")
    problem = past_a_bar.problem
    wall = fp.HalfSpace(point=(0, 0, 4.9), normal=(0, 0.1, -1))
    box = fp.Box(center=(2, 0, 0.4), size=(0.6, 1, 0.8), margin=0.1)
    plan = replace(past_a_bar, problem=replace(problem, obstacles=(*problem.obstacles, box, wall)))
    (ball,) = (one for one in plan.problem.obstacles if isinstance(one, fp.Sphere))
    (outline,) = outlines.obstacle_outlines(ball, 0.5, 0.1)
    middle = CAMERA(np.array(ball.center) + 0.5 * np.array(ball.velocity))
    np.testing.assert_allclose(np.abs(outline - middle).max(), ball.radius + 0.1, rtol=1e-2)
    normal = np.array(wall.unit_normal)
    on_the_wall = [line for line in outlines.grids(plan) if np.abs((line - wall.point) @ normal).max() < 1e-9]
    assert len(on_the_wall) > 6
    centre, radius = outlines.ball(plan)
    corners = np.array(box.center) + np.array(box.size) / 2
    assert np.abs(corners - centre).max() <= radius
    data = motion_data(SampledPlan.of(plan, np.linspace(0, plan.duration, 9)))
    assert len(data["obstacles"]) == 3
    bar, moved, standing = data["obstacles"]
    assert np.abs(np.array(standing["points"]) - box.center).max(axis=0) == pytest.approx(np.array(box.size) / 2)
    assert moved["window"] == [0, 0.9]
    assert np.shape(bar["grown"])[1] == 3
    assert {"clearance.0", "clearance.3"} <= data["columns"].keys()
    assert "clearance" in figures(plan)
