"""Draws the pictures of the documentation into docs/images/. Run it from anywhere; it plans what it draws.

``scripts/make_images.py studies`` draws the maps of docs/studies.md instead: minutes, unless ``runs/`` has their rows.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import floatplan as fp
from floatplan.arrays import Array
from floatplan.files import write_atomically
from floatplan.motion.spatial.kinematics import centre_of_mass
from floatplan.view.charts import charts
from floatplan.view.figures.figures import draw_panel, figures, sample
from floatplan.view.figures.snapshots import (
    draw_flight,
    draw_posture,
    draw_surroundings,
    frame_box,
    moments,
    plan_names,
)
from floatplan.view.outlines import Postures, picture_box, postures, seen_robot, snapshot_times
from floatplan.view.solids import CAMERA
from floatplan.view.style import PALETTE, new_figure, palette, styled

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
DPI = 220
SHEET_DPI = 150  # of several figures in one picture
COLOURS = 128  # of the PNG palettes: flat pictures need no more
NARROWEST = 0.5  # width of a flight over its height, so that its title fits
GALLERY = {
    "new_configuration": "new configuration",
    "somersault": "somersault",
    "high_jump": "high jump",
    "falling_cat": "falling cat, h = 0",
}
SHOWN = {"obstacle": "obstacle", "go2": "gallery/go2"}
SLOWER = 1.4  # [-] a clip's flight
FPS = 50  # [Hz] its frames
BETWEEN = 0.08  # [s] from one posture to the next
POSTURES = 9  # [-]
APART = 0.82  # [m] in the picture
LOWEST, HIGHEST = -0.25, 1.0  # [m] in the picture
GROUND = 0.08  # [m] half of the height, in the picture, of the ground between left and right feet, seen from above
SHEET = (("configuration", "torques", "clearance"), ("rates", "snapshots"))


STUDIES = ("somersault", "weak_motors", "pole", "go2_flip", "go2_turn")


def main() -> None:
    if sys.argv[1:] == ["studies"]:
        maps()
    else:
        pictures()


def maps() -> None:
    for name in STUDIES:
        study = fp.study(ROOT / "problems" / "studies" / f"{name}.toml", folder=ROOT / "runs" / name)
        print(f"{name}: {study.statuses}")
        write_atomically(IMAGES / f"study_{name}.png", (study.folder / "map.png").read_bytes())


def pictures() -> None:
    for name, problem in SHOWN.items():
        drawn = figures(plan_of(problem, prove=True))
        save(rendered(drawn["kinogram"]), IMAGES / f"kinogram_{name}.png")
        columns = [[rendered(drawn[figure], SHEET_DPI) for figure in column] for column in SHEET]
        save(sheet(columns), IMAGES / f"figures_{name}.png")
    save(space_picture(["diver_full_twist", "go2_half_twist"]), IMAGES / "kinogram_space.png")
    with styled():
        go2 = jump_of("go2")
        save(jump_picture(go2), IMAGES / "jump_go2.png")
        go2.animate(IMAGES / "jump_go2.gif", speed=1.0)  # at the top of README
        save(clip_picture(go2), IMAGES / "clip_repair.png")
        save(rendered(flight(plan_of("handstand"))), IMAGES / "handstand.png")
        save(rendered(flight(plan_of("obstacle"), without_obstacles("obstacle"))), IMAGES / "obstacle.png")
        save(rendered(gallery({title: plan_of(name) for name, title in GALLERY.items()})), IMAGES / "flights.png")


def plan_of(name: str, *, prove: bool = False) -> fp.Plan:
    plan = fp.plan(fp.load_problem(ROOT / "problems" / f"{name}.toml"), prove=prove)
    if not plan.ok:
        raise SystemExit(f"{name}: {plan.explanation}")
    return plan


def jump_of(name: str) -> fp.Jump:
    jump = fp.jump(ROOT / "problems" / "jumps" / f"{name}.toml")
    if not jump.ok:
        raise SystemExit(f"{name}: {jump.explanation}")
    return jump


def without_obstacles(name: str) -> fp.Plan:
    return fp.plan(replace(fp.load_problem(ROOT / "problems" / f"{name}.toml"), obstacles=()))


def flight(plan: fp.Plan, other: fp.Plan | None = None) -> Figure:
    """The flight at the left, its angles and torques at the right; those of another plan dashed."""
    figure = new_figure(7.6, 3.7)
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1], wspace=0.06, hspace=0.08)
    draw_scene(figure.add_subplot(grid[:, 0]), plan)
    angles = figure.add_subplot(grid[0, 1])
    torques = figure.add_subplot(grid[1, 1], sharex=angles)
    sampled, beside = sample(plan), None if other is None else sample(other, plan)
    drawn = {chart.name: chart for chart in charts(sampled)}
    for axes, name in ((angles, "configuration"), (torques, "torques")):
        draw_panel(axes, drawn[name], drawn[name].panels[0], sampled, beside)
    angles.tick_params(labelbottom=False)
    torques.set(xlim=(0, plan.duration), xlabel="time (s)")
    names = ("orientation", *plan.robot.joints)
    handles = [Line2D([], [], color=colour) for colour in palette(len(names))]
    if other is not None:
        names += (plan_names(plan, other)[1],)
        handles.append(Line2D([], [], color=PALETTE.grey, linestyle="--"))
    angles.legend(handles, names, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=min(len(names), 3))
    return figure


def gallery(plans: dict[str, fp.Plan]) -> Figure:
    """Flights side by side, each at its own scale and as wide as it needs."""
    boxes = [picture_box(plan, postures(plan, snapshot_times(plan))) for plan in plans.values()]
    widths = [max((high - low).real / (high - low).imag, NARROWEST) for low, high in boxes]
    figure = new_figure(7.6, 7.3 / sum(widths) + 0.25)
    for axes, (title, plan) in zip(row(figure, widths), plans.items(), strict=True):
        draw_scene(axes, plan)
        axes.set_title(title, fontsize=8)
    return figure


def row(figure: Figure, widths: Sequence[float]) -> Sequence[Axes]:
    grid = figure.add_gridspec(1, len(widths), width_ratios=widths, wspace=0.03)
    return [figure.add_subplot(grid[0, column]) for column in range(len(widths))]


def draw_scene(axes: Axes, plan: fp.Plan, times: Array | None = None) -> None:
    placed = postures(plan, snapshot_times(plan) if times is None else times)
    frame_box(axes, *picture_box(plan, placed))
    axes.set_axis_off()
    draw_surroundings(axes, plan, placed)
    draw_flight(axes, plan, placed)


def jump_picture(jump: fp.Jump) -> Image.Image:
    """A jump's moments, and under them the forces on its feet and what its torques take of their limits, over time."""
    drawn = jump.figures()
    curves = sheet([[rendered(drawn[name])] for name in ("forces", "torque_use")])
    return sheet([[rendered(moments(jump, flying=5)), curves]])


