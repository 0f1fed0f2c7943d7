"""The commands that take a plan or a jump: ``certify`` and ``replay`` it, ``show`` it, and ``export`` it."""

from __future__ import annotations

import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Annotated, Any, NoReturn

import floatplan as fp
from floatplan.cli import common
from floatplan.cli.common import flag, option
from floatplan.cli.progress import progress
from floatplan.errors import InputError, naming

Output = Annotated[Path | None, option("DIR", "Where files go; next to the plan if left out.", "--output", "-o")]
FlightPages = Annotated[
    Path | None,
    option(
        "DIR",
        "Put flights.html, with its pictures, into this folder; of a jump report.html and flight.gif too.",
        "--output",
        "-o",
    ),
]
Engine = Annotated[
    str | None,
    common.choice_option(
        "simulator", "The simulator: ", "; the former if left out, but of jumps, which need the latter"
    ),
]
Feedback = Annotated[
    float | None,
    option("RAD/S", "Bandwidth of joint feedback; left out, open loop, 100 with --replan, or as --kp says."),
]
JumpStiffness = Annotated[
    str | None,
    option("K|J=K,..", "Stiffness of a jump's joints, N m/rad, of all or by name; without, nor --feedback, searched."),
]
Errors = Annotated[
    str,
    option(
        "h=1%,..",
        "Errors of h at takeoff, of mass, of torque: h=1%,mass=2%,torque=1%; with --replan of h, inertia, torque, "
        "rise, noise, delay: h=10%,inertia=5%,noise=0.1deg,delay=5ms if left out; of a jump "
        "mass=5%,inertia=5%,friction=20%,armature=0.01,torque=5%,noise=0.1deg,delay=4ms.",
    ),
]


def certify(
    plan_file: common.PlanFile,
    urdf: common.Urdf = None,
    budget: Annotated[
        int | None, option("N", "Most intervals of time to examine; fewer may decide less.", min=1)
    ] = None,
    out_of_plane: Annotated[
        bool, flag("Bound also how far the robot leaves its plane in space, in rad.", "--out-of-plane")
    ] = False,
    save: common.Save = False,
    json_output: common.Json = False,
) -> None:
    """Prove that a plan holds at every instant, not only at sampled ones. Exit code 0 only where proved."""
    with progress("proving"):
        most = {} if budget is None else {"budget": budget}
        certificate = fp.certify(plan_file, urdf=urdf, out_of_plane=out_of_plane, **most)
    facts = certificate.to_dict()
    if save:
        from floatplan.plans.reading import load_record

        load_record(plan_file).with_checks(certificate=facts).save(plan_file)
    common.finish(facts, json_output, lambda summary: summary.certificate_summary(certificate), certificate.proved)


def replay(
    motion_file: common.MotionFile,
    urdf: common.Urdf = None,
    engine: Engine = None,
    perturb: Errors = "",
    feedback: Feedback = None,
    step: Annotated[float | None, option("S", "Longest step of MuJoCo, s; 5e-4 if left out.")] = None,
    replan: Annotated[
        float | None, option("HZ", "Correct in flight, so often a second: many flights, with and without.")
    ] = None,
    flights: Annotated[
        int | None,
        option(
            "N",
            "Number of flights, each with errors of its own: 20 with --replan, else 1.",
            "--flights",
            "--runs",
            min=1,
        ),
    ] = None,
    budget: Annotated[
        float,
        option("S", "Time after which no flight begins, s; with --replan on a plan, flights under way are dropped."),
    ] = 60.0,
    seed: Annotated[int, common.count_option("seed", "Of their errors and noise.")] = 0,
    friction: Annotated[
        float | None, common.key_option("MU", "jump.friction", more="For jumps only.", left_out="that of the problem")
    ] = None,
    kp: JumpStiffness = None,
    kd: Annotated[str | None, option("K|J=K,..", "Their damping, N m s/rad.")] = None,
    authority: Annotated[
        bool, flag("Tell from which errors corrections still land, and until when.", "--authority")
    ] = False,
    output: FlightPages = None,
    save: common.Save = False,
    json_output: common.Json = False,
) -> None:
    """Fly a plan by forward dynamics under its torques. Exit code 1 where that misses the goal, undisturbed.

    With --replan, fly it many times with errors, corrected in flight and not. With --authority, tell how much can be
    corrected. A jump is simulated in MuJoCo with contact, from standing to a second after its end.
    """
    from floatplan.cli.results import check_directory
    from floatplan.simulation.engines import check_engine

    checked = check_engine(engine or "pinocchio")
    plan = common.read_motion(motion_file, urdf)
    of_jumps = {"friction": friction, "kp": kp, "kd": kd}
    of_plans = {"step": step, "authority": authority or None, "save": save or None}
    others, kind = (of_jumps, "jumps") if isinstance(plan, fp.Plan) else (of_plans, "plans")
    for name, value in others.items():
        if value is not None:
            raise InputError(f"is for {kind}", element=f"--{name}", advice="leave it out")
    if output is not None:
        check_directory(output)
    if not isinstance(plan, fp.Plan):
        if engine not in (None, "mujoco"):
            raise InputError("knows no ground, which a jump needs", element="--engine", advice="give 'mujoco'")
        options = {"replan": replan, "perturb": perturb, "flights": flights or 1, "seed": seed, "budget": budget}
        gains = _jump_gains(kp, kd, feedback)
        with _naming_the_file(motion_file):
            _fly_jump(plan, output, json_output, gains=gains, friction=friction, **options)
    if output is not None and replan is None:
        raise InputError("is for --replan", element="--output", advice="add it")
    if replan is not None or authority:
        if save:
            raise InputError("keeps an undisturbed replay only", element="--save", advice="leave it out")
        chosen = {"flights": flights, "budget": budget, "seed": seed, "feedback": feedback, "perturb": perturb or None}
        _fly_many(plan, replan, authority, output, json_output, engine=checked, **chosen)
    if flights is not None and flights > 1:
        if save:
            raise InputError("keeps a single replay only", element="--save", advice="leave --runs out")
        options = {"engine": checked, "perturb": perturb, "feedback": feedback, "step": step}
        _fly_often(plan, json_output, flights, seed=seed, budget=budget, **options)
    saved_to = motion_file if save else None
    _fly_once(plan, saved_to, json_output, engine=checked, perturb=perturb, feedback=feedback, step=step, seed=seed)


