"""The commands about robots and problem files: which robots there are, what one is, a first problem, bounds of h."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

import floatplan as fp
from floatplan.cli import common
from floatplan.cli.common import count_option, flag, key_option, option
from floatplan.cli.progress import progress
from floatplan.errors import InputError, escaped, install_advice
from floatplan.files import json_value, write_atomically

if TYPE_CHECKING:
    from floatplan.initial.options import InitOptions
    from floatplan.motion.flight import Reachable

LISTED = "-"  # stands for no file

Takeoff = Annotated[str | None, key_option("FRAME", "flight.takeoff.frame")]
Landing = Annotated[str | None, key_option("FRAME", "flight.landing.frame")]
Duration = Annotated[float | None, key_option("S", "flight.duration")]
Contacts = Annotated[
    str | None, key_option("A,B;A", "jump.takeoff.contacts", more="The phases are those until takeoff.")
]
LandingContacts = Annotated[
    str | None,
    key_option(
        "A;A,B",
        "jump.landing.contacts",
        more="The phases are those after landing.",
        left_out="those until takeoff in reverse, front for rear",
    ),
]
Posture = Annotated[
    str | None,
    key_option("J=A,..", "jump.takeoff.from", more="Typed by joint; those left out are chosen.", left_out=""),
]


def robots(json_output: common.Json = False) -> None:
    """List the robots at hand: what to type, and the joints that turn in the plane."""
    from floatplan.robot.urdf.tree import PREFIX, example_urdfs

    with progress("reading"):
        above = common.folder()
        own = [] if above is None else sorted(f"urdf/{path.name}" for path in above.glob("urdf/*.*"))
        sources = own + [PREFIX + name for name in example_urdfs()]
        usable: list[dict[str, Any]] = []
        unusable: list[dict[str, Any]] = []
        for source in sources:
            facts = _facts(source)
            (unusable if "reason" in facts else usable).append(facts)
    if json_output:
        common.print_json({"robots": usable, "unusable": unusable})
        return
    for line in _lines(usable, unusable):
        typer.echo(line)


def _facts(source: str) -> dict[str, Any]:
    """A robot in short, its legs coupled where it has pairs of them; or why it cannot be used as it is."""
    reason = ""
    for coupled in ("mirror", None):
        try:
            robot = fp.Robot.from_file(common.bundled(source), coupled=coupled)
        except InputError as error:
            reason = error.reason
        else:
            moving = {"joints": list(robot.joints), "coupled": coupled, "followers": list(robot.coupled)}
            return {"robot": source, "name": robot.name, "mass": robot.mass, "plane": robot.plane.name, **moving}
    return {"robot": source, "reason": reason}


def _lines(usable: list[dict[str, Any]], unusable: list[dict[str, Any]]) -> Iterator[str]:
    """A line for each robot; its name comes last and whole, ready to be copied."""
    from floatplan.robot.urdf.tree import robots_folder

    yield f"{'joints':<9}{'kg':>7}  plane  robot"
    for facts in usable:
        count = str(len(facts["joints"]))
        count += f" + {len(facts['followers'])}" if facts["followers"] else ""
        pairs = " --coupled mirror" if facts["coupled"] else ""
        yield f"{count:<9}{facts['mass']:>7.3g}  {facts['plane']:<5}  {facts['robot']}{pairs}"
    yield "Joints are those that turn in the plane + those that follow them; floatplan info ROBOT shows more."
    if unusable:
        yield f"{len(unusable)} more cannot be used as they are: --json has the reasons."
    if robots_folder() is None:
        yield f"More robots come with the extra robots; {install_advice('robots')}"


class InfoCommand(common.Command):
    """``--shapes`` lists, ``--shapes FILE.png`` draws."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give ``--shapes`` its value where the next word is none."""
        words: list[str] = []
        for index, word in enumerate(args):
            words.append(word)
            following = args[index + 1] if index + 1 < len(args) else LISTED
            if word == "--shapes" and (
                following.startswith("-") or Path(following).suffix.lower() in (".urdf", ".xml", ".toml")
            ):
                words.append(LISTED)
        return super().parse_args(ctx, words)


