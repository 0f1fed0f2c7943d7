"""A jump in space as pictures, page and scene show it: the jump's own numbers, by an independent model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from browser import Browser
from jumps import roll
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.jumps.spatial.jump import SpatialJump
from floatplan.view import outlines
from floatplan.view.figures import animation
from floatplan.view.figures.snapshots import moments as strip
from floatplan.view.jumps import footing, moments
from floatplan.view.report.data import sample_grid
from floatplan.view.report.report import report_data, write_report
from floatplan.view.solids import CAMERA, rendered_solids


@pytest.fixture(scope="module")
def view() -> SpatialJump:
    return roll()


@pytest.fixture(scope="module")
def data(view: SpatialJump) -> Any:
    return report_data(view)


def column(data: Any, key: str) -> Any:
    return np.array(data["motion"]["columns"][key], dtype=np.float64)


def test_the_page_has_the_jump_s_numbers(view: SpatialJump, data: Any) -> None:
    """Attitude, places, forces and shares of limits, in the coordinates of the file's own model."""
    times = sample_grid(view.duration)
    model = pin.buildModelFromUrdf(str(view.robot.path), pin.JointModelFreeFlyer())
    q = view.q(times)
    com = np.array([pin.centerOfMass(model, model.createData(), row) for row in q])
    close: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-8}
    for letter, values in zip("xyz", com.T, strict=True):
        np.testing.assert_allclose(column(data, f"com_{letter}"), values, **close)
    np.testing.assert_allclose(column(data, "com_height"), com[:, 2] - view.ground, **close)
    angles = np.stack([column(data, f"orientation.{index}") for index in range(3)], axis=1)
    attitudes = Rotation.from_quat(q[:, 3:7]).as_matrix()
    np.testing.assert_allclose(Rotation.from_euler("XYZ", angles).as_matrix(), attitudes, atol=1e-8)
    assert np.degrees(angles[[0, -1], 0]) == pytest.approx([0.0, 360.0], abs=1e-6)  # not wrapped
    assert np.abs(np.diff(angles, axis=0)).max() < 0.2
    forces = view.forces(times)
    tau = view.tau(times)
    rates = view.v(times)
    for index, name in enumerate(view.robot.motors):
        entry = model.joints[model.getJointId(name)].idx_v
        np.testing.assert_allclose(
            column(data, f"torque_use.{index}"), tau[:, entry] / model.effortLimit[entry], **close
        )
        np.testing.assert_allclose(
            column(data, f"rate_use.{index}"), rates[:, entry] / model.velocityLimit[entry], **close
        )
    for index, name in enumerate(footing(view).contacts):
        stands = np.isfinite(column(data, f"force_z.{index}"))
        shown = np.stack([column(data, f"force_{letter}.{index}") for letter in "xyz"], axis=1)
        np.testing.assert_allclose(shown[stands], forces[name][stands], **close)
        assert not forces[name][~stands].any()
        friction = column(data, f"friction.{index}")
        pressed = np.isfinite(friction)
        x, y, z = forces[name][pressed].T
        np.testing.assert_allclose(friction[pressed], np.hypot(x, y) / (view.request.friction * z), **close)
        assert friction[pressed].max() <= 1.0 + 1e-9


def test_the_page_says_what_turns_and_what_stands(view: SpatialJump, data: Any) -> None:
    tables = {table["title"]: table for table in data["sections"]}
    rows = {row[0]: row[1] for row in tables["Problem"]["rows"]}
    assert rows["turns"] == "roll about x by 360°"
    assert [line[0] for line in tables["Result"]["motors"][1]] == [phase.kind for phase in view.phases]
    titles = [chart["title"] for chart in data["charts"]]
    assert titles[:3] == ["On the ground", "Vertical forces", "Friction used"]
    assert "Orientation" in titles
    orientation = data["charts"][titles.index("Orientation")]
    assert [series["name"] for series in orientation["series"]] == ["roll x", "pitch y", "yaw z"]
    assert data["motion"]["vector"] is None  # no angular momentum stays the same over stances


def test_cones_and_forces_are_those_of_the_world(view: SpatialJump) -> None:
    """The cone has the coefficient's slope; in its picture a force within the cone is within the picture's cone."""
    standing = footing(view)
    rim = standing.cone_in_world[:-1]
    np.testing.assert_allclose(np.hypot(rim[:, 0], rim[:, 1]), view.request.friction * rim[:, 2], rtol=1e-12)
    push = moments(view)[1:2]
    forces = standing.forces(push)[0]
    expected = CAMERA(np.array([view.forces(push)[name][0] for name in standing.contacts]))
    acts = np.isfinite(forces)
    assert acts.sum() == 2
    np.testing.assert_allclose(forces[acts], expected[acts], atol=1e-9)
    sides = np.angle(standing.cone[np.abs(standing.cone) > 1e-9])
    assert (np.angle(forces[acts]) >= sides.min() - 1e-9).all()
    assert (np.angle(forces[acts]) <= sides.max() + 1e-9).all()


