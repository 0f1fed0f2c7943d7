"""The commands that show a plan or a jump, and hand a plan on: ``show`` and ``export``."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

import floatplan as fp
from floatplan.cli.common import MotionFile, OpenPage, Quiet, Urdf, print_path, read_motion
from floatplan.cli.progress import progress
from floatplan.errors import naming

Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="DIR", help="Where files go; beside the plan if left out.")
]


STIFFNESS = (
    "Stiffness of the joints, N m/rad, of all or by name; of a jump that of a bandwidth of 100 rad/s if left out."
)
DAMPING = "Their damping, N m s/rad; the critical one if left out."


def show(
    motion_file: MotionFile,
    scene: Annotated[
        bool, typer.Option("--scene", help="The motion in 3-D with the robot's meshes, one page.")
    ] = False,
    png: Annotated[bool, typer.Option("--png", help="The figures as PNG: curves, kinogram or moments.")] = False,
    svg: Annotated[bool, typer.Option("--svg", help="The same as SVG.")] = False,
    gif: Annotated[bool, typer.Option("--gif", help="A film, GIF.")] = False,
    mp4: Annotated[bool, typer.Option("--mp4", help="A film, MP4; needs ffmpeg.")] = False,
    compare: Annotated[
        str | None, typer.Option(metavar="PLAN.json", help="A second plan for the figures, drawn dashed.")
    ] = None,
    speed: Annotated[float, typer.Option(metavar="X", help="Of films: 0.5 is slow motion.")] = 0.5,
    output: Output = None,
    urdf: Urdf = None,
    open_page: OpenPage = False,
    quiet: Quiet = False,
) -> None:
    """Show a plan or a jump: a page that plays it, without a network. Options ask for other pictures instead."""
    from floatplan.cli.results import FIGURES, FILM, REPORT, SCENE, check_directory

    motion = read_motion(motion_file, urdf)
    with naming(motion_file):
        plan = motion.view
        _ = plan.problem  # a jump's is made now, or refused with the name of its file
    other = None if compare is None else fp.load_plan(compare)
    directory = Path(motion_file).parent if output is None else output
    check_directory(directory)
    formats = [name for name, wanted in (("png", png or (other is not None and not svg)), ("svg", svg)) if wanted]
    films = [name for name, wanted in (("gif", gif), ("mp4", mp4)) if wanted]
    files = []
    with progress("drawing", quiet) as bar:
        if not (scene or formats or films):
            files.append(motion.show(directory / REPORT, browse=False))
        if scene:
            from floatplan.view.scene.scene import write_scene

            files.append(write_scene(plan, directory / SCENE))
        if formats:
            from floatplan.view.figures.figures import save_figures

            files += save_figures(plan, directory / FIGURES, compare=other, formats=formats)
        for name in films:
            files.append(motion.animate(directory / f"{FILM}.{name}", speed=speed, progress=bar.reach))
    if not quiet:
        for path in files:
            print_path(path)
    if open_page:
        for path in files:
            if path.suffix == ".html":
                webbrowser.open(path.resolve().as_uri())


class ExportCommand(TyperCommand):
    """Its help ends with the formats."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """List them."""
        from floatplan.export.formats import FORMATS

        with formatter.section("Formats"):
            formatter.write_dl([(name, form.text) for name, form in FORMATS.items()])


def export(
    motion_file: MotionFile,
    form: Annotated[str, typer.Option("--format", "-f", metavar="NAME", help="One of those below.")],
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Instants per second; left out, what suits the format.")
    ] = None,
    kp: Annotated[str | None, typer.Option(metavar="K|J=K,..", help=STIFFNESS)] = None,
    kd: Annotated[str | None, typer.Option(metavar="K|J=K,..", help=DAMPING)] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="The file; beside the plan if left out.")
    ] = None,
    urdf: Urdf = None,
    quiet: Quiet = False,
) -> None:
    """Hand a plan or a whole jump on, to a robot, a simulator or another program. SI units and radians.

    Files of jumps also have phases, contacts, forces and gains, where their format has room for them.
    """
    from floatplan.cli.asked import gain
    from floatplan.export.formats import format_of

    known = format_of(form)
    stiffness, damping = gain("--kp", kp), gain("--kd", kd)
    motion = read_motion(motion_file, urdf)
    path = Path(motion_file).parent / known.file if output is None else output
    with progress("exporting", quiet):
        path = motion.export(form, path, rate, kp=stiffness, kd=damping)
    if not quiet:
        print_path(path)
