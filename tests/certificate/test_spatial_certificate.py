"""Flights in space: what is true is proved, what is not is refuted, and the bound holds for any approximation."""

import hashlib
import math
from dataclasses import replace
from itertools import product

import flint
import numpy as np
import pytest
from long_cases import cases
from proof_records import assert_no_false_proof, certify_record, finding
from scipy.spatial.transform import Rotation
from space_chains import chain_file
from space_mutations import base_plans, judge, mutate
from space_reference import angle, draw_coefficients, flown, make_record

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.certificate.robots.urdf import read_urdf
from floatplan.certificate.spatial.attitude import Approximation, _series, approximate
from floatplan.certificate.spatial.bound import attitude_bound
from floatplan.certificate.spatial.findings import _angle_finding, _angles
from floatplan.certificate.spatial.flight import fly
from floatplan.certificate.spatial.robot import spatial_robot
from floatplan.errors import InputError
from floatplan.plans.verdicts import Certificate
from floatplan.robot.urdf.tree import urdf_path
from floatplan.tables import ORIENTATION

MUTATIONS = 6  # scripts/mutations.py makes more
INTEGRATED = 1e-11  # [rad] that DOP853 is off by, times the amplification


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    return base_plans(str(tmp_path_factory.mktemp("robots")))


def enclosed(record):
    path = urdf_path(record.robot.file)
    with np.errstate(all="ignore"):
        return fly(spatial_robot(read_urdf(path.read_bytes(), path), record.robot), record, (), 4096)


@pytest.fixture(scope="module")
def enclosures(plans):
    return [enclosed(record) for record in plans]


def with_goal(record, **goal):
    return replace(record, problem={**record.problem, "goal": {**record.problem["goal"], **goal}})


def test_what_is_true_is_proved(plans):
    for record in plans:
        certificate = certify_record(record)
        assert certificate.proved, certificate.unproved
        assert certificate.attitude_bound < 1e-9
        assert certificate.orientation_end == (-math.inf, math.inf)
        bound, s, r, q = (
            finding(certificate, f"attitude.{name}").bound
            for name in ("bound", "amplification", "residual", "condition")
        )
        assert bound == certificate.attitude_bound == pytest.approx((1 + q) * s * r)
        assert q < 1e-2
        assert (certificate.torque_peak >= record.torque_peak).all()
        assert certificate.torque_peak == pytest.approx(record.torque_peak, rel=1e-3)
        again = Certificate.from_dict(certificate.to_dict())
        assert again.to_dict() == certificate.to_dict()
        assert {
            "verdict",
            "attitude_bound",
            "torque_peak",
            "velocity_peak",
            "clearance_min",
            "findings",
            "seconds",
        } <= set(certificate.to_dict())


def test_the_attitude_that_dop853_reaches_is_within_the_bound(plans, enclosures):
    for record, flight in zip(plans, enclosures, strict=True):
        last = Rotation.from_quat(flight.quaternions[-1].sum(axis=0)).as_matrix()
        off = angle(last, flown(record, [0.0, record.duration], with_torques=False).attitudes[-1])
        assert off <= flight.attitude.bound + INTEGRATED * flight.attitude.amplification


@pytest.mark.parametrize("size", cases([1e-9, 1e-6, 1e-4], {1e-9, 1e-6}))
def test_the_bound_holds_for_any_approximation(plans, enclosures, size):
    """Polynomials that are off by something drawn: the true attitude stays within what is proved of them."""
    rng = np.random.default_rng(1)
    proved = 0
    for record, flight in zip(plans, enclosures, strict=True):
        true = flight.quaternions
        start = np.array(record.orientation["start"]["quaternion_xyzw"])
        for _ in range(5):
            drawn = rng.normal(size=true.shape) * 0.3 ** np.arange(true.shape[1])[:, None]
            q = true + size * rng.uniform() * drawn * (rng.random((len(true), 1, 1)) < 0.5)
            series = transitions_of(flight, record, q)
            with np.errstate(all="ignore"):
                found = attitude_bound(
                    flight.motion, Approximation(q, series), flight.cells, np.array(record.angular_momentum), start
                )
            if not math.isfinite(found.bound):
                continue
            proved += 1
            for u in np.linspace(-1, 1, 7):
                powers = u ** np.arange(q.shape[1])
                there, exact = (Rotation.from_quat(np.einsum("k,ckx->cx", powers, each)) for each in (q, true))
                assert (there.inv() * exact).magnitude().max() <= found.bound + flight.attitude.bound
    assert proved > 5