def info(
    source: Annotated[str, common.argument("ROBOT.urdf|FILE.toml", "A robot, a problem, a file with [robot] alone.")],
    choices: common.RobotOptions,
    degrees: common.Degrees = False,
    frames: Annotated[bool, flag("List the frames that may take off and land.", "--frames")] = False,
    shapes: Annotated[
        str | None, option("[FILE.png]", "List the links' capsules; or draw them over their geometry.")
    ] = None,
    json_output: common.Json = False,
) -> None:
    """Tell what a robot is: plane, joints, limits, inertia, shapes, and how far it leaves its plane."""
    from floatplan.cli.option_values import named_robot

    robot = named_robot(source, choices, degrees)
    facts = robot_facts(robot)
    if shapes is not None and shapes != LISTED:
        from floatplan.view.figures.robot_pictures import save_picture, shapes_picture

        save_picture(Path(shapes), "--shapes", shapes_picture, robot)
    listed = {"frames": frames, "shapes": shapes == LISTED}
    common.finish(facts, json_output, lambda summary: summary.facts_summary(facts, **listed))


def robot_facts(robot: fp.Robot) -> dict[str, Any]:
    """Return a robot's properties; lists in the order of ``joints``, ``None`` for no limit.

    In a plane also what it is there; the extremes of D are those over the joint ranges of its file, [-pi, pi] where it
    gives none.
    """
    from floatplan.arguments import attributes
    from floatplan.robot.wheels import explain_wheels

    facts: dict[str, Any] = {
        **attributes(
            robot,
            (  # as they are
                *("name", "joints", "mass", "position_limits", "velocity_limits", "torque_limits"),
                *("motors", "motor_torque_limits", "motor_velocity_limits", "tilt"),
            ),
        ),
        "locked": dict(robot.locked),
        "armature": dict(robot.armature),
        "damping": dict(robot.damping),
        "friction": dict(robot.friction),
        "rotor_file": None if robot.rotor_file is None else str(robot.rotor_file),
        "balance_inertias": robot.balance_inertias,
        "payload": list(map(asdict, robot.payload)),
        "coupled": {follower: asdict(coupling) for follower, coupling in robot.coupled.items()},
        **(_facts_in_plane(robot) if robot.in_plane else {"base": robot.base, "frames": sorted(robot.frame_names)}),
        "wheels": explain_wheels(robot),
    }
    facts["warnings"] = [*robot.warnings, *facts.get("warnings", [])]
    shown: dict[str, Any] = json_value(facts)
    return shown


def _facts_in_plane(robot: fp.Robot) -> dict[str, Any]:
    from floatplan.arguments import attributes
    from floatplan.problem.resolution import position_limits
    from floatplan.robot.leak import explain_leak, out_of_plane_leak
    from floatplan.robot.planar.inertia import inertia_extremes

    low, high = inertia_extremes(robot.tree, position_limits(robot, fp.Limits()))
    leak = out_of_plane_leak(robot)
    shapes = []
    for shape in robot.shapes:
        length = abs(shape.end - shape.start)
        shapes.append({"link": shape.link, "length": length, "radius": shape.radius})
    return {
        "plane": attributes(robot.plane, ("name", "horizontal", "vertical", "normal")),
        "D_min": low,
        "D_max": high,
        "frames": sorted(robot.frames),
        "shapes": shapes,
        "out_of_plane_leak": leak,
        "warnings": [*filter(None, [explain_leak(robot, leak)])],
    }


