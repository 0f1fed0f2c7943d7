"""A jump as pages and pictures show it: the jump's own numbers, in its own clock, beside what its check found."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from browser import Browser
from jumps import backflip
from long_cases import cases

import floatplan as fp
from floatplan.errors import InputError
from floatplan.jumps.check import JumpCheck
from floatplan.jumps.jump import Jump
from floatplan.motion.planar.full_model import free_flyer
from floatplan.view.figures import animation, snapshots
from floatplan.view.jumps import footing, moments
from floatplan.view.report.data import sample_grid
from floatplan.view.report.report import report, report_data, write_report

HOSTILE = "</script><script>window.broken = 1</script><img src=x onerror='window.broken = 1'>"


@pytest.fixture(scope="module")
def view() -> Jump:
    return backflip()


@pytest.fixture(scope="module")
def data(view: Jump) -> Any:
    return report_data(view)


def column(data: Any, key: str) -> Any:
    return np.array(data["motion"]["columns"][key], dtype=np.float64)


def test_the_page_has_the_jump_s_numbers(view: Jump, data: Any) -> None:
    """Places, rates, torques and forces, in the coordinates of the file's own model."""
    jump, robot = backflip(), backflip().problem.robot
    times, order = sample_grid(jump.duration), free_flyer(robot)
    q, v, tau, forces = jump.q(times), jump.v(times), jump.tau(times), jump.forces(times)
    model = pin.buildModelFromXML(robot.xml, pin.JointModelFreeFlyer())
    joints = {name: model.joints[model.getJointId(name)] for name in (*robot.motors, *robot.locked)}
    limits = dict(zip(robot.motors, jump.problem.motor_torque_limits, strict=True))
    com = np.array([pin.centerOfMass(model, model.createData(), each) for each in q])
    close: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-8}
    np.testing.assert_allclose(column(data, "com_x"), com @ robot.plane.horizontal, **close)
    np.testing.assert_allclose(column(data, "com_height") + view.ground, com @ robot.plane.vertical, **close)
    for index, name in enumerate(robot.joints):
        np.testing.assert_allclose(column(data, f"positions.{index}"), q[:, joints[name].idx_q], **close)
        share = v[:, joints[name].idx_v] / jump.problem.velocity_limits[index]
        np.testing.assert_allclose(column(data, f"rate_use.{index}"), share, **close)
    for index, name in enumerate(robot.motors):
        np.testing.assert_allclose(
            column(data, f"torque_use.{index}"), tau[:, joints[name].idx_v] / limits[name], **close
        )
    for index, name in enumerate(robot.locked):
        share = tau[:, joints[name].idx_v] / model.effortLimit[joints[name].idx_v]
        np.testing.assert_allclose(column(data, f"held_use.{index}"), share, **close)
    assert order.nv == model.nv
    for index, (name, contact) in enumerate(footing(view).contacts.items()):
        whole = sum(forces[each] for each in contact.names)
        across, up = column(data, f"force_x.{index}"), column(data, f"force_z.{index}")
        stands = np.isfinite(up)
        phases = [phase for phase in jump.phases if contact.names[0] in phase.contacts]
        inside = np.any([(times > each.begin) & (times <= each.end) for each in phases], axis=0)
        assert (stands[1:] == inside[1:]).all(), name
        np.testing.assert_allclose(up[stands], (whole @ robot.plane.vertical)[stands], **close)
        np.testing.assert_allclose(across[stands], (whole @ robot.plane.horizontal)[stands], **close)
        assert np.abs(whole[~stands]).max() == 0


def test_the_page_says_what_was_checked_and_proved(view: Jump, data: Any) -> None:
    jump = backflip()
    assert jump.flight is not None
    tables = {table["title"]: table for table in data["sections"]}
    assert [*tables][:4] == ["Problem", "Result", "Flight", "Stances"]
    assert data["verdict"] == {"word": jump.verdict, "tone": "open"}  # not proved yet
    said = tables["Stances"]["motors"][1]
    assert all(any(sentence in words for words, _ in said) for sentence in ("friction is", "torques take"))
    assert [line[0] for line in tables["Result"]["motors"][1]] == [phase.kind for phase in jump.phases]
    certificate = fp.certify(jump.flight)
    proved = report_data(jump.with_certificate(certificate))
    assert proved["verdict"]["word"].startswith("flight proved, stances checked")
    flight = next(table for table in proved["sections"] if table["title"] == "Flight")
    assert flight["tone"] == "good"
    assert flight["rows"][0][1].startswith("proved: ")


def test_stances_that_do_not_hold_are_red() -> None:
    broken = replace(backflip())
    vars(broken)["check"] = JumpCheck(False, {**backflip().check.figures, "torque": 1.2}, ("torques take 120%",))
    data = report_data(broken)
    assert data["verdict"] == {"word": broken.verdict, "tone": "bad"}
    stances = next(table for table in data["sections"] if table["title"] == "Stances")
    assert stances["tone"] == "bad"
    assert stances["motors"][1][0] == ["not within limits: torques take 120% of their limits", "0.85 at most"]


def test_what_was_not_found_is_not_viewed() -> None:
    with pytest.raises(InputError, match="no jump found, so there is nothing to show"):
        Jump(backflip().problem, fp.JumpRequest()).figures()


