"""A flight as a short film: GIF by Pillow, MP4 where ffmpeg is installed."""

import io
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from floatplan.errors import FloatplanError, InputError
from floatplan.files import write_atomically
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.trajectory import Trajectory
from floatplan.view.figures import snapshots
from floatplan.view.outlines import com_path, picture_box, postures, shown_obstacles, snapshot_times
from floatplan.view.style import PALETTE, new_figure, styled


@dataclass(frozen=True)
class FilmFormat:
    """Time and size of films."""

    rate: float = 25.0  # [Hz] of pictures: GIF counts in hundredths of a second
    speed: float = 0.5  # [-] of the film's clock against the flight's: a flight is too quick to follow
    longest: float = 60.0  # [s] of film: longer ones are a mistake
    landing_pause: float = 0.8  # [s] that the last picture stays
    width: int = 480  # [px] even, as MP4 needs
    dpi: float = 120  # [1/in]
    colours: int = 64  # of a GIF: fewer make small files


FILM = FilmFormat()


def animate(
    plan: Trajectory,
    path: str | Path = "flight.gif",
    *,
    speed: float = FILM.speed,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a film of a flight or jump, whole or not at all; arguments as of :meth:`floatplan.Plan.animate`.

    Raises
    ------
    InputError
        The ending is another, the speed makes a film of more than a minute, or ffmpeg is needed and not installed.
    """
    path = Path(path)
    if plan.duration / speed > FILM.longest:
        length = f"{speed:g} makes a film of {plan.duration / speed:.3g} s"
        raise InputError(f"{length}, longer than {FILM.longest:g} s", element="speed", advice="give a higher speed")
    if path.suffix not in (".gif", ".mp4"):
        raise InputError(f"must end in .gif or .mp4, not {path.suffix!r}", source=path)
    ffmpeg = shutil.which("ffmpeg")
    if path.suffix == ".mp4" and ffmpeg is None:
        raise InputError("ffmpeg is not installed", element="mp4", advice="install it, or write a .gif")
    frames = pictures(plan, speed, progress)
    if path.suffix == ".mp4":
        return write_atomically(path, _mp4(str(ffmpeg), frames))
    # the colours are those of a picture with everything in it: at the beginning of a jump forces are shown
    richest = 0 if isinstance(plan, JumpMotion) else len(frames) // 2
    return write_atomically(path, _gif(frames, richest))


def pictures(
    plan: Trajectory, speed: float = FILM.speed, progress: Callable[[int, int], None] | None = None
) -> list[Image.Image]:
    """Draw the film's pictures; what does not move is painted once."""
    count = max(2, round(plan.duration / speed * FILM.rate) + 1)
    times = np.linspace(0.0, plan.duration, count)
    with styled():
        figure, axes = _stage(plan)
        figure.canvas.draw()
        still = figure.canvas.copy_from_bbox(figure.bbox)  # type: ignore[attr-defined]
        frames = []
        for time in times:
            figure.canvas.restore_region(still)  # type: ignore[attr-defined]
            frames.append(_picture(figure, axes, plan, float(time)))
            if progress is not None:
                progress(len(frames), count)
        return frames


def _stage(plan: Trajectory) -> tuple[Figure, Axes]:
    """Return a figure with ground, standing obstacles and path."""
    low, high = picture_box(plan, postures(plan, np.linspace(0.0, plan.duration, 65)))
    shape = min(max((high - low).imag / (high - low).real, snapshots.FLATTEST), snapshots.TALLEST)
    figure = new_figure(FILM.width / FILM.dpi, 2 * round(FILM.width * shape / 2) / FILM.dpi)
    figure.set_dpi(FILM.dpi)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    snapshots.frame_box(axes, low, high)
    axes.set_axis_off()
    snapshots.draw_ground(axes, plan, postures(plan, snapshot_times(plan)))
    com = com_path(plan, np.linspace(0.0, plan.duration, 129))
    axes.plot(com.real, com.imag, color=PALETTE.grey, linewidth=0.7, zorder=2)
    for obstacle in shown_obstacles(plan.whole_problem):
        if obstacle.window is None and not any(obstacle.velocity):
            snapshots.draw_obstacle(axes, obstacle, np.array([0.0]))
    return figure, axes


def _picture(figure: Figure, axes: Axes, plan: Trajectory, time: float) -> Image.Image:
    before = set(axes.get_children())
    for obstacle in shown_obstacles(plan.whole_problem):
        low, high = obstacle.window or (0.0, plan.duration)
        if (obstacle.window is not None or any(obstacle.velocity)) and low <= time <= high:
            snapshots.draw_obstacle(axes, obstacle, np.array([time]))
    placed = postures(plan, np.array([time]))
    snapshots.draw_shadow(axes, placed, 0, zorder=0.9)
    snapshots.draw_posture(axes, placed, 0, strength=1.0, zorder=5, rings=(("white", 1.6),))
    if isinstance(plan, JumpMotion):
        snapshots.draw_forces(axes, plan, np.array([time]), np.zeros(1, dtype=np.complex128))
    axes.text(0.02, 0.98, f"{time:.2f} s", transform=axes.transAxes, ha="left", va="top", fontsize=9, color=PALETTE.ink)
    added = [artist for artist in axes.get_children() if artist not in before]
    for artist in sorted(added, key=lambda artist: artist.get_zorder()):
        axes.draw_artist(artist)
        artist.remove()
    return Image.fromarray(np.array(figure.canvas.buffer_rgba())).convert("RGB")  # type: ignore[attr-defined]


def _gif(frames: list[Image.Image], richest: int) -> bytes:
    """All pictures have the palette of one, so that their colours do not flicker."""
    one = frames[richest]
    palette = one.quantize(FILM.colours, method=Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE)
    shown = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    pause = round(1000 / FILM.rate)  # [ms]
    stream = io.BytesIO()
    waits = [pause] * (len(shown) - 1) + [round(1000 * FILM.landing_pause)]
    shown[0].save(stream, format="GIF", save_all=True, append_images=shown[1:], duration=waits, loop=0, optimize=True)
    return stream.getvalue()


def _mp4(ffmpeg: str, frames: list[Image.Image]) -> bytes:
    size = f"{frames[0].width}x{frames[0].height}"
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", f"{FILM.rate:g}", "-i", "-"]
        pause = f"tpad=stop_mode=clone:stop_duration={FILM.landing_pause}"
        encoded = ["-vf", pause, "-pix_fmt", "yuv420p", str(film)]
        content = b"".join(frame.tobytes() for frame in frames)
        command = [ffmpeg, "-loglevel", "error", *raw, *encoded]
        done = subprocess.run(command, input=content, capture_output=True, check=False)
        if done.returncode != 0:
            raise FloatplanError(f"ffmpeg failed: {done.stderr.decode(errors='replace').strip()}")
        return film.read_bytes()