def init(
    robot: common.RobotSource,
    choices: common.RobotOptions,
    takeoff: Takeoff = None,
    landing: Landing = None,
    turns: Annotated[
        # more is taken for degrees
        int | None, typer.Option(min=0, max=2, metavar="N", help="Whole turns, forwards; 0: a jump without.")
    ] = None,
    backwards: Annotated[bool, flag("Rotate backwards: once, unless --turns says more.", "--backwards")] = False,
    duration: Duration = None,
    contacts: Contacts = None,
    landing_contacts: LandingContacts = None,
    posture: Posture = None,
    stunt: Annotated[
        str | None,
        option("NAME", "A jump in space, such as roll or side; a wrong name lists them all."),
    ] = None,
    degrees: common.Degrees = False,
    output: Annotated[Path | None, option("FILE.toml", "Left out, <robot>.toml here.", "--output", "-o")] = None,
    force: Annotated[bool, flag("Overwrite the file.", "--force")] = False,
    seed: Annotated[int, count_option("seed", "Of the postures tried.")] = 0,
    quiet: common.Quiet = False,
) -> None:
    """Write a problem file for a robot: a jump with a whole rotation, else without, from standing to standing.

    The file plans as it stands: floatplan jump FILE.toml finds the jump, floatplan plan FILE.toml proves its flight.
    What that does in addition to the request is a warning, here and in the file, which lists the choices: plane, joints
    with their ranges, couplings, feet, and the limits of the robot's file. Where the search has no jump, or CasADi is
    not installed, it is a rotation afloat, and the file says why.

    What is left open is chosen: one rotation, backwards where it takes off from the rear, or none. What is requested
    is fixed, or nothing is written: where the search has no such jump, the exit code is 1, and the message says
    what is in the way, and without which option there is one.

    With --stunt it is a jump in space of a robot whose feet are points; it is resolved, and planned by floatplan jump.
    """
    from floatplan.cli import option_values
    from floatplan.initial.flight import requested_flight
    from floatplan.initial.options import InitOptions
    from floatplan.initial.text import problem_file_text
    from floatplan.robot.chosen import blamed

    path = _new_problem_file(robot, output, force)
    robot_choices = option_values.robot_choices(choices, degrees)
    words = {name: _typed(name, value) for name, value in choices.items()}
    options = InitOptions(
        takeoff=takeoff,
        landing=landing,
        turns=turns,
        backwards=backwards,
        duration=duration,
        contacts=option_values.contacts("--contacts", contacts),
        landing_contacts=option_values.contacts("--landing-contacts", landing_contacts),
        posture=option_values.posture("--posture", posture, degrees),
        angles="deg" if degrees else "rad",
    )
    if stunt is not None:
        _write_stunt(robot, stunt, robot_choices, options, path, quiet)
        return
    with progress("init", quiet, tell=True) as bar, blamed(robot_choices, option_values.SOURCE, "--"):
        chosen, flight = requested_flight(
            robot, options, robot_choices, words, seed, lambda line: bar.say(escaped(line))
        )
    text = problem_file_text(chosen, flight, path)
    write_atomically(path, text)
    if not quiet:
        typer.echo(f"{path}: {text.splitlines()[0].removeprefix('# ')}", err=True)
        for warning in flight.warnings:
            typer.echo(f"warning: {warning}", err=True)
        for reason in flight.reasons:
            typer.echo(reason, err=True)
        typer.echo(f"next: floatplan {'plan' if flight.jump is None else 'jump'} {path}", err=True)


def _new_problem_file(robot: str, output: Path | None, force: bool) -> Path:
    """Where a problem file goes; refused where it may not."""
    from floatplan.cli.results import check_folder

    path = Path(f"{Path(robot).stem}.toml") if output is None else output
    if path.suffix != ".toml":
        raise InputError("a problem file ends in .toml", source=path, element="--output")
    if path.exists() and not force:
        raise InputError(
            "is there already", source=path, advice="give --force to overwrite it, or another name with -o"
        )
    check_folder(path.parent)
    return path


