"""Plans with their certificates: in Python, on the command line, in figures and summaries; gaps that are closed."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import ROOT

import floatplan as fp
from floatplan.errors import InputError
from floatplan.planning import repair as proving
from floatplan.planning.options import SearchOptions
from floatplan.planning.planner import planned
from floatplan.planning.repair import judged, proved
from floatplan.plans.verdicts import Finding

EXAMPLE = ROOT / "problems" / "new_configuration.toml"
CIRCLE = fp.Circle(center=(1.485, 3.342), radius=0.2, margin=0.02)


@pytest.fixture(scope="module")
def plan_b():
    """Example B of the paper with its obstacle, and a limit on torques."""
    problem = fp.load_problem(ROOT / "problems" / "handstand.toml")
    problem = replace(problem, obstacles=(CIRCLE,), limits=fp.Limits(position="full", torque=20.0))
    return fp.plan(problem, prove=True)


@pytest.fixture(scope="module")
def found():
    """Example A within torque limits that it needs."""
    problem = fp.load_problem(EXAMPLE)
    problem = replace(problem, limits=fp.Limits(position="full", torque=[2.0, 1.2]))
    found = planned(problem, SearchOptions())
    assert found.plan.ok
    return found


def asking(found, **changes):
    """The same search's end, as the answer to a slightly different problem."""
    return replace(found, plan=asked_otherwise(found.plan, **changes))


def asked_otherwise(plan, **changes):
    """The same motion, as the answer to a slightly different problem."""
    return replace(plan, problem=replace(plan.problem, **changes))


def doubted(certificate):
    """The certificate as it would be, had the proof not come to an end."""
    finding = Finding("torque", ("q1",), "undecided", 2.5, 0.5, 2.0, 0.5)
    return replace(certificate, verdict="undecided", findings=(*certificate.findings, finding))


class TestCertify:
    def test_takes_plans_records_and_paths(self, plan_b, tmp_path):
        path = plan_b.save(tmp_path / "plan.json")
        for plan in (plan_b, plan_b.record, path, str(path), fp.load_plan(path)):
            certificate = fp.certify(plan)
            assert isinstance(certificate, fp.Certificate)
            assert certificate.proved
            assert certificate.clearance_min == pytest.approx(plan_b.record.clearance_min, abs=2e-5)

    def test_plan_keeps_its_certificate_in_its_file(self, plan_b, tmp_path):
        assert plan_b.ok
        assert plan_b.certificate.proved
        content = json.loads(plan_b.save(tmp_path / "plan.json").read_text())
        assert content["certificate"] == plan_b.certificate.to_dict()
        loaded = fp.load_plan(tmp_path / "plan.json").certificate
        assert isinstance(loaded, fp.Certificate)
        assert loaded.to_dict() == content["certificate"]
        assert loaded.findings == fp.certify(plan_b).findings

    def test_finds_a_relative_urdf_from_the_plan_file(self, plan_b, tmp_path, monkeypatch):
        (tmp_path / "robots").mkdir()
        shutil.copy(plan_b.robot.path, tmp_path / "robots" / "gymnast.urdf")
        record = replace(plan_b.record, robot=replace(plan_b.record.robot, urdf="robots/gymnast.urdf"))
        path = record.save(tmp_path / "plan.json")
        monkeypatch.chdir("/")
        assert fp.certify(path).proved
        shutil.move(tmp_path / "robots" / "gymnast.urdf", tmp_path / "gymnast.urdf")
        assert fp.certify(path).proved
        (tmp_path / "gymnast.urdf").unlink()
        with pytest.raises(InputError, match="no such file"):
            fp.certify(path)
        assert fp.certify(path, urdf=plan_b.robot.path).proved


