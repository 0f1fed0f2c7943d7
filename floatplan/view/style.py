"""The style of all pictures: colours that everyone can tell apart, sized for one column of a paper."""

import io
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple

from floatplan.arrays import Array

COLUMN = 3.35  # [in] one column of a two-column paper, 8.5 cm
LETTERS = 17.5  # [1/in] of a legend's text
ROW = 0.14  # [in] a line of a legend
HANDLE = 6  # [letters] width of a legend's handle
DPI = 300  # [1/in]
INK = "#222222"
GREY = "#8a8a8a"
PALE = "#c9c9c9"
ALARM = "#b00020"
OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
OBSTACLES = ("#444444", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")  # of curves, one per obstacle
CONTACTS = ("#8b5e00", "#6a3d9a", "#00787a", "#a4243b")  # of the points that a robot stands on
TRAILS = (GREY, *CONTACTS[:2])  # of the centre of mass, and of the frames that take off and land
SEQUENCE = "viridis"  # for more joints than there are hues that everyone can tell apart
BASE_GREY = "#555555"  # of the base beside it
SEQUENCE_END = 0.9  # [-] its last tenth is too light for white paper

TICKS = {"color": INK, "labelsize": 7, "major.width": 0.6, "major.size": 2.5}
RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: the same picture everywhere
    "font.size": 7.5,
    "text.parse_math": False,  # joints are called what they are called
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#ebebeb",
    "grid.linewidth": 0.5,
    **{f"{axis}tick.{name}": value for axis in "xy" for name, value in TICKS.items()},
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
COMPRESSION = 4  # [-] level of PNG files: higher ones take much longer
METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": "floatplan"},
    "svg": {"Creator": "floatplan", "Date": None},
    "pdf": {"Creator": "floatplan", "CreationDate": None},
}
_MATPLOTLIB_LOCK = threading.RLock()  # matplotlib's settings are one set for all threads
SIDE_BY_SIDE = {tuple: HandlerTuple(ndivide=None, pad=0)}  # legend handles made of several


@contextmanager
def styled() -> Iterator[None]:
    """Draw in this style inside the ``with``, one thread at a time, and leave matplotlib's settings as they were.

    Not for a generator that yields inside: another thread might end it, or none.
    """
    with _MATPLOTLIB_LOCK, matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(RC)
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, inches, that lays itself out and belongs to no window."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def rendered(figure: Figure, form: str, dpi: float = DPI) -> bytes:
    """Return the file's content. The layout is found once; matplotlib would find it twice per file."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)
    stream = io.BytesIO()
    options: dict[str, Any] = {"pil_kwargs": {"compress_level": COMPRESSION}} if form == "png" else {}
    figure.savefig(stream, format=form, dpi=dpi, metadata=METADATA[form], **options)
    return stream.getvalue()


def picture(form: str, draw: Callable[..., Figure], *about: Any) -> bytes:
    """Return the content of a file with the figure that a function draws, in this style."""
    with styled():
        return rendered(draw(*about), form)


def palette(count: int) -> list[Array]:
    """Return colours (3,) for the base and the joints: hues while they last, then grey and steps of one sequence."""
    if count <= len(OKABE_ITO):
        return [rgb(colour) for colour in OKABE_ITO[:count]]
    sequence = matplotlib.colormaps[SEQUENCE](np.linspace(0, SEQUENCE_END, count - 1))
    return [rgb(colour) for colour in (BASE_GREY, *sequence)]


def rgb(colour: Any) -> Array:
    """Red, green and blue (3,), from 0 to 1."""
    return np.array(to_rgb(colour))


def rgb_bytes(colour: Any) -> tuple[int, int, int]:
    """Red, green and blue, from 0 to 255."""
    red, green, blue = (int(255 * part) for part in to_rgb(colour))
    return red, green, blue


def faded(colour: Any, strength: float) -> Array:
    """Mix a colour (3,) with white paper: strength 1 is the colour, 0 the paper."""
    return np.asarray(1 - strength * (1 - rgb(colour)))


def legend_above(figure: Figure, entries: Sequence[tuple[Any, str]]) -> None:
    """Put a legend of (handle, name) above all axes, in as few rows as fit; the figure grows with them."""
    names = [f" {name}" if name.startswith("_") else name for _, name in entries]

    def letters(rows: int) -> int:
        """Width of a legend that is filled column by column, its handles included."""
        return sum(HANDLE + max(map(len, names[first : first + rows])) for first in range(0, len(names), rows))

    width, height = figure.get_size_inches()
    rows = next((rows for rows in range(1, len(names)) if letters(rows) <= width * LETTERS), len(names))
    figure.set_size_inches(width, height + ROW * (rows - 1))
    handles = [handle for handle, _ in entries]
    columns = -(-len(names) // rows)
    figure.legend(handles, names, loc="outside upper center", ncols=columns, handler_map=SIDE_BY_SIDE)


def round_below(value: float) -> float:
    """Return the largest of ..., 0.5, 1, 2, 5, 10, ... that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(factor for factor in (1, 2, 5) if factor * power <= value)
