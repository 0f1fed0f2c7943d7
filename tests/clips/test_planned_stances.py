"""Stances beside repaired flights that are planned: contacts of the clip, still feet, what is told where none is."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import clip_samples as samples
import numpy as np
import pinocchio as pin
import pytest
from drawn_hops import Hop
from spoiled_hops import RATE, STRETCH, drawn_hop, repaired_hop, spoiled_hop

import floatplan as fp
from floatplan.clips.planned.contacts import foot_places, foot_points, standing_feet, still_flight
from floatplan.clips.planned.planner import StancePlanner
from floatplan.clips.stance_forces import stance_figures


@pytest.fixture(scope="module")
def hop() -> Hop:
    return drawn_hop()


@pytest.fixture(scope="module")
def clip() -> fp.Clip:
    return spoiled_hop()


def test_a_flight_begins_where_the_feet_leave(hop: Hop, clip: fp.Clip) -> None:
    """Not where they are two centimetres high, as the judge's flights do."""
    stands = standing_feet(clip)
    assert stands[clip.scene.times < hop.takeoff - 0.03].all()
    flight = still_flight(clip, stands, clip.flights[0])
    assert flight.begin == pytest.approx(hop.takeoff, abs=0.02)
    assert flight.end == pytest.approx(hop.takeoff + STRETCH * hop.flight, abs=0.02)
    assert flight.begin < clip.flights[0].begin - 0.02
    assert flight.end > clip.flights[0].end + 0.02


def test_feet_stand_on_the_ground_where_the_clip_has_them(clip: fp.Clip) -> None:
    planner = StancePlanner(clip, 9.81, (0,))
    before, after = planner.windows
    assert (before.side, after.side) == ("takeoff", "landing")
    assert before.phases[0].feet == (0, 1, 2, 3)
    ends = planner.ends(0)
    assert ends is not None
    lowered = planner.ends(0, 0.02)
    assert lowered is not None
    for end, side in enumerate((before, after)):
        for foot in range(4):
            points = foot_points(clip, foot)
            (place,) = foot_places(clip, foot, points, side.phases).values()
            assert place[2] == pytest.approx(0.022, abs=1e-3)  # m, the radius of its ball
            assert np.abs(place - ends.places[end][points[0].name]).max() < 1e-12
    for still in (ends, lowered):
        feet = still.mechanics.feet(still.motion[:, :, :1], list(still.places[0]))
        assert np.abs(feet[0, 0] - np.array(list(still.places[0].values()))).max() < 1e-9
    assert ends.motion[0, 2, 0] - lowered.motion[0, 2, 0] == pytest.approx(0.02, abs=1e-12)


def test_what_cannot_stand_is_told_and_bent(robot: fp.Robot, tmp_path: Path) -> None:
    """The frames of its shanks are at the knees: no point is known on which it could stand."""
    sample = samples.hops(60, (0.5,), gravity=6.0)
    path = samples.write_csv(sample, tmp_path / "clip.csv", digits=9)
    clip = fp.load_clip(path, model=robot, fps=sample.fps, quaternion="xyzw")
    bent, _ = fp.repair_clip(clip)
    repaired, repair = fp.repair_clip(clip, stances="planned")
    assert np.array_equal(repaired.positions, bent.positions)
    (flight,) = repair.flights
    assert [stance.planned for stance in flight.stances] == [False, False]
    assert "is 220 mm above its lowest point" in flight.stances[0].reason
    assert flight.to_dict()["stances"][1]["side"] == "landing"
    assert repair.ok
    with pytest.raises(fp.InputError, match="stances"):
        fp.repair_clip(clip, stances="drawn")  # type: ignore[arg-type]


@pytest.mark.long
def test_both_stances_are_planned(clip: fp.Clip) -> None:
    """They hold by an independent look at the frames that are written: speeds, feet, forces."""
    repaired, repair = repaired_hop()
    (flight,) = repair.flights
    assert [stance.planned for stance in flight.stances] == [True, True]
    for stance in flight.to_dict()["stances"]:
        assert stance["figures"]["torque"] <= 1.0
        assert stance["figures"]["velocity"] <= 1.0
        assert stance["figures"]["friction"] <= 0.6
    model = repaired.robot.model
    q = repaired.configurations
    velocities = repaired.velocities
    assert velocities is not None
    steps = np.array([pin.difference(model, first, last) for first, last in pairwise(q)])
    assert np.abs(RATE * steps - (velocities[1:] + velocities[:-1]) / 2).max() < 0.05  # rad/s, m/s: nothing jumps
    (judged,) = fp.check_clip(repaired).flights
    assert judged.verdict == "physical"
    assert flight.repaired is not None
    inside = repaired.times < flight.repaired.flight.begin - 0.01
    figures = stance_figures(clip, q[inside][::5], repaired.times[inside][::5], 5 / RATE, 9.81)
    assert figures.vertical_least > 0.0
    assert figures.pressure_outside < 0.02
