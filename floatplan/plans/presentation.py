"""A plan as text: the rows and tables that terminal, report and studio show alike."""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from floatplan.arguments import in_line, percent, short
from floatplan.plans.measures import Utilisation, limits_shown, turns_out_of_plane
from floatplan.plans.plan import Plan
from floatplan.plans.verdicts import TONES, Tone, verdict_in_words
from floatplan.tables import OBJECTIVE_TABLE

LONGEST_LIST = 200  # [-] characters of names in a row
LEAST_ROTATION = 1e-4  # [rad] out of the plane, that is reported
CHECKED = "Stances are checked 2000 times a second, not proved; the figures are the worst of them."
EXPONENTS = {"2": "²", "3": "³"}


class Row(NamedTuple):
    """A name, what stands under it, and whether that is good, bad or open."""

    name: str
    text: str
    tone: Tone = "good"


def plan_verdict(plan: Plan) -> tuple[str, Tone]:
    """Return the verdict on a plan in a few words, and its tone."""
    return verdict_in_words(plan.ok, plan.certificate, bool(plan.warnings))


def result_rows(plan: Plan) -> list[Row]:
    """Return the result of a search: its status first, then how good the motion is."""
    record = plan.record
    momentum = f"{in_line(record.angular_momentum, 6)} kg m^2/s"
    if record.angular_momentum_bounds is not None:
        low, high = record.angular_momentum_bounds
        if low <= record.angular_momentum <= high:
            momentum += f", inside [{low:.5g}, {high:.5g}], as motions without turning back are"
        else:
            momentum += f", outside [{low:.5g}, {high:.5g}], so a joint or the base turns back"
    name = record.objective["name"]
    seconds = record.solver.get("seconds")
    unit = OBJECTIVE_TABLE[name].unit.replace("mixed", "")
    if record.in_space and name == "coefficients":
        name = "free part of p"
        unit = "rad"
    of_nearest = "" if plan.ok else ", in the nearest motion"
    rows = [
        Row("status", record.status if seconds is None else f"{record.status}, after {float(seconds):.3g} s"),
        Row("orientation", f"off by {plan.whole.missed:.1e} rad at the end{of_nearest}"),
        Row("momentum", momentum),
        Row("objective", f"{name} {float(record.objective['value']):.6g} {unit}".rstrip()),
    ]
    if record.clearance_min is not None:
        rows.append(Row("clearance", f"{record.clearance_min:.5g} m at least"))
    locked = [
        f"{name} at {position:g} m"
        for name, position in plan.robot.locked.items()
        if not plan.robot.file_tree.joint[name].turns
    ]
    if locked:
        rows.append(Row("held", f"{_cut(', '.join(locked))}, as joints that slide are not planned", "open"))
    turned = plan.out_of_plane
    if turned is not None and np.linalg.norm(turned) > LEAST_ROTATION:
        rows.append(
            Row("out of plane", f"turns {turns_out_of_plane(plan.robot, turned)} in space, as its plane is left")
        )
    return rows + [Row(contact.end, contact.brief, "good" if contact.ok else "open") for contact in plan.contacts]


def proof_rows(plan: Plan) -> list[Row]:
    """Return what was proved of a plan, and what was not; nothing where it has no certificate."""
    certificate = plan.certificate
    goal = plan.problem.final.orientation
    if certificate is None:
        return []
    tone = TONES[certificate.verdict]
    unproved = [finding.label for finding in certificate.unproved]
    many = f"{len(certificate.findings) - len(unproved)} of {len(certificate.findings)}"
    took = f"{certificate.seconds:.2g} s, {certificate.subintervals} intervals"
    rows = [Row("certificate", f"{certificate.verdict}: {many} constraints hold at every instant ({took})", tone)]
    if unproved:
        rows.append(Row("not proved", _cut(", ".join(unproved)), tone))
    low, high = certificate.orientation_end
    bounds = [] if math.isinf(low) else [f"orientation within {max(abs(low - goal), abs(high - goal)):.1e} rad"]
    if certificate.attitude_bound is not None and math.isfinite(certificate.attitude_bound):
        bounds.append(f"attitude within {certificate.attitude_bound:.1e} rad")
    torque = max(certificate.motor_torque_peak.values(), default=0.0)
    bounds += [] if math.isinf(torque) else [f"torque at most {torque:.4g} N m"]
    if certificate.clearance_min is not None:
        bounds.append(f"clearance at least {certificate.clearance_min:.5g} m")
    return [*rows, *([Row("bounds", f"for all times, {', '.join(bounds)}", tone)] if bounds else [])]


def _cut(listed: str) -> str:
    return listed if len(listed) <= LONGEST_LIST else f"{listed[: LONGEST_LIST - 4]} ..."


def utilisation_table(rows: Sequence[Utilisation]) -> tuple[list[str], list[list[str]]]:
    """Return titles and cells of how much of its limits each motor uses; the last cell is an instant, s."""
    limits = limits_shown(rows)
    titles = ["joint", *(title for limit in limits for title in (limit.unit, "limit", "%"))]
    cells = []
    for use in rows:
        of_limits: list[str] = []
        for limit in limits:
            peak, most, share = (getattr(use, f"{limit.key}_{name}") for name in ("peak", "limit", "utilisation"))
            of_limits += [short(peak), short(most), percent(share)]
        moved = f"{math.degrees(use.position_low):z.0f} to {math.degrees(use.position_high):z.0f}"
        cells.append([use.joint, *of_limits, moved, percent(use.range_used), f"{use.instant:.3f}"])
    return [*titles, "range, deg", "% of it", "at, s"], cells


def raised(text: str) -> str:
    """Return a text with the exponents of its units raised, for a page or a picture."""
    return re.sub(r"\b(m|N|s|rad)\^([23])\b", lambda match: match[1] + EXPONENTS[match[2]], text)