def test_the_robot_is_drawn_where_it_is_over_its_shadow(view: SpatialJump) -> None:
    times = np.array([0.0, view.takeoff_time, view.takeoff_time + 0.1, view.duration])
    model = pin.buildModelFromUrdf(str(view.robot.path), pin.JointModelFreeFlyer())
    data = model.createData()
    poses = outlines.bodies(view, times)
    placed = outlines.postures(view, times)
    assert placed.shadows is not None
    for index, q in enumerate(view.q(times)):
        pin.forwardKinematics(model, data, q)
        for number, solid in enumerate(rendered_solids(view.robot)):
            name = view.robot.model.names[solid.body]
            placement = data.oMi[1 if solid.body == 1 else model.getJointId(name)]
            expected = solid.points @ placement.rotation.T + placement.translation
            np.testing.assert_allclose(poses.points(solid.body, solid.points)[index], expected, atol=1e-8)
            expected[:, 2] = view.ground
            shadow = placed.shadows[index, number, : len(expected)]
            np.testing.assert_allclose(shadow, CAMERA(expected), atol=1e-8)
    for line in outlines.grids(view):
        np.testing.assert_allclose(line[:, 2], view.ground)
    centre, radius = outlines.ball(view)
    assert (np.linalg.norm(view.state(times).com_position - centre, axis=1) < radius).all()


@pytest.mark.long
def test_it_is_drawn_filmed_and_shown(view: SpatialJump, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the methods of every motion; the film has pictures in flight too, when no foot bears anything."""
    monkeypatch.setattr(animation, "FILM", replace(animation.FILM, rate=8.0))
    names = [*view.figures()]
    assert names[:2] == ["moments", "contacts"]
    assert {"orientation", "forces", "friction", "torque_use", "rate_use", "com_height", "torques"} <= {*names}
    drawn = len(strip(view).axes[0].texts)
    assert drawn >= 6  # a time for each moment
    assert view.animate(tmp_path / "jump.gif", speed=2.0).read_bytes()[:4] == b"GIF8"
    assert "<iframe" in view._repr_html_()
    broken = replace(view, flight=None)
    for shown in (broken.figures, broken.show, broken.animate, broken._repr_html_):
        with pytest.raises(fp.InputError, match="nothing to show"):
            shown()


@pytest.mark.long
def test_the_scene_has_arrows_and_cones(view: SpatialJump, tmp_path: Path) -> None:
    from floatplan.view.scene.scene import write_scene

    page = write_scene(view, tmp_path / "scene.html")
    assert page.stat().st_size > 100_000
    assert f"<title>floatplan: {view.problem.name}</title>" in page.read_text(encoding="utf-8")


def test_the_page_plays_in_a_browser(browser: Browser, view: SpatialJump, tmp_path: Path) -> None:
    """Arrows are where the forces are, seen by a camera that the reader turns; the robot has a shadow."""
    page = write_report(view, tmp_path / "report.html")
    browser.open(page)
    push = float(moments(view)[1])
    browser.run("floatplan.player.pause(); floatplan.player.seek(arguments[0])", push)
    script = (
        "return floatplan.stage.pushes.filter(([, cone]) => !cone.classList.contains('absent'))"
        ".map(([, cone, [, arrow]]) => [[cone, 'transform'], [arrow, 'd']]"
        ".map(([e, name]) => e.getAttribute(name).match(/-?\\d[\\d.e-]*/g).map(Number)))"
    )
    standing = footing(view)
    times = np.array([push])
    feet = standing.feet_in_world(times)[0]
    tips = standing.metres_per_newton * standing.forces_in_world(times)[0]
    acts = np.isfinite(tips[:, 0])
    for azimuth, elevation in ((-62.0, 18.0), (30.0, 40.0)):
        view_of_page = "const c = floatplan.stage.camera; c.angles = arguments[0]; c.turn()"
        browser.run(view_of_page, np.radians([azimuth, elevation]).tolist())
        camera = type(CAMERA).at(*np.radians([azimuth, elevation]))
        shown = browser.run(script)
        assert len(shown) == acts.sum() == 2
        for (place, arrow), foot, tip in zip(shown, camera(feet[acts]), camera(tips[acts]), strict=True):
            np.testing.assert_allclose(place, [foot.real, foot.imag], atol=2e-3)
            np.testing.assert_allclose(arrow[2:4], [tip.real, tip.imag], atol=5e-3)
    assert browser.run("return floatplan.stage.shadow.getAttribute('d').length") > 100
    assert browser.complaints() == []
    assert browser.requests() == [page.as_uri()]
