"""Curves over time as SVG, for pages that run no script to draw them; their colours suit light and dark paper."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floatplan.arrays import Array


@dataclass(frozen=True)
class ChartFrame:
    """Sizes and colours of a chart."""

    width: int = 540  # [px]
    height: int = 200  # [px]
    left: int = 52  # [px] between the chart and its frame, as the next three
    right: int = 150  # names of curves are there
    top: int = 22
    bottom: int = 26
    colours: tuple[str, ...] = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
    reference: str = "#808080"  # of dashed lines: to be read on light and dark paper


CHART = ChartFrame()


@dataclass(frozen=True)
class Line:
    """A curve of a chart: its points (K,), (K,), what it is called, its colour, and its style."""

    x: Array
    y: Array
    name: str
    colour: str
    dots: bool = False
    dashed: bool = False


def chart(
    title: str, lines: Sequence[Line], least: float | None = None, span: tuple[float, float] | None = None
) -> str:
    """Curves over time as a picture; of no curve a note that there are too few frames.

    Parameters
    ----------
    title : the quantity, with its unit
    lines : the curves
    least : the lowest value that the axis has at least
    span : s, when the flight is, shaded behind the curves
    """
    heading = f'<text x="{CHART.left}" y="13">{html.escape(title)}</text>'
    if not lines:
        return picture(heading + f'<text x="{CHART.left}" y="{CHART.height / 2}">too few frames</text>')
    x = np.concatenate([line.x for line in lines])
    y = np.concatenate([line.y for line in lines])
    low = float(y.min()) if least is None else min(least, float(y.min()))
    high = max(float(y.max()), low + 1e-3)
    low, high = low - 0.04 * (high - low), high + 0.04 * (high - low)
    first, last = float(x.min()), max(float(x.max()), float(x.min()) + 1e-3)

    def across(values: Array) -> Array:
        return CHART.left + (values - first) / (last - first) * (CHART.width - CHART.left - CHART.right)

    def up(values: Array) -> Array:
        return CHART.height - CHART.bottom - (values - low) / (high - low) * (CHART.height - CHART.top - CHART.bottom)

    parts = [heading]
    if span is not None:
        begin, end = across(np.array(span))
        height = CHART.height - CHART.top - CHART.bottom
        parts.append(f'<rect class="air" x="{begin:.1f}" y="{CHART.top}" width="{end - begin:.1f}" height="{height}"/>')
    for value in _ticks(low, high):
        pixel = float(up(np.array(value)))
        parts.append(
            f'<line class="axis" x1="{CHART.left}" x2="{CHART.width - CHART.right}" y1="{pixel:.1f}" y2="{pixel:.1f}"/>'
        )
        parts.append(f'<text x="{CHART.left - 5}" y="{pixel + 4:.1f}" text-anchor="end">{value:g}</text>')
    for value in _ticks(first, last):
        pixel = float(across(np.array(value)))
        parts.append(f'<text x="{pixel:.1f}" y="{CHART.height - 10}" text-anchor="middle">{value:g} s</text>')
    for number, line in enumerate(lines):
        parts.append(_curve(across(line.x), up(line.y), line))
        parts.append(
            f'<text class="name" x="{CHART.width - CHART.right + 8}" y="{CHART.top + 12 + 14 * number}"'
            f' style="--colour:{line.colour}">{html.escape(line.name)}</text>'
        )
    return picture("".join(parts))


def _curve(x: Array, y: Array, line: Line) -> str:
    colour = f'style="--colour:{line.colour}"'
    if line.dots:
        dots = ""
        for a, b in zip(x, y, strict=True):
            dots += f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.2" {colour}/>'
        return dots
    dashes = ' stroke-dasharray="5 4"' if line.dashed else ""
    return f'<polyline points="{points(x, y)}" {colour}{dashes}/>'


def points(x: Array, y: Array) -> str:
    """Corners (K,), (K,) px, as SVG lists them."""
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two others."""
    rough = (high - low) / 6  # six of them at most
    power = 10.0 ** np.floor(np.log10(rough))
    steps = power * np.array([1.0, 2.0, 5.0, 10.0])
    step = steps[steps >= rough][0]
    numbers = np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    return [round(float(number * step), 10) + 0.0 for number in numbers]


def picture(content: str) -> str:
    """SVG of a chart's size with some content."""
    width, height = CHART.width, CHART.height
    return f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}">{content}</svg>'
