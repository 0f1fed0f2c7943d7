"""Verdicts on flights of clips whose truth is known."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import clip_samples as samples
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.view.solids import rendered_solids

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
KEYS = {"begin", "end", "frames", "verdict", "fall", "fall_interval", "sideways", "angular_momentum", "turn_rms"} | {
    *("turn_noise", "rate_share", "torque_share", "wrench", "feet", "faults")
}


Judge = Callable[..., fp.ClipCheck]


@pytest.fixture
def judge(robot: fp.Robot, tmp_path: Path) -> Judge:
    """What is said of a motion that was written to a file."""

    def judge(sample: samples.Sample, **options: Any) -> fp.ClipCheck:
        path = samples.write_csv(sample, tmp_path / "clip.csv")
        return fp.check_clip(fp.load_clip(path, model=robot, fps=sample.fps, quaternion="xyzw", **options))

    return judge


def verdicts(check: fp.ClipCheck) -> list[str]:
    return [judged.verdict for judged in check.flights]


@pytest.mark.parametrize("fps", [20.0, 30.0, 120.0, 1000.0])
def test_a_true_hop_at_any_rate(fps: float, judge: Judge) -> None:
    check = judge(samples.hops(fps, (0.5,)))
    assert verdicts(check) == ["physical"]
    assert check.ok
    (judged,) = check.flights
    assert judged.fall.fall == pytest.approx(9.81, abs=judged.fall.interval)
    assert judged.flight.duration == pytest.approx(0.5, abs=0.05)
    assert judged.wrench[0] < 1.0
    assert not judged.faults


def test_a_slow_fall_is_found(judge: Judge) -> None:
    check = judge(samples.hops(50, (0.5,), gravity=9.81 / 1.05**2))
    assert verdicts(check) == ["unphysical"]
    assert not check.ok
    (judged,) = check.flights
    assert judged.fall.fall == pytest.approx(9.81 / 1.05**2, abs=1e-2)
    assert judged.wrench[0] == pytest.approx(6.6 * 9.81 * (1 - 1 / 1.05**2), rel=0.02)
    assert "falls at 8.90" in judged.faults[0]


def test_a_base_that_turns_by_itself_is_found(judge: Judge) -> None:
    (judged,) = judge(samples.hops(50, (0.5,), tilt=math.radians(6))).flights
    assert judged.verdict == "unphysical"
    assert any("constant angular momentum" in fault for fault in judged.faults)


def test_nothing_falls_on_another_world(judge: Judge, robot: fp.Robot, tmp_path: Path) -> None:
    moon = samples.hops(50, (0.9,), gravity=1.62)
    assert verdicts(judge(moon)) == ["unphysical"]
    clip = fp.load_clip(tmp_path / "clip.csv", model=robot, fps=50)
    assert verdicts(fp.check_clip(clip, gravity=1.62)) == ["physical"]


def test_few_frames_are_undecided(judge: Judge) -> None:
    sample = samples.hops(20, (0.25,))
    rough = sample.places + 4e-3 * np.random.default_rng(0).normal(size=sample.places.shape)
    check = judge(replace(sample, places=rough))
    assert verdicts(check) == ["undecided"]
    assert check.ok


def test_feet_and_ground_may_be_given(judge: Judge) -> None:
    hop = samples.hops(60, (0.4,))
    assert judge(hop, feet=("l_shank", "r_shank"), ground=0.0).clip.scene.foot_names == ("l_shank", "r_shank")
    assert verdicts(judge(hop, ground=0.0)) == ["physical"]
    assert verdicts(judge(hop, ground=1.0)) == []
    with pytest.raises(fp.InputError, match=r"feet.*nothing"):
        judge(hop, feet=("nothing",))


def test_a_tilted_robot_stands_on_all_its_feet(judge: Judge) -> None:
    hop = samples.hops(60, (0.4,))
    tilt = Rotation.from_rotvec([math.radians(28.0), 0.0, 0.0])  # about the x axis: one leg is 11 cm longer
    legs = np.tile([0.0, 0.0, -0.76, 1.52], (hop.frames, 1))
    check = judge(replace(hop, attitudes=tilt * hop.attitudes, joints=legs))
    assert check.clip.scene.foot_names == ("l_shank", "r_shank")


def test_a_base_may_be_a_foot(tmp_path: Path) -> None:
    plan = fp.plan(PROBLEMS / "backflip.toml")
    path = plan.export("motion-csv", tmp_path / "clip.csv", rate=50)
    clip = fp.load_clip(path, model=plan.robot.path, fps=50)
    assert clip.scene.foot_names == ("body0",)
    assert any("no collision shapes" in remark for remark in clip.remarks)
    (judged,) = fp.check_clip(clip).flights
    assert judged.verdict == "physical"
    assert judged.flight.duration > 0.8 * plan.duration


def test_feet_that_stand_float_sink_and_slide(judge: Judge) -> None:
    hop = samples.hops(100, (0.4,))
    (still,) = judge(hop, ground=0.0).flights
    assert max(still.floating, still.sinking, still.sliding) < 5e-3
    (high,) = judge(hop, ground=-0.015).flights
    assert high.floating == pytest.approx(0.015, abs=5e-3)
    (low,) = judge(hop, ground=0.015).flights
    assert low.sinking == pytest.approx(0.015, abs=2e-3)
    moving = hop.places + np.array([0.2, 0.0, 0.0]) * np.arange(hop.frames)[:, None] / 100
    (sliding,) = judge(replace(hop, places=moving), ground=0.0).flights
    assert sliding.sliding == pytest.approx(0.06, rel=0.2)


def test_labels_of_contacts_decide(robot: fp.Robot, tmp_path: Path) -> None:
    hop = samples.hops(60, (0.5,))
    data = samples.amp_data(hop)
    np.savez(tmp_path / "clip.npz", **data)
    (judged,) = fp.check_clip(fp.load_clip(tmp_path / "clip.npz", model=robot)).flights
    assert judged.flight.duration == pytest.approx(0.5, abs=0.03)
    data["contacts"] = np.ones_like(data["contacts"])
    np.savez(tmp_path / "clip.npz", **data)
    assert not fp.check_clip(fp.load_clip(tmp_path / "clip.npz", model=robot)).flights


def test_the_command_says_it_for_programs(model: Path, tmp_path: Path, floatplan: Callable[..., Any]) -> None:
    path = samples.write_csv(samples.hops(50, (0.5,), gravity=7.0), tmp_path / "slow.csv")
    run = floatplan("clip", "check", path, "--model", model, "--fps", 50, "--json")
    assert run.code == 1
    found = json.loads(run.stdout)
    assert {"file", "model", "fps", "frames", "flights"} <= set(found)
    (flight,) = found["flights"]
    assert set(flight) == KEYS
    assert set(flight["wrench"]) == {"force", "moment"}
    assert set(flight["feet"]) == {"floating", "sinking", "sliding"}
    assert set(flight["torque_share"]) == {"share", "joint"}
    assert flight["verdict"] == "unphysical"


def test_a_folder_is_a_scoreboard(model: Path, tmp_path: Path, floatplan: Callable[..., Any]) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    samples.write_csv(samples.hops(50, (0.5,)), folder / "a_true.csv")
    samples.write_csv(samples.hops(50, (0.5,), gravity=7.0), folder / "b_slow.csv")
    run = floatplan("clip", "check", folder, "--model", model, "--fps", 50)
    assert run.code == 1
    assert run.stdout.index("b_slow") < run.stdout.index("a_true")
    assert floatplan("clip", "check", folder / "a_true.csv", "--model", model, "--fps", 50).code == 0
    missing = floatplan("clip", "check", folder / "nothing.csv", "--model", model)
    assert missing.code == 2
    assert "no such file" in missing.stderr


def test_a_page_shows_it(model: Path, robot: fp.Robot, tmp_path: Path, floatplan: Callable[..., Any]) -> None:
    path = samples.write_csv(samples.hops(50, (0.5, 0.4), gravity=7.0), tmp_path / "slow<b>.csv")
    run = floatplan("clip", "check", path, "--model", model, "--fps", 50, "--report")
    assert run.code == 1
    page = Path("runs/slow<b>/report.html").read_text()
    assert "slow&lt;b&gt;.csv" in page
    assert "slow<b>" not in page
    assert page.count("<svg") == 8
    assert page.count("<polygon") == 2 * 5 * len(rendered_solids(robot))  # flights, postures, links
    assert "falls at 7.00" in page
    assert "nan" not in page


def test_a_base_with_another_axis_upwards(tmp_path: Path) -> None:
    frame = (
        '<link name="frame"/><joint name="fixed" type="fixed"><parent link="frame"/><child link="base"/>'
        f'<origin rpy="{-np.pi / 2} 0 0"/></joint></robot>'
    )
    model = tmp_path / "y_upwards.urdf"
    model.write_text(samples.robot_text().replace("</robot>", frame))
    hop = samples.hops(50)
    turned = replace(hop, attitudes=hop.attitudes * Rotation.from_rotvec([np.pi / 2, 0.0, 0.0]))
    path = samples.write_csv(turned, tmp_path / "clip.csv", digits=9)
    clip = fp.load_clip(path, model=model, fps=50, quaternion="xyzw")
    assert clip.scene.foot_names == ("l_shank", "r_shank")
    assert [judged.verdict for judged in fp.check_clip(clip).flights] == ["physical"]
