"""The figures of a plan, by name, and their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from floatplan.errors import InputError
from floatplan.files import write_atomically
from floatplan.plans.plan import Plan
from floatplan.view.charts import charts
from floatplan.view.figures.curves import chart_figure, sample
from floatplan.view.figures.kinogram import kinogram
from floatplan.view.figures.snapshots import comparison, snapshots
from floatplan.view.style import METADATA, rendered, styled


def figures(plan: Plan, *, compare: Plan | None = None) -> dict[str, Figure]:
    """Draw a plan's figures.

    Parameters
    ----------
    plan : Plan
    compare : Plan, optional
        A second plan for the same joints, such as one made without the obstacle; its curves are dashed.

    Returns
    -------
    dict of str to Figure
        "snapshots" (the robot along the path of its centre of mass, m) and "kinogram" (side by side); over time
        "configuration" (degrees), "rates" (rad/s), what else of the joints' motion the problem limits, such as
        "accelerations", "torques" (N m), "momentum" (what base and joints have of h, and the interval (9), kg m^2/s),
        "inertia" (D of (4), kg m^2), with obstacles "clearance" (m); with ``compare`` "comparison" (both plans'
        robots, m).

    Raises
    ------
    InputError
        ``compare`` plans other joints.
    """
    with styled():
        return dict(_drawn(plan, compare))


def save_figures(
    plan: Plan, directory: str | Path, *, compare: Plan | None = None, formats: Sequence[str] = ("png", "svg")
) -> list[Path]:
    """Write each figure of :func:`figures` into a directory as ``<name>.<format>``, each whole or not at all.

    Files of the same plan are the same to the last byte.

    Parameters
    ----------
    formats : sequence of "png", "svg", "pdf"

    Raises
    ------
    InputError
        A format is unknown, or ``compare`` plans other joints.
    """
    for name in formats:
        if name not in METADATA:
            raise InputError(f"must be among {', '.join(METADATA)}, not {name!r}", element="formats")
    with styled():
        return [
            write_atomically(Path(directory) / f"{name}.{form}", rendered(figure, form))
            for name, figure in _drawn(plan, compare)
            for form in formats
        ]


def _drawn(plan: Plan, compare: Plan | None) -> Iterator[tuple[str, Figure]]:
    if compare is not None and compare.robot.joints != plan.robot.joints:
        joints = ", ".join(compare.robot.joints)
        reason = f"plans {joints}, not {', '.join(plan.robot.joints)}"
        raise InputError(reason, element="compare", advice="give a plan for the same joints")
    sampled, other = sample(plan), None if compare is None else sample(compare, plan)
    yield "snapshots", snapshots(plan)
    yield "kinogram", kinogram(plan)
    for chart in charts(sampled):
        yield chart.name, chart_figure(chart, sampled, other)
    if compare is not None:
        yield "comparison", comparison(plan, compare)