def _jump_gains(kp: str | None, kd: str | None, feedback: float | None) -> Any:
    """Gains of a jump as :func:`floatplan.replay_jump` takes them; InputError where both kinds are requested."""
    from floatplan.cli.option_values import gain

    if feedback is None:
        return gain("--kp", kp), gain("--kd", kd)
    if kp is not None or kd is not None:
        raise InputError("gives the gains of all joints", element="--feedback", advice="leave --kp and --kd out")
    return feedback


def _fly_once(
    plan: fp.Plan, saved_to: str | None, json_output: bool, *, step: float | None, **options: Any
) -> NoReturn:
    """Fly a plan, save the replay into the file ``saved_to`` where there is one, and print."""
    from floatplan.simulation.mujoco_model import STEP

    with progress("flying"):
        replay = fp.replay(plan, step=STEP if step is None else step, **options)
    facts = replay.to_dict()
    if saved_to is not None:
        plan.record.with_checks(replay=facts).save(saved_to)
    common.finish(facts, json_output, lambda summary: summary.replay_summary(replay), replay.landed or replay.disturbed)


def _fly_often(plan: fp.Plan, json_output: bool, flights: int, **options: Any) -> NoReturn:
    """Fly a plan many times, and print; options are those of :func:`floatplan.simulation.replay.replays`."""
    from floatplan.arguments import without_none
    from floatplan.simulation.replay import replays

    chosen = without_none(options)
    with progress("flying", tell=True) as bar:
        results = replays(plan, flights, progress=partial(bar.count, "flight"), **chosen)
    facts = [flight.to_dict() for flight in results]
    ok = all(flight.landed or flight.disturbed for flight in results)
    facts_of_all = {"asked": flights, "flights": facts}
    common.finish(facts_of_all, json_output, lambda summary: summary.replays_summary(results, flights), ok)


def _fly_jump(jump: fp.Jump, output: Path | None, json_output: bool, **options: Any) -> NoReturn:
    """Fly a jump, and print; ``options`` are those of :func:`floatplan.replay_jump`."""
    with progress("flying", tell=True) as bar:
        replay = fp.replay_jump(jump, progress=bar.count, **options)
        files = list[Path]()
    if output is not None:
        from floatplan.view.report.flights import write_jump_pages

        with progress("drawing") as bar:
            files = write_jump_pages(replay, output, bar.reach)
    ok = replay.landed or replay.perturbation.any
    common.finish(replay.to_dict(), json_output, lambda summary: summary.jump_replay_summary(replay, files), ok)


def _fly_many(
    plan: fp.Plan, rate: float | None, with_authority: bool, output: Path | None, json_output: bool, **options: Any
) -> NoReturn:
    """Fly with corrections and without where there is a rate, tell on request how much they can do, and print.

    ``options`` are those of :func:`floatplan.closed_loop`; None is left to it.
    """
    from floatplan.arguments import without_none

    chosen = without_none(options)
    closed_loop = None if rate is None else fp.closed_loop(plan, rate, **chosen)
    authority = fp.authority(plan) if with_authority else None
    page = None
    if output is not None and closed_loop is not None:
        from floatplan.view.report.flights import write_flights_page

        page = write_flights_page(plan, output / "flights.html", closed_loop)
    facts: dict[str, Any] = {} if closed_loop is None else closed_loop.to_dict()
    facts |= {} if authority is None else {"authority": authority.to_dict()}
    common.finish(facts, json_output, lambda summary: summary.flights_summary(closed_loop, authority, page))


