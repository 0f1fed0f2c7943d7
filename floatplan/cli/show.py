"""The commands that show a plan or a jump, and hand a plan on: ``show`` and ``export``."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from floatplan.cli.common import OpenPage, PlanFile, Quiet, Urdf, print_path
from floatplan.cli.progress import progress
from floatplan.errors import naming
from floatplan.files import read_json

Output = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="DIR", help="Where files go; beside the plan if left out.")
]


def show(
    plan_file: Annotated[str, typer.Argument(metavar="FILE.json", help="A plan file, or a jump's.")],
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
    from floatplan.plans.plan import load_plan

    content = read_json(Path(plan_file), kind="a plan or jump file")
    plan: Any
    if isinstance(content, dict) and str(content.get("format")).startswith("floatplan.jump/"):
        from floatplan.stance.jump_file import load_jump
        from floatplan.view.jumps import JumpView

        jump = load_jump(plan_file, urdf)
        with naming(plan_file):
            plan = JumpView(jump, jump.check, jump.verdict)
    else:
        plan = load_plan(plan_file, urdf)
    other = None if compare is None else load_plan(compare)
    directory = Path(plan_file).parent if output is None else output
    check_directory(directory)
    formats = [name for name, wanted in (("png", png or (other is not None and not svg)), ("svg", svg)) if wanted]
    films = [name for name, wanted in (("gif", gif), ("mp4", mp4)) if wanted]
    files = []
    with progress("drawing", quiet) as bar:
        if not (scene or formats or films):
            from floatplan.view.report.report import write_report

            files.append(write_report(plan, directory / REPORT))
        if scene:
            from floatplan.view.scene.scene import write_scene

            files.append(write_scene(plan, directory / SCENE))
        if formats:
            from floatplan.view.figures.figures import save_figures

            files += save_figures(plan, directory / FIGURES, compare=other, formats=formats)
        for name in films:
            from floatplan.view.figures.animation import animate

            files.append(animate(plan, directory / f"{FILM}.{name}", speed=speed, progress=bar.reach))
    if not quiet:
        for path in files:
            print_path(path)
    if open_page:
        for path in files:
            if path.suffix == ".html":
                webbrowser.open(path.resolve().as_uri())


def export(
    plan_file: PlanFile,
    form: Annotated[str, typer.Option("--format", "-f", metavar="NAME", help="One of those above.")],
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Instants per second; left out, what suits the format.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="The file; beside the plan if left out.")
    ] = None,
    urdf: Urdf = None,
    quiet: Quiet = False,
) -> None:
    """Hand a plan on, to a robot, a simulator or another program. SI units and radians.

    \b
    csv        planned joints and those that follow them, 1 kHz
    csv-full   base pose and all joints, one row per instant
    parquet    the same as Parquet (extra "parquet")
    npz        NumPy: what plan.at() gives
    pinocchio  NumPy: q, v, a, tau of Pinocchio's free-flyer model
    mujoco     NumPy: qpos, qvel, ctrl with a free joint
    ros        trajectory_msgs/JointTrajectory as YAML
    mcap       a ROS 2 bag, also for Foxglove (extra "mcap")
    unitree    CSV as Unitree's motion data
    """  # noqa: D301
    from floatplan.export.formats import export as write
    from floatplan.export.formats import format_of
    from floatplan.plans.plan import load_plan

    known = format_of(form)
    plan = load_plan(plan_file, urdf)
    path = Path(plan_file).parent / known.file if output is None else output
    with progress("exporting", quiet):
        path = write(plan, form, path, rate)
    if not quiet:
        print_path(path)
