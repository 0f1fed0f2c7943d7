"""Records proved by the certificate alone, with capsules that are given."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from floatplan.certificate.certificate import BUDGET, prove
from floatplan.certificate.planar.clearance import LinkShape
from floatplan.errors import InputError
from floatplan.plans.reading import checked
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Certificate, Finding
from floatplan.robot.urdf.tree import urdf_path


def finding(certificate: Certificate, label: str) -> Finding:
    """The one finding of a certificate with a label, or whose label begins with this word."""
    (found,) = [each for each in certificate.findings if label in (each.label, each.label.split()[0])]
    return found


def assert_no_false_proof(
    drawn: Iterable[Any], judge: Callable[[Any], str], certify: Callable[[PlanRecord], Certificate] | None = None
) -> None:
    """No tampered plan that is seen to be invalid is proved, all that are clearly valid are; there are many of both."""
    outcomes: dict[str, list[tuple[str, str]]] = {"valid": [], "invalid": [], "unclear": []}
    for case in drawn:
        try:
            verdict: str = (certify or certify_record)(case.record).verdict
        except InputError:
            verdict = "refused"
        outcomes[judge(case)].append((case.kind, verdict))
    count = sum(map(len, outcomes.values()))
    assert [case for case in outcomes["invalid"] if case[1] == "proved"] == []
    assert [case for case in outcomes["valid"] if case[1] != "proved"] == []
    assert len(outcomes["invalid"]) > count / 4
    assert len(outcomes["valid"]) > count / 6


def certify_record(
    record: PlanRecord,
    urdf: str | Path | None = None,
    *,
    shapes: Sequence[LinkShape] | None = None,
    hulls: Sequence[LinkShape] | None = None,
    budget: int = BUDGET,
) -> Certificate:
    """Prove a record for the URDF that it names, or another; left out, links have no shapes but their segments."""
    path = urdf_path(record.robot.file if urdf is None else urdf)
    return prove(checked(record), path, (shapes, hulls), (), budget)