class TestClosingTheGap:
    @pytest.mark.parametrize("missing", [1e-7, 1e-5, 3e-4])
    def test_of_torques(self, found, missing):
        peaks = np.asarray(found.plan.record.torque_peak)
        asked = fp.Limits(position="full", torque=tuple((peaks * (1.0 - missing)).tolist()))
        tight = asking(found, limits=asked)
        assert fp.certify(tight.plan).verdict == "refuted"
        plan, certificate = proved(tight)
        assert certificate.proved, certificate.findings
        assert plan.problem is tight.plan.problem
        assert tuple(plan.record.problem["limits"]["torque"]) == asked.torque

    def test_of_the_orientation(self, found):
        """A change of the motion that vanishes at both ends turns the base a little, and lands at another height."""
        bubble = 1e-4 * np.array([0, 0, 0, 1, -3, 3, -1, 0]) / found.plan.duration ** np.arange(8)
        off = replace(found.plan, coefficients=found.plan.coefficients + bubble)
        certificate = fp.certify(off)
        failed = {item.label for item in certificate.findings if item.verdict != "proved"}
        assert {"goal.orientation", "landing.height"} <= failed
        plan, certificate = proved(replace(found, plan=off))
        assert certificate.proved, certificate.findings
        assert plan.record.orientation["goal"] == found.plan.problem.goal.orientation

    def test_of_clearance(self):
        problem = fp.load_problem(ROOT / "problems" / "handstand.toml")
        problem = replace(problem, obstacles=(CIRCLE,))
        found = planned(problem, SearchOptions())
        nearest = found.plan.record.clearance_min
        plan, certificate = proved(asking(found, obstacles=(replace(CIRCLE, margin=nearest + 1e-5),)))
        assert certificate.proved
        assert certificate.clearance_min >= nearest + 1e-5 - 1e-8
        assert plan.ok

    def test_is_not_tried_where_much_is_missing(self, found, monkeypatch):
        monkeypatch.setattr(proving, "polished", lambda *_: pytest.fail("was tried"))
        peaks = np.asarray(found.plan.record.torque_peak)
        tight = asking(found, limits=fp.Limits(position="full", torque=(0.9 * peaks).tolist()))
        plan = judged(*proved(tight))
        assert not plan.ok
        assert plan.status == "infeasible"
        assert plan.record.ok is False
        assert plan.explanation.startswith("Refuted: ")
        assert "torque q1" in plan.explanation

    def test_an_undecided_plan_says_so(self, found):
        plan = judged(found.plan, doubted(fp.certify(found.plan)))
        assert plan.ok
        assert plan.certificate.verdict == "undecided"
        assert "Not proved: " in plan.explanation


class TestCommands:
    def test_plan_proves_by_default(self, floatplan):
        run = floatplan("plan", EXAMPLE, "-o", "out", "--no-figures")
        assert run.code == 0
        assert json.loads(Path("out/plan.json").read_text())["certificate"]["verdict"] == "proved"
        assert "for all times, orientation within" in " ".join(run.stdout.split())
        assert floatplan("certify", "out/plan.json").code == 0
        assert floatplan("plan", EXAMPLE, "-o", "again", "--quiet", "--prove").code == 0

    def test_plan_without_proof(self, floatplan):
        run = floatplan("plan", EXAMPLE, "-o", "out", "--no-figures", "--no-certify")
        assert run.code == 0
        assert json.loads(Path("out/plan.json").read_text())["certificate"] is None

    @pytest.mark.parametrize(("ok", "options", "code"), [(True, [], 0), (True, ["--prove"], 1), (False, [], 1)])
    def test_a_missing_proof_is_an_exit_code_where_it_is_asked_for(self, floatplan, monkeypatch, ok, options, code):
        def doubtful(plan):
            weak = fp.Limits(position="full", torque=0.1)
            return doubted(fp.certify(plan)) if ok else fp.certify(asked_otherwise(plan, limits=weak))

        monkeypatch.setattr(proving, "certify", doubtful)
        run = floatplan("plan", EXAMPLE, "-o", "out", "--json", *options)
        assert run.code == code
        answer = json.loads(run.stdout)
        assert answer["ok"] is ok
        assert answer["certificate"]["verdict"] == ("undecided" if ok else "refuted")
        assert re.search(r"^not proved +\w", run.stderr, re.MULTILINE)