def _write_stunt(
    robot: str, stunt: str, robot_choices: Mapping[str, Any], options: InitOptions, path: Path, quiet: bool
) -> None:
    """Write the problem file of a jump in space; errors name the option."""
    from floatplan.cli.option_values import SOURCE
    from floatplan.initial.stunts import stunt_file_text
    from floatplan.robot.chosen import blamed

    if options.typed:
        name = next(iter(options.typed)).replace("_", "-")
        reason = "says what jumps in a plane do, and --stunt asks for one in space"
        raise InputError(reason, element=f"--{name}", advice="leave one of the two out")
    with blamed({**robot_choices, "stunt": stunt}, SOURCE, "--"):
        text = stunt_file_text(robot, stunt, robot_choices, path)
    write_atomically(path, text)
    if not quiet:
        typer.echo(f"{path}: {text.splitlines()[0].removeprefix('# ')}", err=True)
        typer.echo(f"next: floatplan jump {path}", err=True)


def _typed(name: str, value: str | bool) -> str:
    """An option of the robot as it was typed."""
    return common.typed_option(name) if value is True else f"{common.typed_option(name)} {value}"


def bounds(
    problem_file: common.ProblemFile,
    picture: Annotated[Path | None, option("FILE.png", "Draw what joint rates reach at takeoff and landing.")] = None,
    json_output: common.Json = False,
) -> None:
    """Tell which angular momentum suits a flight: of joints that keep their direction, and by their rates at both ends.

    For the former an interval and its midpoint; at takeoff and landing what joint rates within their limits make,
    where the frame on the ground does not move: intervals of angular momentum and velocity.
    """
    from floatplan.motion.flight import reachable_sets

    problem = fp.load_problem(problem_file)
    sets = reachable_sets(problem)
    facts = momentum_facts(problem, sets)
    if picture is not None:
        from floatplan.view.figures.robot_pictures import reachable_picture, save_picture

        save_picture(picture, "--picture", reachable_picture, sets)
    common.finish(facts, json_output, lambda summary: summary.momentum_summary(problem, facts))


def momentum_facts(problem: fp.Problem, sets: Mapping[str, Reachable]) -> dict[str, Any]:
    """Return (7)-(10): the extremes of D over the problem's joint ranges, the interval for h and its midpoint.

    Further what joint rates attain at each end: null where no frame stands there or nothing is attained, and ends of
    intervals null where they are not bounded.
    """
    from floatplan.motion.flight import End

    low, high = problem.inertia_extremes
    facts: dict[str, Any] = {
        "angular_momentum_bounds": problem.momentum_interval,
        "angular_momentum_midpoint": sum(problem.momentum_interval) / 2,
        "D_min": low,
        "D_max": high,
    }
    for end in get_args(End):
        for key in (
            "asked",
            "angular_momentum_bounds",
            "horizontal_velocity_bounds",
            "vertical_velocity_bounds",
            "polygon",
        ):
            facts[f"{end}_{key}"] = getattr(sets.get(end), key.removesuffix("_bounds"), None)
    written: dict[str, Any] = json_value(facts)
    return written


class File(StrEnum):
    """Files that have a schema."""

    PROBLEM = "problem"
    STUDY = "study"


def schema(
    file: Annotated[File, typer.Argument(help="Which file.")] = File.PROBLEM,
    output: Annotated[
        Path | None, option("FILE", "Write it there: floatplan.schema.json next to problems.", "--output", "-o")
    ] = None,
) -> None:
    """Print the JSON Schema (2020-12) of problem or study files, by which editors complete and check them."""
    from floatplan.problem.file import problem_schema
    from floatplan.studies.schema import study_schema

    made = {File.PROBLEM: problem_schema, File.STUDY: study_schema}[file]
    text = json.dumps(made(), indent=2, allow_nan=False)
    if output is None:
        typer.echo(text)
        return
    common.print_path(write_atomically(output, f"{text}\n"))