def test_first_guesses_that_lead_nowhere_are_left(plans, enclosures):
    rng = np.random.default_rng(1)
    for record, flight in zip(plans[:2], enclosures[:2], strict=True):
        momentum = np.array(record.angular_momentum)
        start = np.array(record.orientation["start"]["quaternion_xyzw"])
        guesses = rng.normal(size=(len(flight.cells), 4))
        guesses /= np.linalg.norm(guesses, axis=1, keepdims=True)
        found = approximate(flight.motion, flight.cells, momentum, start, guesses)
        with np.errstate(all="ignore"):
            bound = attitude_bound(flight.motion, found, flight.cells, momentum, start).bound
        assert bound == pytest.approx(flight.attitude.bound, rel=0.5)


def transitions_of(flight, record, q):
    """Transitions near those of an approximation: any serve."""
    motion = flight.motion
    middles = q[:, 0] / np.linalg.norm(q[:, 0], axis=1, keepdims=True)
    inverse, relative = motion.inverse.c[:, 0], motion.joint_momentum.c[:, 0, :, :, 0]
    return _series(inverse, relative, flight.cells.half.mid, np.array(record.angular_momentum), middles)[1]


def test_no_false_proof_and_hardly_a_false_alarm(plans, tmp_path):
    rng = np.random.default_rng(20261129)
    drawn = (mutate(rng, plans[number % len(plans)], tmp_path) for number in range(MUTATIONS))
    assert_no_false_proof(drawn, lambda case: judge(case.record))


def test_a_turn_more_is_refuted(plans):
    record = plans[1]
    asked = record.problem["goal"]["orientation"]
    for which in (0, 2):
        angles = list(asked["angles"])
        angles[which] += 2 * math.pi
        certificate = certify_record(with_goal(record, orientation={**asked, "angles": angles}))
        assert certificate.verdict == "refuted"
        assert [each.label for each in certificate.unproved] == ["goal.turns"]


@pytest.mark.parametrize(
    ("share", "radius", "verdict"),
    [(0.9, 0.05, "proved"), (0.9, 0.2, "undecided"), (1.1, 0.2, "undecided"), (1.1, 0.05, "refuted")],
)
def test_an_angle_counts_with_what_it_may_be_off_by(share, radius, verdict):
    angle = flint.arb(share * ORIENTATION)
    found = _angle_finding("goal", ("orientation",), angle, radius * ORIENTATION, ORIENTATION, 0.0)
    assert found.verdict == verdict


@pytest.mark.parametrize("axes", sorted({"".join(p) for p in product("xyz", repeat=3) if p[0] != p[1] != p[2]}))
def test_angles_are_those_that_make_the_rotation(axes):
    drawn = Rotation.random(200, random_state=np.random.default_rng(1))
    angles = _angles(axes, drawn.as_matrix())
    assert Rotation.from_euler(axes.upper(), angles).as_matrix() == pytest.approx(drawn.as_matrix(), abs=1e-12)
    assert angles == pytest.approx(drawn.as_euler(axes.upper()), abs=1e-9)


@pytest.mark.parametrize("axes", cases(["zyx", "yxz", "xzy", "zxz", "xyx"], {"yxz", "xzy", "xyx"}))
def test_turns_and_tilt_are_counted_about_any_axes(plans, axes):
    """Where the tilt stays below its limit the turns are those of a dense evaluation, else it is refuted."""
    record = plans[1]
    dense = flown(record, np.linspace(0.0, record.duration, 2001), with_torques=False)
    angles = Rotation.from_matrix(dense.attitudes).as_euler(axes.upper(), suppress_warnings=True)
    angles[:, [0, 2]] = np.unwrap(angles[:, [0, 2]], axis=0)
    tilt = np.abs(angles[:, 1] - (np.pi / 2 if axes[0] == axes[2] else 0.0)).max()
    ends = {
        end: {**record.problem[end], "orientation": {"angles": angles[index].tolist(), "axes": axes}}
        for end, index in (("start", 0), ("goal", -1))
    }
    certificate = certify_record(replace(record, problem={**record.problem, **ends}))
    verdict = "proved" if tilt < np.radians(70) else "refuted"
    assert finding(certificate, "goal.tilt").verdict == verdict
    if verdict == "proved":
        assert finding(certificate, "goal.tilt").bound == pytest.approx(tilt, abs=1e-4)
        assert finding(certificate, "goal.turns").verdict == "proved"


