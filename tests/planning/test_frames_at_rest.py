"""Flights that begin and end with a frame at rest on the ground, and with free accelerations."""

import json
from dataclasses import replace

import numpy as np
import pytest

import floatplan as fp
from floatplan.motion.flight import flight_of
from floatplan.motion.planar.contact_rates import contact_rates
from floatplan.motion.planar.end_rates import end_rates


def problem_of(robot, momentum=-4.0, at_takeoff=0.0, at_landing=0.0, **others):
    """The high jumper's leap from crouched to crouched, gentle enough for joints at rest on the ground."""
    start = fp.Posture(1.3, [1.2, -0.9, -1.0], "takeoff", at_takeoff)
    goal = fp.Posture(1.1, [1.4, -1.2, -1.6], "landing", at_landing)
    flight = fp.Flight(0.45, momentum, fp.Takeoff("foot"), fp.Landing("foot", 0.0), horizontal_velocity=0.3)
    return fp.Problem(robot, start, goal, flight, limits=fp.Limits(position="full"), **others)


@pytest.fixture(scope="module")
def jumper(root):
    return fp.Robot.from_urdf(root / "urdf" / "high_jumper.urdf")


@pytest.fixture(scope="module", params=[-4.0, "midpoint", "free"])
def plan(request, jumper):
    return fp.plan(problem_of(jumper, request.param), prove=True)


def labels(certificate):
    return {finding.label: finding for finding in certificate.findings}


class TestPlans:
    def test_are_proved_to_rest(self, plan):
        assert plan.ok
        found = labels(plan.certificate)
        for label in ("takeoff.frame_velocity", "landing.frame_velocity"):
            assert found[label].verdict == "proved"
            assert found[label].bound < 1e-9

    def test_have_the_rates_of_the_verdict(self, plan):
        for posture, end in ((plan.problem.initial, "takeoff"), (plan.problem.final, "landing")):
            expected = contact_rates(plan.problem, end, plan.angular_momentum)
            assert posture.frame_rests
            assert posture.velocities == pytest.approx(expected.rates, rel=1e-3, abs=1e-3)

    def test_go_to_a_file_and_back(self, plan, tmp_path):
        read = fp.load_plan(plan.save(tmp_path / "plan.json"))
        assert read.problem.start.velocities == "takeoff"
        assert read.problem.goal.velocities == "landing"
        assert (read.problem.initial.velocities == plan.problem.initial.velocities).all()
        content = json.loads((tmp_path / "plan.json").read_text())
        assert content["problem"]["start"]["velocities_asked"] == "takeoff"
        assert fp.certify(read).proved
        again = fp.plan(read.problem)
        assert again.objective_value == pytest.approx(plan.objective_value, rel=1e-6)

    @pytest.mark.parametrize("end", ["start", "goal"])
    def test_tampered_with_are_refuted(self, plan, tmp_path, end):
        """Another rate at an end, stated as well as flown, leaves the frame moving."""
        content = json.loads(plan.save(tmp_path / "plan.json").read_text())
        content["angular_momentum"] += 1e-3
        content["problem"]["flight"]["angular_momentum"] = content["angular_momentum"]
        (tmp_path / "other.json").write_text(json.dumps(content))
        found = labels(fp.certify(fp.load_plan(tmp_path / "other.json")))
        assert found[f"{'takeoff' if end == 'start' else 'landing'}.frame_velocity"].verdict == "refuted"


