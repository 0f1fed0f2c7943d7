"""The style of all pictures: colours that everyone can tell apart, sized for one column of a paper."""

import io
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple

from floatplan.arrays import Array

COLUMN = 3.35  # [in] one column of a two-column paper, 8.5 cm


@dataclass(frozen=True)
class Palette:
    """Colours of figures and pages."""

    ink: str = "#222222"
    grey: str = "#8a8a8a"
    pale: str = "#c9c9c9"
    shadow: str = "#d6d3cb"
    alarm: str = "#b00020"
    hues: tuple[str, ...] = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe and Ito's
    obstacles: tuple[str, ...] = ("#444444", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")  # of their curves
    contacts: tuple[str, ...] = ("#8b5e00", "#6a3d9a", "#00787a", "#a4243b")  # of the points that a robot stands on
    trails: tuple[str, ...] = ("#8a8a8a", "#8b5e00", "#6a3d9a")  # of the CM, and of frames that take off and land
    sequence: str = "viridis"  # for more joints than there are hues that everyone can distinguish


PALETTE = Palette()
METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": "floatplan"},
    "svg": {"Creator": "floatplan", "Date": None},
    "pdf": {"Creator": "floatplan", "CreationDate": None},
}
_MATPLOTLIB_LOCK = threading.RLock()  # matplotlib's settings are one set for all threads


@contextmanager
def styled() -> Iterator[None]:
    """Draw in this style inside the ``with``, one thread at a time, and leave matplotlib's settings as they were.

    Not for a generator that yields inside: another thread might end it, or none.
    """
    with _MATPLOTLIB_LOCK, matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            {
                "font.family": "DejaVu Sans",  # ships with matplotlib: the same picture everywhere
                "font.size": 7.5,
                "text.parse_math": False,  # joints are called what they are called
                "text.color": PALETTE.ink,
                "axes.edgecolor": PALETTE.ink,
                "axes.labelcolor": PALETTE.ink,
                "axes.labelsize": 7.5,
                "axes.linewidth": 0.6,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.grid": True,
                "axes.axisbelow": True,
                "grid.color": "#ebebeb",
                "grid.linewidth": 0.5,
                "xtick.color": PALETTE.ink,
                "xtick.labelsize": 7,
                "xtick.major.width": 0.6,
                "xtick.major.size": 2.5,
                "ytick.color": PALETTE.ink,
                "ytick.labelsize": 7,
                "ytick.major.width": 0.6,
                "ytick.major.size": 2.5,
                "legend.fontsize": 7,
                "legend.frameon": False,
                "legend.handlelength": 1.5,
                "legend.handletextpad": 0.5,
                "legend.columnspacing": 1.2,
                "legend.borderaxespad": 0.2,
                "legend.borderpad": 0.1,
                "lines.linewidth": 1.3,
                "lines.solid_capstyle": "round",
                "figure.constrained_layout.h_pad": 0.03,
                "figure.constrained_layout.w_pad": 0.03,
                "svg.fonttype": "path",
                "svg.hashsalt": "floatplan",  # element names, and with them the files, repeat
            }
        )
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches, that lays itself out and belongs to no window."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def rendered(figure: Figure, form: str, dpi: float = 300) -> bytes:
    """Return the file's content. The layout is computed once; matplotlib would compute it twice per file."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)
    stream = io.BytesIO()
    # level 4: higher ones take much longer, and save little
    options: dict[str, Any] = {"pil_kwargs": {"compress_level": 4}} if form == "png" else {}
    figure.savefig(stream, format=form, dpi=dpi, metadata=METADATA[form], **options)
    return stream.getvalue()


def picture(form: str, draw: Callable[..., Figure], *about: Any) -> bytes:
    """Return the content of a file with a figure in this style; a function renders it."""
    with styled():
        return rendered(draw(*about), form)


def palette(count: int) -> list[Array]:
    """Return colours (3,) for the base and the joints: hues while they last, then grey and steps of one sequence."""
    if count <= len(PALETTE.hues):
        return list(map(rgb, PALETTE.hues[:count]))
    # the last tenth of the sequence is too light for white paper
    sequence = matplotlib.colormaps[PALETTE.sequence](np.linspace(0, 0.9, count - 1))
    return [rgb("#555555"), *map(rgb, sequence)]


def rgb(colour: Any) -> Array:
    """Red, green and blue (3,), from 0 to 1."""
    return np.array(to_rgb(colour))


def rgb_bytes(colour: Any) -> tuple[int, int, int]:
    """Red, green and blue, from 0 to 255."""
    red, green, blue = to_rgb(colour)
    return int(255 * red), int(255 * green), int(255 * blue)


def faded(colour: Any, strength: float) -> Array:
    """Mix a colour (3,) with white paper: strength 1 is the colour, 0 the paper."""
    return np.asarray(1 - strength * (1 - rgb(colour)))


def legend_above(figure: Figure, entries: Sequence[tuple[Any, str]]) -> None:
    """Put a legend of (handle, name) above all axes, in as few rows as fit; the figure grows with them."""
    names = [f" {name}" if name.startswith("_") else name for _, name in entries]

    def letters(rows: int) -> int:
        """Width of a legend that is filled column by column, its handles included."""
        width = 0
        for first in range(0, len(names), rows):
            width += 6 + max(map(len, names[first : first + rows]))  # a handle is as wide as 6 letters
        return width

    width, height = figure.get_size_inches()
    rows = 1
    while rows < len(names) and letters(rows) > width * 17.5:  # [1/in] letters of a legend's text
        rows += 1
    figure.set_size_inches(width, height + 0.14 * (rows - 1))  # [in] a line of a legend
    columns = -(-len(names) // rows)
    side_by_side = {tuple: HandlerTuple(ndivide=None, pad=0)}  # handles made of several
    handles = [handle for handle, _ in entries]
    figure.legend(handles, names, loc="outside upper center", ncols=columns, handler_map=side_by_side)


def round_below(value: float) -> float:
    """Return the largest of ..., 0.5, 1, 2, 5, 10, ... that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(factor for factor in (1, 2, 5) if factor * power <= value)
