"""Findings and certificates as data: their labels, and that files give them back."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import floatplan as fp
from floatplan.errors import InputError
from floatplan.plans.verdicts import LABELS, Finding, Kind, Subject, worst

CONSTRAINTS: dict[str, tuple[Kind, Subject]] = {
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
def plan(root: Path) -> fp.Plan:
    return fp.plan(fp.load_problem(root / "problems" / "obstacle.toml"), prove=True)


@pytest.mark.parametrize("label", CONSTRAINTS)
def test_labels_are_made_from_kind_and_subject_and_read_back(label: str) -> None:
    finding = Finding(*CONSTRAINTS[label], "undecided", 1.5, 0.2, 1.0, 0.5)
    assert finding.label == label
    assert Finding.from_dict(finding.to_dict()) == finding


def test_the_findings_of_a_plan_are_among_them(plan: fp.Plan) -> None:
    kinds = {kind for kind, _ in CONSTRAINTS.values()}
    assert set(LABELS) < kinds
    assert {finding.kind for finding in fp.certify(plan).findings} <= kinds


def test_the_gap_is_of_what_is_undecided() -> None:
    keys = ["label", "verdict", "bound", "instant", "limit"]
    assert list(Finding("ground", (), "proved", 0.0).to_dict()) == keys
    assert list(Finding("ground", (), "undecided", 0.0).to_dict()) == [*keys, "gap"]


def test_the_worst_verdict_counts() -> None:
    proved, undecided, refuted = (Finding("ground", (), verdict, 0.0) for verdict in ("proved", "undecided", "refuted"))
    assert worst((proved,)) == "proved"
    assert worst((proved, undecided)) == "undecided"
    assert worst((undecided, refuted, proved)) == "refuted"


class TestCertificate:
    def test_is_of_one_type_wherever_it_comes_from(self, plan: fp.Plan, tmp_path: Path) -> None:
        loaded = fp.load_plan(plan.save(tmp_path / "plan.json"))
        for certificate in (plan.certificate, loaded.certificate, fp.certify(plan)):
            assert isinstance(certificate, fp.Certificate)
            assert certificate.proved
            assert certificate.unproved == ()
            assert not certificate.torque_peak.flags.writeable

    def test_reads_back_as_written(self, plan: fp.Plan) -> None:
        certificate = fp.certify(plan)
        content = json.loads(json.dumps(certificate.to_dict(), allow_nan=False))
        again = fp.Certificate.from_dict(content)
        assert again.to_dict() == content
        assert again.findings == certificate.findings
        assert again.orientation_end == certificate.orientation_end
        np.testing.assert_array_equal(again.velocity_peak, certificate.velocity_peak)

    def test_what_is_not_bounded_is_null_in_a_file(self, plan: fp.Plan) -> None:
        unbounded = np.full(2, math.inf)
        certificate = replace(fp.certify(plan), orientation_end=(-math.inf, math.inf), torque_peak=unbounded)
        content = certificate.to_dict()
        assert content["orientation_end"] == content["torque_peak"] == [None, None]
        again = fp.Certificate.from_dict(content)
        assert again.orientation_end == (-math.inf, math.inf)
        assert again.torque_peak.tolist() == [math.inf, math.inf]
        assert again.to_dict() == content

    @pytest.mark.parametrize(
        ("change", "reason"),
        [
            ({"verdict": "true"}, "a verdict must be 'proved' or 'refuted' or 'undecided', not 'true'"),
            ({"findings": [{"label": 3, "verdict": "proved"}]}, "must be what floatplan certify --save writes"),
            ({"findings": [{"verdict": "proved"}]}, "certificate.label: is missing"),
            ({"torque_peak": 3.0}, "must be what floatplan certify --save writes"),
            ({"orientation_end": [1.0]}, "must be what floatplan certify --save writes"),
            ({"clearance_min": "far"}, "must be what floatplan certify --save writes"),
        ],
    )
    def test_what_is_none_is_refused(self, plan: fp.Plan, tmp_path: Path, change: dict[str, Any], reason: str) -> None:
        certificate = {**fp.certify(plan).to_dict(), **change}
        path = plan.record.with_checks(certificate=certificate).save(tmp_path / "plan.json")
        with pytest.raises(InputError, match=r"plan\.json") as refused:
            fp.load_plan(path)
        assert reason in str(refused.value)

    def test_belongs_to_the_motion_that_was_proved(self, plan: fp.Plan) -> None:
        moved = replace(plan, angular_momentum=1.01 * plan.angular_momentum)
        assert moved.certificate is None
        assert moved.record.angular_momentum == moved.angular_momentum
        assert fp.certify(moved).verdict == "refuted"