def test_the_base_s_rate_is_compared_as_a_length(plans):
    for share, verdict in ((1.0005, "proved"), (0.999, "refuted")):
        record = plans[0]
        limits = {**record.problem["limits"]}
        limits["orientation_rate"] = share * limits["orientation_rate"] / 1.001
        found = finding(
            certify_record(replace(record, problem={**record.problem, "limits": limits})), "orientation_rate"
        )
        assert found.verdict == verdict
        assert found.bound == pytest.approx(record.problem["limits"]["orientation_rate"] / 1.001, rel=1e-4)


def test_what_is_too_coarse_is_named(plans):
    diver = plans[1]
    wild = np.array(diver.coefficients)
    wild[:, 1] += 60.0  # [rad/s] whatever that does to the ends: nothing is proved with so few cells
    certificate = certify_record(replace(diver, coefficients=read_only(wild)), budget=24)
    assert any("larger budget" in each.label for each in certificate.findings if each.kind == "attitude")
    assert finding(certificate, "goal.orientation").verdict != "proved"
    assert certificate.attitude_bound == math.inf


def test_a_robot_without_inertia_about_an_axis_is_undecided(tmp_path):
    """Point masses on a line: no angular velocity about it follows from the momentum."""
    path = tmp_path / "line.urdf"
    links = "".join(f'<link name="l{k}"><inertial><mass value="1"/></inertial></link>' for k in range(2))
    joint = (
        '<joint name="j" type="revolute"><parent link="l0"/><child link="l1"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>'
    )
    joint += '<limit lower="-2" upper="2" effort="0" velocity="0"/></joint>'
    path.write_text(f'<robot name="line">{links}{joint}</robot>')
    record = line_record(path)
    certificate = certify_record(record, budget=64)
    assert certificate.verdict != "proved"
    assert certificate.attitude_bound == math.inf


def line_record(path):
    """The motion of a chain of one joint, of another robot."""
    chain = base_record_of_one_joint(path.parent)
    robot = replace(chain.robot, urdf=str(path), sha256=hashlib.sha256(path.read_bytes()).hexdigest(), joints=("j",))
    flight = {**chain.problem["flight"]}
    flight["takeoff"], flight["landing"] = {**flight["takeoff"], "frame": "l0"}, {**flight["landing"], "frame": "l1"}
    return replace(chain, robot=robot, problem={**chain.problem, "flight": flight})


def base_record_of_one_joint(folder):
    robot = fp.Robot.from_urdf(chain_file(folder, 1, 1), base="free-flyer")
    b = draw_coefficients(np.random.default_rng(1), 1, 1.0, 0.2)
    return make_record(robot, b, 1.0, [0.1, 0.0, 0.0], ("l0", "l1"), instants=50)


@pytest.mark.parametrize(
    ("orientation", "said"),
    [
        ({"quaternion_xyzw": [0, 0, 0, 1], "roll": 1.0}, "roll"),
        ({"quaternion_xyzw": [0, 0, 0, 0]}, "length zero"),
        ({"angles": [0, 0, 0]}, "either quaternion_xyzw, or angles and axes"),
        ({"angles": [0, 0, 0], "axes": "xxy"}, "neighbours that differ"),
        ({"angles": [0, "0", 0], "axes": "xyz"}, "angles"),
    ],
)
def test_an_attitude_that_is_none_is_refused(plans, orientation, said):
    with pytest.raises(InputError, match=said):
        certify_record(with_goal(plans[2], orientation=orientation))
