"""Records proved by the certificate alone, with capsules that are given."""

from collections.abc import Sequence
from pathlib import Path

from floatplan.certificate.certificate import BUDGET, prove
from floatplan.certificate.planar.clearance import LinkShape
from floatplan.plans.reading import checked
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Certificate, Finding
from floatplan.robot.urdf.tree import urdf_path


def finding(certificate: Certificate, label: str) -> Finding:
    """The one finding of a certificate with a label, or whose label begins with this word."""
    (found,) = [each for each in certificate.findings if label in (each.label, each.label.split()[0])]
    return found


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