class TestFreeAccelerations:
    @pytest.mark.parametrize("momentum", [-4.0, "free"])
    def test_cost_no_more_than_given_ones(self, jumper, momentum):
        given = fp.plan(problem_of(jumper, momentum))
        free = fp.plan(problem_of(jumper, momentum, "free", "free"), prove=True)
        assert given.ok
        assert free.certificate.proved
        assert free.objective_value < given.objective_value * (1 + 1e-9)
        assert np.abs(free.problem.initial.accelerations).max() > 1.0

    def test_without_frames_at_rest(self, gymnast):
        start = fp.Posture(np.pi / 2, [0.3, -0.6], accelerations="free")
        flight = fp.Flight(1.0)
        problem = fp.Problem(gymnast, start, fp.Posture(0.2, [0.0, 0.2]), flight, fp.Motion(6))
        plan = fp.plan(problem, prove=True)
        assert plan.certificate.proved
        assert plan.problem.final.accelerations.tolist() == [0.0, 0.0]
        assert np.abs(plan.problem.initial.accelerations).max() > 1e-3

    def test_torque_limits_hold_at_ends_that_are_chosen(self, jumper):
        """Where the search chooses the accelerations, the limits are kept to at the ends as well."""
        loose = fp.plan(problem_of(jumper, -4.0, "free", "free"))
        limit = 0.9 * float(np.abs(loose.at([0.0, loose.duration]).torques).max())
        problem = problem_of(jumper, -4.0, "free", "free")
        plan = fp.plan(replace(problem, limits=fp.Limits(position="full", torque=limit)), prove=True)
        assert plan.certificate.proved
        assert np.abs(plan.at([0.0, plan.duration]).torques).max() <= limit * (1 + 1e-9)


class TestRates:
    def test_follow_h_in_pieces_with_the_frame_at_rest_everywhere(self, jumper):
        problem = problem_of(jumper, "free")
        momentum = flight_of(problem).momentum_set
        rates = end_rates(problem, momentum)
        reach = 3 * float(momentum.axes[0, 0])
        for h in momentum.centre[0] + np.linspace(-reach, reach, 41):
            found = rates(np.array([h]))
            for end, name in enumerate(("takeoff", "landing")):
                exact = contact_rates(problem, name, float(h))
                largest = max(np.abs(found[end] / exact.limits).max(), 0.0)
                assert largest <= exact.ratio * (1 + 1e-2)
            ahead, behind = (rates(np.array([h + step])) for step in (1e-7, -1e-7))
            assert ahead - found == pytest.approx(found - behind, abs=1e-12)


class TestImpossible:
    def test_rates_beyond_every_limit_are_told_without_a_search(self, jumper):
        limits = fp.Limits(position="full", velocity=1.0)
        for momentum in (-4.0, "free"):
            plan = fp.plan(replace(problem_of(jumper, momentum), limits=limits))
            assert not plan.ok
            assert "At takeoff frame 'foot' is at rest only" in plan.explanation
            assert ("whatever the angular momentum" in plan.explanation) == (momentum == "free")
            assert plan.solver["starts"] <= 2

    def test_a_frame_that_cannot_rest_is_refused(self, root):
        gymnast = fp.Robot.from_urdf(root / "urdf" / "gymnast.urdf")
        straight = fp.Posture(np.pi / 2, [0.0, 0.0], "takeoff")
        flight = fp.Flight(1.0, 0.0, fp.Takeoff("foot"))
        with pytest.raises(fp.InputError, match="no rates of the joints let frame 'foot' be at rest at takeoff"):
            fp.plan(fp.Problem(gymnast, straight, fp.Posture(0.0, [0.0, 0.0]), flight))

    def test_the_base_itself_is_refused(self, gymnast):
        start = fp.Posture(np.pi / 2, [0.3, 0.4], "takeoff")
        with pytest.raises(fp.InputError, match="needs a frame that stands on the ground"):
            fp.Problem(gymnast, start, fp.Posture(0.0, [0.0, 0.0]), fp.Flight(1.0))
        named = fp.Flight(1.0, takeoff=fp.Takeoff(gymnast.tree.names[0]))
        with pytest.raises(fp.InputError, match="is the base itself"):
            fp.plan(fp.Problem(gymnast, start, fp.Posture(0.0, [0.0, 0.0]), named))

    def test_a_joint_on_the_edge_of_its_range_cannot_push_off(self, jumper):
        problem = problem_of(jumper)
        edge = replace(problem.start, positions=[jumper.position_limits[0, 1], -0.9, -1.0])
        with pytest.raises(fp.InputError, match="on the edge of the joint's range"):
            fp.plan(replace(problem, start=edge, limits=fp.Limits()))


class TestFiles:
    def test_words_go_to_a_problem_file_and_back(self, jumper, tmp_path, root):
        problem = problem_of(jumper, at_takeoff="free")
        read = fp.load_problem(fp.save_problem(problem, tmp_path / "p.toml"))
        assert (read.start.velocities, read.start.accelerations) == ("takeoff", "free")
        assert read.goal.velocities == "landing"
        assert read.goal.accelerations != "free"