def clip_picture(jump: fp.Jump) -> Image.Image:
    """A jump as a clip whose flight is played too slowly, and its repair: both at the same steps of time."""
    (flight,) = (phase for phase in jump.phases if not phase.contacts)
    longer = (SLOWER - 1) * (flight.end - flight.begin)
    times = np.arange(int((jump.duration + longer) * FPS)) / FPS
    of_clip = [0, flight.begin, flight.end + longer, jump.duration + longer]
    of_jump = [0, flight.begin, flight.end, jump.duration]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "clip.csv"
        np.savetxt(path, jump.q(np.interp(times, of_clip, of_jump)), delimiter=",")
        clip = fp.load_clip(path, model=jump.robot.path, fps=FPS, quaternion="xyzw")
    repaired, _ = fp.repair_clip(clip)
    figure = new_figure(7.6, 3.4)
    for axes, (name, each) in zip(figure.subplots(2, 1), (("clip", clip), ("repaired", repaired)), strict=True):
        (judged,) = fp.check_clip(each).flights
        since = BETWEEN * np.arange(-1, POSTURES - 1, dtype=np.float64)
        placed = seen_clip(each, judged.flight.begin + since)
        axes.axhspan(-GROUND, GROUND, color="#eeece6", zorder=0, linewidth=0)
        for index, passed in enumerate(since):
            middle = APART * index
            draw_posture(axes, placed, index, strength=1.0, zorder=3, shift=middle - placed.com[index].real)
            flies = 0.0 <= passed <= judged.flight.duration
            where = "in the air" if flies else "on the ground"
            colour = PALETTE.ink if flies else PALETTE.grey
            axes.text(middle, LOWEST, f"{passed:+.2f} s\n{where}", fontsize=6, ha="center", color=colour)
        axes.set_title(f"{name}: {judged.verdict}, falls at {judged.fall.fall:.2f} m/s²", fontsize=8)
        axes.set_axis_off()
        frame_box(axes, -APART / 2 + 1j * LOWEST, APART * (POSTURES - 0.5) + 1j * HIGHEST)
    return rendered(figure)


def seen_clip(clip: fp.Clip, times: Array) -> Postures:
    poses = clip.curve.poses(times)
    com = centre_of_mass(clip.robot, poses)
    return seen_robot(clip.robot, times, poses, CAMERA(com))


def space_picture(names: Sequence[str]) -> Image.Image:
    """Kinograms of flights in space, side by side."""
    return sheet([[rendered(figures(plan_of(f"space/{name}"))["kinogram"])] for name in names])


def rendered(figure: Figure, dpi: int = DPI) -> Image.Image:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    return Image.open(stream).convert("RGB")


def sheet(columns: Sequence[Sequence[Image.Image]]) -> Image.Image:
    """Pictures in columns."""
    widths = [max(picture.width for picture in column) for column in columns]
    whole = Image.new(
        "RGB", (sum(widths), max(sum(picture.height for picture in column) for column in columns)), "white"
    )
    for index, column in enumerate(columns):
        for row, picture in enumerate(column):
            whole.paste(picture, (sum(widths[:index]), sum(above.height for above in column[:row])))
    return whole


def save(picture: Image.Image, path: Path) -> None:
    content = io.BytesIO()
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(content, format="PNG", optimize=True)
    write_atomically(path, content.getvalue())
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