def show(
    motion_file: common.MotionFile,
    scene: Annotated[bool, flag("The motion in 3-D with the robot's meshes, one page.", "--scene")] = False,
    png: Annotated[bool, flag("The figures as PNG: curves, kinogram or moments.", "--png")] = False,
    svg: Annotated[bool, flag("The same as SVG.", "--svg")] = False,
    gif: Annotated[bool, flag("A film, GIF.", "--gif")] = False,
    mp4: Annotated[bool, flag("A film, MP4; needs ffmpeg.", "--mp4")] = False,
    compare: Annotated[str | None, option("PLAN.json", "A second plan for the figures, as dashed lines.")] = None,
    speed: Annotated[float, option("X", "Of films: 0.5 is slow motion.")] = 0.5,
    output: Output = None,
    urdf: common.Urdf = None,
    open_page: common.OpenPage = False,
    quiet: common.Quiet = False,
) -> None:
    """Show a plan or a jump: a page that plays it, without a network. Options ask for other pictures instead."""
    from floatplan.cli.results import ResultFile, check_directory

    motion = common.read_motion(motion_file, urdf)
    with naming(motion_file):
        motion.refuse_unless_shown()
        _ = motion.whole_problem  # a jump's is made now, or refused with the name of its file
    if isinstance(motion, fp.Jump) and not motion.ok:
        common.tell(quiet)(f"warning: this jump does not hold: {motion.check.sentences[0]}")
    other = None if compare is None else fp.load_plan(compare)
    directory = Path(motion_file).parent if output is None else output
    check_directory(directory)
    png = png or (other is not None and not svg)
    formats = list(compress(("png", "svg"), (png, svg)))
    films = list(compress(("gif", "mp4"), (gif, mp4)))
    files = []
    with progress("drawing", quiet) as bar:
        if not (scene or formats or films):
            files.append(motion.show(directory / ResultFile.REPORT, browse=False))
        if scene:
            from floatplan.view.scene.scene import write_scene

            files.append(write_scene(motion, directory / ResultFile.SCENE))
        if formats:
            from floatplan.view.figures.figures import save_figures

            files += save_figures(motion, directory / ResultFile.FIGURES, compare=other, formats=formats)
        for name in films:
            files.append(motion.animate(directory / f"{ResultFile.FILM}.{name}", speed=speed, progress=bar.reach))
    if not quiet:
        for path in files:
            common.print_path(path)
    if open_page:
        for path in files:
            if path.suffix == ".html":
                webbrowser.open(path.resolve().as_uri())


class ExportCommand(common.Command):
    """Its help ends with the formats."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """List them."""
        from floatplan.export.formats import FORMATS

        with formatter.section("Formats"):
            formatter.write_dl([(name, form.text) for name, form in FORMATS.items()])


@contextmanager
def _naming_the_file(motion_file: str | Path) -> Iterator[None]:
    """Name the file in what is wrong with a motion; an option that is wrong keeps its own name."""
    try:
        yield
    except InputError as error:
        option = (error.element or "").partition(":")[0]
        if error.source or option in (
            *("format", "rate", "model", "kp", "kd"),
            *("replan", "perturb", "flights", "seed", "friction", "budget"),
        ):
            raise
        raise error.within(source=motion_file) from None


def export(
    motion_file: common.MotionFile,
    form: Annotated[str, option("NAME", "One of those below.", "--format", "-f")],
    rate: Annotated[float | None, option("HZ", "Instants per second; left out, what suits the format.")] = None,
    kp: Annotated[
        str | None,
        option(
            "K|J=K,..",
            "Stiffness of the joints, N m/rad, of all or by name; of a jump as of its lightest joint at 125 rad/s if "
            "left out.",
        ),
    ] = None,
    kd: Annotated[
        str | None, option("K|J=K,..", "Their damping, N m s/rad; the critical one, or nearly so, if left out.")
    ] = None,
    model: Annotated[str | None, option("FILE", common.MODEL)] = None,
    output: Annotated[Path | None, option("FILE", "The file; next to the plan if left out.", "--output", "-o")] = None,
    urdf: common.Urdf = None,
    quiet: common.Quiet = False,
) -> None:
    """Hand a plan or a whole jump on, to a robot, a simulator or another program. SI units and radians.

    Files of jumps also have phases, contacts, forces and gains, where their format has them.
    """
    from floatplan.cli.option_values import gain
    from floatplan.export.formats import extras_path, format_of, read_notes

    chosen_format = format_of(form)
    stiffness, damping = gain("--kp", kp), gain("--kd", kd)
    motion = common.read_motion(motion_file, urdf)
    path = Path(motion_file).parent / chosen_format.file if output is None else output
    common.check_model(form, model, motion.problem.robot, quiet)
    with progress("exporting", quiet), _naming_the_file(motion_file):
        path = motion.export(form, path, rate, kp=stiffness, kd=damping, model=model)
    if not quiet:
        for note in read_notes(path) if form == "mujoco" else ():
            common.tell(quiet)(f"{form}: {note}")
        extras = extras_path(path)
        if chosen_format.extras is not None and extras.is_file():
            common.tell(quiet)(f"{extras.name}, next to it, has what {form} cannot hold: velocities, contacts")
        common.print_path(path)
