"""Clearances in a plane and in space alike: the least of some distances over time, and what the file says of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from floatplan.arrays import Array, IntArray, indices_of
from floatplan.certificate.branch_and_bound import RECORDED_CLEARANCE, Goal, Items, Minimum, at_least, at_most, smallest
from floatplan.certificate.cells import TimeCells
from floatplan.certificate.enclosure import Balls, Taylor
from floatplan.plans.record import PlanRecord
from floatplan.plans.verdicts import Finding, Kind, Subject, Verdict
from floatplan.tables import CLEARANCE


class Distances(Protocol):
    """Distances between surfaces over time, of which the least counts; its members are pairs, points or solids."""

    def below(self, forms: Taylor, member: IntArray) -> Array:
        """Lower bound over the items."""

    def at_point(self, values: Balls, member: IntArray) -> Array:
        """Upper bound at a point."""


class Surroundings(Protocol):
    """A flight and the links' shapes in it, which are compared with what a problem keeps them clear of."""

    def obstacle_finding(self, index: int, obstacle: Mapping[str, Any]) -> tuple[Finding, Minimum]:
        """Clearance of all links to one obstacle while it exists."""

    def self_finding(self, pair: Mapping[str, Any]) -> Finding:
        """Clearance between two links."""

    def ground_finding(self) -> Finding:
        """Height of all links over the ground."""


def window_within(obstacle: Mapping[str, Any], duration: float) -> tuple[float, float]:
    """From when to when an obstacle exists during the flight, s; the end is before the beginning where it does not."""
    first, last = obstacle.get("window") or (0.0, duration)
    return max(float(first), 0.0), min(float(last), duration)


def windows(record: PlanRecord) -> list[tuple[float, float]]:
    """When obstacles exist that are not there all along, s, as far as the flight lasts."""
    obstacles = [obstacle for obstacle in record.problem.get("obstacles") or [] if obstacle.get("window")]
    within = [window_within(obstacle, record.duration) for obstacle in obstacles]
    return [(first, last) for first, last in within if first <= last]


def existing_cells(cells: TimeCells, obstacle: Mapping[str, Any]) -> IntArray:
    """Cells during which an obstacle exists; cells end where windows do."""
    first, last = obstacle.get("window") or (-math.inf, math.inf)
    return np.flatnonzero((cells.low >= float(first)) & (cells.high <= float(last)))


def shapes_of_pair(links: Sequence[str], pair: Mapping[str, Any]) -> tuple[list[int], list[int]]:
    """Indices of the shapes of two links that are to keep apart, among shapes that belong to ``links``."""
    name, other_name = pair["links"]
    first = indices_of(name, links)
    second = indices_of(other_name, links)
    if not first or not second:
        raise ValueError(f"self_clearance: one of the links {pair['links']} has no shape")
    return first, second


def least_distance(
    kind: Kind, subject: Subject, distances: Distances, items: Items, margin: float, cells: TimeCells
) -> tuple[Finding, Minimum]:
    """The verdict on the least of some distances, which should be a margin, m, at least; and that distance."""
    gap = 2e-6  # [m] how sharply a clearance is bounded
    goal = Goal(np.array([gap]), np.array([margin - CLEARANCE]))
    groups = np.zeros(int(items.member.max(initial=-1)) + 1, dtype=np.int64)
    (least,) = smallest(items, groups, distances.below, distances.at_point, goal, cells)
    return at_least(kind, subject, least.bound, least.attained, margin, CLEARANCE, least.instant), least


def clearance_findings(
    record: PlanRecord, surroundings: Surroundings, unknown_meshes: Sequence[str]
) -> tuple[list[Finding], float | None]:
    """Findings on all that is to be kept clear of, and the proved least distance to obstacles, m.

    ``unknown_meshes`` are files around which the shapes are, and whose hashes the record lacks: these may not be the
    shapes that were planned with, and nothing is known of clearances.
    """
    findings: list[Finding] = []
    clearance = None  # [m] to obstacles
    obstacles = record.problem.get("obstacles") or []
    if obstacles:
        minima = []
        for index, obstacle in enumerate(obstacles):
            finding, least = surroundings.obstacle_finding(index, obstacle)
            findings.append(finding)
            minima.append(least)
        clearance = min(least.bound for least in minima)
        findings.append(_recorded(record, clearance, min(least.attained for least in minima)))
    pairs = record.problem.get("self_clearance") or []
    findings += [surroundings.self_finding(pair) for pair in pairs]
    if record.problem.get("ground"):
        findings.append(surroundings.ground_finding())
    if not unknown_meshes:
        return findings, clearance
    unknown = [Finding("mesh", (name,), "undecided", None) for name in unknown_meshes]
    return unknown + [replace(finding, verdict="undecided") for finding in findings], None


def unfounded_claims(record: PlanRecord) -> list[Finding]:
    """The finding on a clearance that the file claims where no obstacle is; none where there is no such claim."""
    if record.clearance_min is None or record.problem.get("obstacles"):
        return []
    return [Finding("recorded", ("clearance_min",), "refuted", record.clearance_min)]


def _recorded(record: PlanRecord, bound: float, attained: float) -> Finding:
    """The finding on the clearance that the file claims, of one that is proved to be ``bound`` at least."""
    recorded = record.clearance_min
    kind = "recorded"
    subject = ("clearance_min",)
    if recorded is None:  # nothing was near, because no obstacle exists during the flight
        verdict: Verdict = "proved" if bound == math.inf else "refuted" if attained < math.inf else "undecided"
        return Finding(kind, subject, verdict, bound, None, None)
    farthest = max(abs(recorded - bound), abs(recorded - attained))
    nearest = max(0.0, recorded - attained, bound - recorded)
    return at_most(kind, subject, farthest, nearest, 0.0, RECORDED_CLEARANCE, None)
