"""``floatplan takeoff``, and what ``floatplan bounds`` tells beside the interval for h."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import floatplan as fp


@pytest.fixture
def jump(root):
    return root / "problems" / "high_jump.toml"


@pytest.fixture
def possible(root, tmp_path):
    """A hop of the high jumper within its limits: from a crouch, and back into it."""
    robot = fp.Robot.from_urdf(root / "urdf" / "high_jumper.urdf")
    crouch = fp.Posture(1.2, [1.0, -1.6, -1.0])
    flight = fp.Flight(0.1, angular_momentum=0.0, takeoff=fp.Takeoff("foot"))
    problem = fp.Problem(robot, crouch, crouch, flight, name="hop")
    assert fp.takeoff(problem).ok
    assert fp.landing(problem).ok
    return fp.save_problem(problem, tmp_path / "hop.toml")


class TestTakeoff:
    def test_for_reading(self, floatplan, jump):
        run = floatplan("takeoff", jump)
        assert run.code == 1
        text = " ".join(run.stdout.split())
        for part in ("foot cannot leave the ground at rest at takeoff", "2.83 times", "trunk cannot meet", "283", "q3"):
            assert part in text, text
        assert run.stderr == ""
        assert list(Path.cwd().iterdir()) == []

    def test_possible(self, floatplan, possible):
        run = floatplan("takeoff", possible)
        assert run.code == 0
        assert "leaves the ground at rest" in " ".join(run.stdout.split())

    def test_json(self, floatplan, jump):
        run = floatplan("takeoff", jump, "--json")
        assert run.code == 1
        facts = json.loads(run.stdout)
        assert facts["joints"] == ["q1", "q2", "q3"]
        assert facts["takeoff"]["ratio"] == pytest.approx(2.83, abs=0.005)
        assert facts["takeoff"]["limits"] == [18, 12, 20]
        shares = np.abs(facts["takeoff"]["rates"]) / facts["takeoff"]["limits"]
        assert shares.max() == pytest.approx(facts["takeoff"]["ratio"])
        assert facts["landing"]["frame"] == "trunk"
        assert facts["no_common_momentum"] is None

    def test_a_free_momentum_has_to_suit_both_ends(self, floatplan, root):
        run = floatplan("takeoff", root / "problems" / "gallery" / "go2.toml")
        assert run.code == 1
        assert "No angular momentum suits both ends" in run.stdout


class TestBounds:
    def test_json(self, floatplan, possible):
        facts = json.loads(floatplan("bounds", possible, "--json").stdout)
        for end in ("takeoff", "landing"):
            asked = facts[f"{end}_asked"]
            for value, key in zip(asked, ("angular_momentum", "horizontal_velocity", "vertical_velocity"), strict=True):
                low, high = facts[f"{end}_{key}_bounds"]
                assert low <= value <= high
            assert len(facts[f"{end}_polygon"]) == 6

    def test_picture(self, floatplan, jump):
        run = floatplan("bounds", jump, "--picture", "reached.png")
        assert run.code == 0
        pixels = np.asarray(Image.open("reached.png").convert("RGB")).reshape(-1, 3)
        assert len(np.unique(pixels, axis=0)) > 10

    def test_pictures_that_cannot_be(self, floatplan, jump, root):
        for arguments, reason in (
            ((jump, "--picture", "reached.txt"), "--picture"),
            ((root / "problems" / "somersault.toml", "--picture", "reached.png"), "limits.velocity"),
        ):
            run = floatplan("bounds", *arguments)
            assert run.code == 2
            assert reason in run.stderr
        assert list(Path.cwd().iterdir()) == []
