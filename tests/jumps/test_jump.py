"""A Go2's backflip from end to end: found, proved in flight, checked in stance, the same after saving."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from jumps import backflip, backflip_on_points, go2_problem, plan_on_fewer_nodes_in_a_plane
from long_cases import cases

import floatplan as fp
from floatplan.jumps import planner
from floatplan.jumps.check import limit_shares
from floatplan.jumps.planner import jump
from floatplan.jumps.reading import load_jump


def test_it_is_found_and_checked():
    found = backflip()
    assert found.ok
    assert [phase.kind for phase in found.phases] == ["stance", "stance", "flight", "stance", "stance"]
    assert set(found.phases[1].contacts) == {"RL_foot", "RR_foot"}
    figures = found.check.figures
    assert all(found.check.meanings[name] for name in figures)
    assert figures["residual"] < 1e-3
    assert figures["drift"] < 1e-6
    assert max(figures["takeoff_seam"], figures["landing_seam"]) < 1e-6
    assert figures["torque"] <= 0.85
    changes = np.array([phase.end for phase in found.phases[:-1]])
    torques = found.tau(changes[:, None] + [-0.002, 0.002])[..., 6:]
    motors = np.abs(np.diff(torques, axis=1)).max(axis=(0, 1))
    limits = dict(zip(found.problem.robot.motors, found.problem.motor_torque_limits, strict=True))
    joints = [*found.problem.robot.model.names][4:]
    shares = [motors[joints.index(name)] / limit for name, limit in limits.items()]
    assert figures["torque_step"] == pytest.approx(max(shares), rel=1e-6)
    assert "within 4 ms" in " ".join(found.check.sentences)


def test_the_flight_is_proved():
    assert backflip().flight is not None
    assert fp.certify(backflip().flight).proved


def test_it_stands_at_both_ends():
    found = backflip()
    ends = found.at([0.0, found.duration])
    assert np.abs(ends.velocities).max() < 1e-9
    assert np.abs(ends.accelerations).max() < 1e-6
    np.testing.assert_allclose(ends.positions[:, 2], [0.0, -2 * np.pi], atol=1e-9)


@pytest.mark.parametrize("feet", cases(["points", "auto"], {"points"}))
def test_pinocchio_s_free_flyer_of_the_file_balances(feet):
    """In the file's own model, with gravity and six coordinates of the base: nothing of floatplan is in it.

    Forces act at the frames of feet that are points, and below those of feet that roll, by their radius.
    """
    found = backflip() if feet == "auto" else backflip_on_points()
    model = pin.buildModelFromXML(found.problem.robot.xml, pin.JointModelFreeFlyer())
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    data, weight = model.createData(), found.problem.robot.mass * 9.81
    stances = (*found.before, *found.after)
    radius = {name: each.radius for stance in stances for each in stance.contacts for name in each.names}
    assert {value > 0 for value in radius.values()} == {feet == "auto"}
    for t in np.linspace(0.0, found.duration, 41):
        q, v, a, tau = found.q(t), found.v(t), found.a(t), found.tau(t)
        wrench = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for name, force in found.forces(t).items():
            jacobian = pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED)
            moment = np.cross([0.0, 0.0, -radius[name]], force)
            wrench = wrench - jacobian.T @ np.concatenate((force, moment))
        assert np.abs(wrench[6:] - tau[6:]).max() < 1e-6 * weight
        assert np.abs(wrench[[0, 2, 4]]).max() < 1e-3 * weight


def test_torques_take_as_much_of_their_limits_either_way():
    """Of motors, and of pairs that have a limit of their own."""
    found = backflip()
    problem = replace(found.problem, limits=fp.Limits(torque=20.0))
    state = found.at(np.linspace(0.0, found.duration, 21))
    shares, reversed_shares = (
        limit_shares(problem, replace(state, torques=sign * state.torques)) for sign in (1.0, -1.0)
    )
    for name in ("torque", "torque_speed"):
        np.testing.assert_array_equal(shares[name], reversed_shares[name])
    assert (shares["torque"] >= 0).all()
    assert shares["torque"].max() > 1


def test_it_is_the_same_after_saving(tmp_path):
    found = backflip()
    again = load_jump(found.save(tmp_path / "jump.json"))
    times = np.linspace(0.0, found.duration, 17)
    np.testing.assert_array_equal(again.q(times), found.q(times))
    np.testing.assert_array_equal(again.tau(times), found.tau(times))
    assert again.request == found.request
    assert again.check.figures == found.check.figures


@pytest.mark.long
def test_feet_stay_above_the_ground_where_capsules_around_them_begin_below_it(root, monkeypatch):
    """A sole's are 10 mm thicker than it, while the legs that swing back may only just clear the ground."""
    plan_on_fewer_nodes_in_a_plane(monkeypatch)
    found = jump(root / "problems" / "jumps" / "talos_hop.toml", starts=1)
    assert found.ok
    assert fp.certify(found.flight).proved
    assert found.check.figures["feet"] > -1e-3
    below, ground = found.flight.problem.obstacles
    assert ground.point[1] - below.point[1] > 0.01
    assert (below.window, ground.window[0] > 0, ground.window[1] < found.flight.duration) == (None, True, True)