def test_a_jump_is_shown_and_written_as_a_plan_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By methods of the same names, whose files are those of the commands."""
    monkeypatch.setattr(animation, "FILM", replace(animation.FILM, rate=2.0))
    jump = backflip()
    assert jump.show(tmp_path / "page.html", browse=False).read_text() == report(jump, tmp_path / "page.html")
    assert "<iframe" in jump._repr_html_()
    names = [*jump.figures()]
    assert names[0] == "moments"
    assert {"forces", "friction", "torque_use", "held_use", "rate_use", "com_height"} <= {*names}
    drawn: list[int] = []
    film = jump.animate(tmp_path / "jump.gif", speed=4.0, progress=lambda done, _: drawn.append(done))
    assert film.read_bytes()[:4] == b"GIF8"
    assert drawn
    exported = jump.export("pinocchio", tmp_path / "jump.npz", rate=50.0, kp=40.0, kd={"RL_hip_joint": 2.0})
    with np.load(exported) as archive:
        assert set(archive["kp"]) == {40.0}
        assert 2.0 in archive["kd"]
    nothing = Jump(jump.problem, fp.JumpRequest())
    for asked in (nothing.show, nothing.animate, nothing.figures, nothing._repr_html_, lambda: nothing.export("csv")):
        with pytest.raises(InputError, match="no jump"):
            asked()


def test_the_edge_of_higher_ground_is_shown_as_ground(view: Jump, data: Any) -> None:
    """Its bars, three metres long, are no obstacles of the picture, and the picture is no larger for them."""
    landing = replace(view.request.landing, height=0.2)
    raised = replace(view, request=replace(view.request, edge=0.6, landing=landing))
    assert len(raised.whole_problem.obstacles) == 2
    motion = report_data(raised)["motion"]
    assert not motion["obstacles"]
    assert motion["box"] == data["motion"]["box"]
    assert [line[0] for line in motion["ground"]] == [pytest.approx(view.ground)]
    assert motion["step"][1] == pytest.approx(view.ground)


def test_moments_keep_all_of_the_friction_cones(view: Jump) -> None:
    wide = replace(view, request=replace(view.request, friction=2.0))  # so that they reach beyond the robot
    axes = snapshots.moments(wide).axes[0]
    low, high = axes.get_xlim()
    cones = [patch.get_path().vertices for patch in axes.patches if patch.get_alpha() == 0.2]
    assert len(cones) == 6  # of two contacts at both ends, of one before and after the flight
    for corners in cones:
        assert low <= corners[:, 0].min()
        assert corners[:, 0].max() <= high


def test_obstacles_are_in_the_jump_s_clock(view: Jump) -> None:
    """An obstacle that moves and exists for a while, both since takeoff, is where the flight's own plan has it."""
    passing = fp.Circle(center=(0.6, 0.3), radius=0.05, velocity=(-2.0, 0.5), window=(0.05, 0.2))
    jump = backflip()
    assert jump.flight is not None
    moved = replace(jump, problem=replace(jump.problem, obstacles=(passing,)))
    since = np.linspace(0.0, jump.flight.duration, 41)
    found = moved.clearances(jump.takeoff_time + since, moved.whole_problem.obstacles)
    np.testing.assert_allclose(found, jump.flight.clearances(since, [passing]), atol=1e-9)
    assert np.isfinite(found).sum() not in (0, len(found))
    assert [chart["title"] for chart in report_data(moved)["charts"]][-1] == "Clearance"


SIZES = {"desktop": (1280, 800), "phone": (390, 844)}


@pytest.mark.parametrize("size", cases(SIZES, {"desktop"}))
def test_the_page_plays_in_a_browser(
    browser: Browser, view: Jump, data: Any, tmp_path: Path, size: str, request: pytest.FixtureRequest
) -> None:
    """No complaint, no network, no sideways scrolling; arrows, bands and names are those of the jump."""
    width, height = SIZES[size]
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": size == "phone"}
    request.addfinalizer(browser.reset)
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    hostile = replace(backflip(), problem=replace(backflip().problem, name=HOSTILE))
    page = write_report(hostile, tmp_path / "report.html")
    browser.open(page)
    assert browser.run("return document.getElementById('name').textContent") == HOSTILE
    push = float(moments(view)[1])
    browser.run("floatplan.player.seek(arguments[0])", push)
    seen = "return [...document.querySelectorAll(arguments[0])].map(e => getComputedStyle(e).display !== 'none')"
    assert browser.run(seen, ".push.cone") == [True, False]
    found = browser.run(
        "const [, cone, [, arrow]] = floatplan.stage.pushes[0], texts = [[cone, 'transform'], [arrow, 'd']];"
        "return texts.map(([e, name]) => e.getAttribute(name).match(/-?\\d[\\d.e-]*/g).map(Number))"
    )
    foot, force = (values(np.array([push]))[0, 0] for values in (footing(view).feet, footing(view).forces))
    np.testing.assert_allclose(found[0], [foot.real, foot.imag], atol=1e-6)
    tip = footing(view).metres_per_newton * force
    np.testing.assert_allclose(found[1][2:4], [tip.real, tip.imag], rtol=5e-3)
    browser.run("document.getElementById('forces').click()")
    assert browser.run(seen, ".push") == [False] * 6
    told = browser.run("return [...document.querySelectorAll('.chart')].map(e => e.innerText)[0]")
    stands = [name in contact for contact in footing(view).contacts for name in view.phases[1].contacts[:1]]
    words = [f"{name} {'stands' if each else '–'}" for name, each in zip(footing(view).contacts, stands, strict=True)]
    assert all(each in " ".join(told.split()) for each in words)
    graphics = "return [...document.querySelectorAll('[role=img]')].map(e => e.getAttribute('aria-label') || '')"
    assert all(browser.run(graphics))
    assert len(browser.run(graphics)) == 1 + len(data["charts"])
    assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
    assert browser.run("return window.broken") is None
    assert browser.complaints() == []
    assert browser.requests() == [page.as_uri()]
