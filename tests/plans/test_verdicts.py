"""Findings and certificates as data: their labels, and that files give them back."""

import pytest

import floatplan as fp
from floatplan.plans.verdicts import LABELS, Finding

CONSTRAINTS = {
    "start.positions": ("start", ("positions",)),
    "goal.accelerations": ("goal", ("accelerations",)),
    "goal.orientation": ("goal", ("orientation",)),
    "takeoff.position": ("takeoff", ("position",)),
    "landing.height": ("landing", ("height",)),
    "position q1": ("position", ("q1",)),
    "velocity left hip": ("velocity", ("left hip",)),
    "torque q1": ("torque", ("q1",)),
    "generalized_torque q1": ("generalized_torque", ("q1",)),
    "motor q1": ("motor", ("q1",)),
    "orientation_rate": ("orientation_rate", ()),
    "obstacles[0] circle": ("obstacle", (0, "circle")),
    "obstacles[12] half-plane": ("obstacle", (12, "half-plane")),
    "self_clearance foot hand": ("self_clearance", ("foot", "hand")),
    "ground": ("ground", ()),
    "attitude.bound": ("attitude", ("bound",)),
    "out_of_plane.landing": ("out_of_plane", ("landing",)),
    "hash of mesh meshes/a b.stl": ("mesh", ("meshes/a b.stl",)),
    'robot: body "foot": inertia from a mesh is not read': ("robot", ('body "foot": inertia from a mesh is not read',)),
    "robot.resolved: the proof is of this URDF, not of the MJCF that it was made from": ("resolved", ()),
    "recorded torque_peak": ("recorded", ("torque_peak",)),
    "recorded orientation.end": ("recorded", ("orientation.end",)),
    "orientation.start": ("stated", ("orientation", "start")),
    "com.velocity0": ("stated", ("com", "velocity0")),
    "angular_momentum": ("angular_momentum", ()),
}


@pytest.fixture(scope="module")
def plan(planned):
    return planned("obstacle")


@pytest.mark.parametrize("label", CONSTRAINTS)
def test_labels_are_made_from_kind_and_subject_and_read_back(label):
    finding = Finding(*CONSTRAINTS[label], "undecided", 1.5, 0.2, 1.0, 0.5)
    assert finding.label == label
    assert Finding.from_dict(finding.to_dict()) == finding


def test_the_findings_of_a_plan_are_among_them(plan):
    kinds = {kind for kind, _ in CONSTRAINTS.values()}
    assert set(LABELS) - {"attitude"} < kinds  # which is of flights in space
    assert {finding.kind for finding in fp.certify(plan).findings} <= kinds


class TestCertificate:
    def test_is_of_one_type_wherever_it_comes_from(self, plan, tmp_path):
        loaded = fp.load_plan(plan.save(tmp_path / "plan.json"))
        for certificate in (plan.certificate, loaded.certificate, fp.certify(plan)):
            assert isinstance(certificate, fp.Certificate)
            assert certificate.proved
            assert certificate.unproved == ()
            assert not certificate.torque_peak.flags.writeable