@pytest.mark.long
def test_what_cannot_be_is_not_found_and_says_why(monkeypatch):
    """With a tenth of its torque the robot does not even lift itself; ``test_conflicts.py`` has what would help."""
    monkeypatch.setattr(planner, "_try_relaxed", lambda *_: "")
    monkeypatch.setattr("floatplan.jumps.program.ITERATIONS", 30)  # with more it ends no nearer
    plan_on_fewer_nodes_in_a_plane(monkeypatch)
    problem = go2_problem()
    weak = replace(problem, limits=fp.Limits(velocity="urdf", torque=2.0))
    found = jump(weak, starts=1)
    assert (found.ok, found.status) == (False, "not_found")
    assert "In the way: torque of" in found.explanation


@pytest.mark.long
def test_from_a_jump_at_hand_another_is_found_that_holds_as_well(monkeypatch):
    """Whatever changed, without a start; and where none is, the same is said as without."""
    plan_on_fewer_nodes_in_a_plane(monkeypatch)
    found, said = backflip(), list[str]()
    lasted = [phase.end - phase.begin for phase in found.phases]
    durations = [[lasted[0] + 0.004] * 2, [lasted[1] - 0.004] * 2]
    for request in (
        fp.JumpRequest(takeoff=fp.JumpTakeoff(durations=durations)),
        fp.JumpRequest(friction=found.request.friction + 0.1, margin={"torque": 0.82}),
        fp.JumpRequest(objective="limits"),
    ):
        again = jump(found.problem, request, near=found, progress=said.append)
        assert again.ok
        assert again.check.ok
    programs = {words for words in said if words.startswith("program ")}
    assert "program 1 of 3 at most: flight, stances, check" in programs
    assert set(said) - programs == {"from the jump at hand"}
    monkeypatch.setattr("floatplan.jumps.program.ITERATIONS", 5)  # of the start, which ends anywhere
    icy = jump(found.problem, fp.JumpRequest(friction=0.12), starts=1, helps=False, near=found)
    assert icy.explanation == "No jump was found in 1 start."


@pytest.mark.long
def test_the_largest_share_of_the_limits_is_less_where_that_is_asked(monkeypatch):
    """Than where squared torques are least; and what is said of it is what the check measured."""
    plan_on_fewer_nodes_in_a_plane(monkeypatch)
    problem = go2_problem()
    spared = jump(problem, fp.JumpRequest(objective="limits"), starts=2)
    assert spared.ok
    shares = [max(each.check.figures[name] for name in ("torque", "velocity")) for each in (spared, backflip())]
    assert shares[0] < shares[1] - 0.05
    figures, margin = spared.check.figures, spared.request.margin
    share = max(figures[name] / margin.get(name, 1.0) for name in ("torque", "velocity", "held_torque"))
    told = re.search(r"Of what the margins leave the jump takes (\d+)%", spared.explanation)
    assert int(told[1]) / 100 >= share - 0.005, "it is the share of the whole jump, of which stances are a part"
