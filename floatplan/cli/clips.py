"""The commands that take recorded motions: ``clip check`` judges their flights, ``clip repair`` makes them fly.

``bench`` has robots follow them, and jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, cast

import typer

import floatplan as fp
from floatplan.cli import ExitCode, common
from floatplan.cli.common import flag, option
from floatplan.cli.progress import progress
from floatplan.errors import InputError
from floatplan.tables import CHOICES, HIGHEST_DEGREE, LOWEST_DEGREE, StanceMethod

if TYPE_CHECKING:
    from floatplan.clips.repaired_flight import Choice

MOST_CLIPS = 10_000  # [-] of one command

Files = Annotated[list[Path], typer.Argument(metavar="CLIP|DIR..", help="Recorded motions, or folders of them.")]
Model = Annotated[str, option("FILE", "URDF or MJCF of the robot that moves.")]
Format = Annotated[
    str | None, option("NAME", "Of the file; detected by its name and its keys if left out.", "--format")
]
Quaternion = Annotated[
    str | None, common.choice_option("quaternion", "Of a CSV: ", "; detected by the feet if left out", "ORDER")
]
Fps = Annotated[float | None, option("HZ", "Frames a second of a file that does not say it; 30 if left out.")]
Feet = Annotated[str | None, option("LINKS", "The feet's links, with commas; detected by their shapes if left out.")]
Report = Annotated[bool, flag("Write runs/<name>/report.html too: curves and faults, flight by flight.")]
Ground = Annotated[float | None, option("Z", "Height of a level ground, m; estimated from the feet if left out.")]


def clip_check(
    files: Files,
    model: Model,
    form: Format = None,
    quaternion: Quaternion = None,
    fps: Fps = None,
    feet: Feet = None,
    ground: Ground = None,
    report: Report = False,
    json_output: common.Json = False,
) -> None:
    """Judge the flights of recorded motions: does the centre of mass fall at g, does one momentum turn the base?

    Each flight is physical, unphysical, undecided (too few frames), or afloat (something carries the robot). Of several
    files, or a folder, one table, the worst first. Exit code 1 where a flight is unphysical.
    """
    robot = fp.Robot.from_file(model, base="free-flyer")
    paths = _clip_files(files)
    page = _page(paths) if report else None
    checks: list[fp.ClipCheck] = []
    with progress("checking") as bar:
        for number, path in enumerate(paths):
            if len(paths) > 1:
                bar.say(f"{path.name}, {number + 1} of {len(paths)}")
            clip = fp.load_clip(
                path, model=robot, format=form, fps=fps, quaternion=quaternion, feet=_names(feet), ground=ground
            )
            checks.append(fp.check_clip(clip))
    checks.sort(key=lambda check: -check.unphysical_share)
    if page is not None:
        from floatplan.clips.page import write_page

        write_page(checks, page)
    ok = all(check.ok for check in checks)
    if len(checks) == 1:
        common.finish(checks[0].to_dict(), json_output, lambda summary: summary.clip_summary(checks[0], page), ok)
    facts = {"model": model, "clips": [check.to_dict() for check in checks]}
    common.finish(facts, json_output, lambda summary: summary.clips_summary(checks, page), ok)


def clip_repair(
    file: Annotated[Path, typer.Argument(metavar="CLIP", help="A recorded motion.")],
    model: Model,
    choice: Annotated[
        str, common.choice_option("repair", more="; or from 0, the first, to 1, the second", metavar="NAME|SHARE")
    ] = "auto",
    flights: Annotated[
        str | None, option("N,..", "Flights to repair, from 0; the unphysical ones if left out.")
    ] = None,
    degree: Annotated[
        int | None,
        option("K", "Of the polynomials; by the duration if left out.", min=LOWEST_DEGREE + 1, max=HIGHEST_DEGREE),
    ] = None,
    stances: Annotated[str, common.choice_option("stances")] = "bent",
    report: Annotated[bool, flag("Write runs/<name>_repaired/report.html too: it plays both side by side.")] = False,
    rate: Annotated[float | None, option("HZ", "Frames a second of the output; the clip's own if left out.")] = None,
    problem: Annotated[int | None, option("N", "Write flight N as a problem file instead, and its reference.")] = None,
    form: Format = None,
    quaternion: Quaternion = None,
    fps: Fps = None,
    feet: Feet = None,
    ground: Ground = None,
    output: Annotated[Path | None, option("FILE", "The file; next to the clip if left out.", "--output", "-o")] = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
) -> None:
    """Make the flights of a recorded motion fly, as near to it as they can, and write it in its own format.

    "retime" keeps postures and heights, so that a flight takes as long as its fall; "raise" keeps its duration, and the
    robot rises higher. Flights that are physical are left as they are; a clip without others is written as it is. Exit
    code 1 where a flight is not repairable, or one of the result is unphysical, and the reason is printed.
    """
    from floatplan.arguments import one_of
    from floatplan.clips.formats import LARGEST_CLIP
    from floatplan.clips.writing import write_clip
    from floatplan.files import read_regular, write_atomically

    robot = fp.Robot.from_file(model, base="free-flyer")
    clip = fp.load_clip(
        file, model=robot, format=form, fps=fps, quaternion=quaternion, feet=_names(feet), ground=ground
    )
    if problem is not None:
        _write_problem(clip, problem, choice, degree, output)
    way = cast("StanceMethod", one_of(*CHOICES["stances"])(stances, "--stances"))
    if way == "planned":
        common.needs_casadi("--stances")
    with progress("repairing", quiet):
        repaired, repair = fp.repair_clip(
            clip, _choice(choice), flights=_numbers(flights), degree=degree, rate=rate, stances=way
        )
    target = output or file.with_name(f"{file.stem}_repaired{file.suffix}")
    shown = _page([target]) if report else None
    if repaired is not clip:
        write_clip(repaired, target)
    else:
        write_atomically(target, read_regular(file, LARGEST_CLIP, "a recorded motion"))
    if shown is not None:
        from floatplan.clips.repair_page import write_repair_page

        write_repair_page(repaired, repair, shown)
    facts = {**repair.to_dict(), "output": str(target)}
    common.finish(
        facts,
        json_output,
        lambda summary: summary.repair_summary(repair, target, shown),
        repair.ok,
        summary_shown=not quiet and not json_output,
    )


def bench(
    files: Annotated[list[Path], typer.Argument(metavar="JUMP.json|CLIP..", help="Jumps, and recorded motions.")],
    model: Annotated[str | None, option("FILE", "URDF or MJCF of the robot that the recorded motions are of.")] = None,
    flights: Annotated[int | None, option("N", "Of each motion; 50 if left out.", "--flights", "--runs", min=1)] = None,
    perturb: Annotated[
        str | None,
        option(
            "mass=5%,..",
            "What differs between the robots and the model, and what they measure; "
            "mass=5%,friction=20%,armature=0.005,noise=0.1deg,delay=4ms if left out.",
        ),
    ] = None,
    friction: Annotated[float | None, common.key_option("MU", "jump.friction", left_out="0.8")] = None,
    kp: Annotated[str | None, option("K|J=K,..", "Stiffness, N m/rad, of all joints or by name.")] = None,
    kd: Annotated[str | None, option("K|J=K,..", "Their damping, N m s/rad.")] = None,
    seed: Annotated[int, common.count_option("seed", "Of the robots and their noise.")] = 0,
    form: Format = None,
    quaternion: Quaternion = None,
    fps: Fps = None,
    feet: Feet = None,
    ground: Ground = None,
    json_output: common.Json = False,
    quiet: common.Quiet = False,
) -> None:
    """Let disturbed robots follow motions in MuJoCo with contact, by one fixed controller, and count who lands.

    Each motor gets the motion's torque, of recorded motions by inverse dynamics, and feedback of its joint. Of several
    files one table, the worst first. Exit code 1 where fewer than nine of ten robots land with a motion.
    """
    from floatplan.arguments import without_none
    from floatplan.cli.option_values import gain

    gains = gain("--kp", kp), gain("--kd", kd)
    recorded = [path for path in files if path.suffix.lower() != ".json"]
    if model is not None and not recorded:
        raise InputError("is for recorded motions: a jump has its own", element="--model", advice="leave it out")
    robot = None if model is None else fp.Robot.from_file(model, base="free-flyer")
    of_clips: dict[str, Any] = {"model": robot, "format": form, "fps": fps, "quaternion": quaternion}
    of_clips |= {"feet": _names(feet), "ground": ground}
    of_all: dict[str, Any] = without_none({"flights": flights, "seed": seed, "perturb": perturb, "friction": friction})
    results: list[fp.Bench] = []
    with progress("following", quiet) as bar:
        for path in files:
            bar.say(path.name)
            only_clips = of_clips if path in recorded else {}
            results.append(fp.bench(path, **of_all, gains=gains, **only_clips))
    results.sort(key=lambda result: (result.landed, result.clean))
    facts = {"motions": [result.to_dict() for result in results]}
    shown = not quiet and not json_output
    ok = all(result.ok for result in results)
    common.finish(facts, json_output, lambda summary: summary.bench_summary(results), ok, summary_shown=shown)


def _write_problem(clip: fp.Clip, number: int, choice: str, degree: int | None, output: Path | None) -> NoReturn:
    """Write one flight as a problem file, with the recorded motion that it is to be near inside it."""
    from floatplan.clips.judge import judge_flight
    from floatplan.clips.repaired_flight import (  # here: it loads the planner
        SHORTEST,
        flight_problem,
        repaired_duration,
    )

    if not 0 <= number < len(clip.flights):
        numbers = f"they are 0 to {len(clip.flights) - 1}" if clip.flights else "the clip has none"
        reason = f"there is no flight {number}: {numbers}"
        raise InputError(reason, element="--problem")
    requested = _choice(choice)
    judged = judge_flight(clip, clip.flights[number])
    duration = repaired_duration(clip, judged, "retime" if requested == "auto" else requested)
    if duration < SHORTEST:
        raise InputError(
            "the centre of mass does not rise in this flight", element="--problem", advice="give --choice raise"
        )
    target = output or clip.path.with_name(f"{clip.path.stem}_flight{number}.toml")
    common.print_path(fp.save_problem(flight_problem(clip, judged.flight, duration, degree), target))
    raise typer.Exit(ExitCode.DONE)


def _choice(word: str) -> Choice:
    """One of the ways in which a flight is repaired, or a number between two of them."""
    from floatplan.clips.repaired_flight import CHOICE

    try:
        value: str | float = float(word)
    except ValueError:
        value = word
    return cast("Choice", CHOICE(value, "--choice"))


def _numbers(words: str | None) -> tuple[int, ...] | None:
    if words is None:
        return None
    try:
        return tuple(map(int, words.split(",")))
    except ValueError:
        raise InputError(f"{words!r} are not numbers of flights", element="--flights", advice="such as 0,3") from None


def _clip_files(files: Sequence[Path]) -> list[Path]:
    """The files themselves, and those in folders, in the order of their names."""
    from floatplan.clips.formats import CONTENTS

    clips: list[Path] = []
    for path in files:
        if path.is_dir():
            inside = sorted(file for file in path.iterdir() if file.suffix.lower() in CONTENTS)
            if not inside:
                raise InputError("holds no recorded motion", source=path, advice=f"these end in {', '.join(CONTENTS)}")
            clips += inside
        else:
            clips.append(path)
    if len(clips) > MOST_CLIPS:
        raise InputError(f"are {len(clips)} files, more than {MOST_CLIPS}", element="files", advice="give fewer")
    return clips


def _page(paths: Sequence[Path]) -> Path:
    """Where the page goes: into the folder of the clip's name, of several into that of all clips."""
    from floatplan.cli.results import ResultFile, check_folder

    folder = Path("runs") / (paths[0].stem if len(paths) == 1 else "clips")
    check_folder(folder)
    return folder / ResultFile.REPORT


def _names(words: str | None) -> tuple[str, ...] | None:
    return None if words is None else tuple(word.strip() for word in words.split(",") if word.strip())
