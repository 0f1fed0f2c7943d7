"""Makes the pack of motions/: problem files, motions at 50 Hz for learners, and the index with landings of the bench.

    .venv/bin/python scripts/make_motions.py                    # whatever is missing
    .venv/bin/python scripts/make_motions.py go2 backflip       # only motions whose names hold one of these words
    .venv/bin/python scripts/make_motions.py --bench            # and the bench of those that have no landings yet
    .venv/bin/python scripts/make_motions.py --again            # all anew
    .venv/bin/python scripts/make_motions.py --page             # docs/motions.md's table, and its picture

Everything is made of problem files: those of ``BASES`` name a robot, how it stands, which feet it stands on, and its
limits; a stunt says what it does in the plane. Motions in space are planned from ``problems/jumps/space``. Jumps stay
in build/motions, so that a run that was stopped goes on. A motion for which no jump is found, whose flight is not
proved, or whose links overlap is not in the pack; the end of the run names it, with the reason.
"""

from __future__ import annotations

import argparse
import csv
import fcntl
import io
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from gallery import table
from make_images import SHEET_DPI, rendered, save, sheet

import floatplan as fp
from floatplan.files import write_atomically
from floatplan.problem.file import problem_text
from floatplan.problem.jump import Durations, JumpFlight
from floatplan.view.figures.snapshots import moments
from floatplan.view.style import styled

ROOT = Path(__file__).resolve().parents[1]
PACK = ROOT / "motions"
FOUND = ROOT / "build" / "motions"
INDEX = PACK / "index.csv"
PAGE = ROOT / "docs" / "motions.md"
PICTURE = ROOT / "docs" / "images" / "motions.png"
SHOWN = ("go2_frontflip", "a1_two_backflips", "a1_jump_far_down", "go1_roll")
BASES = {  # robot -> file of one of its jumps
    "a1": "problems/jumps/a1.toml",
    "a2": "scripts/motions/a2.toml",
    "acrobat": "problems/jumps/acrobat.toml",
    "alexander": "scripts/motions/alexander.toml",
    "aliengo": "scripts/motions/aliengo.toml",
    "anymal_b": "problems/jumps/anymal.toml",
    "anymal_c": "scripts/motions/anymal_c.toml",
    "b1": "problems/jumps/b1.toml",
    "b1_z1": "scripts/motions/b1_z1.toml",
    "b2": "scripts/motions/b2.toml",
    "bolt": "problems/jumps/bolt.toml",
    "g1": "problems/jumps/g1.toml",
    "go1": "problems/jumps/go1.toml",
    "go2": "problems/jumps/go2.toml",
    "gymnast": "problems/jumps/gymnast.toml",
    "high_jumper": "problems/jumps/high_jumper.toml",
    "hyq": "problems/jumps/hyq.toml",
    "laikago": "scripts/motions/laikago.toml",
    "mini_cheetah": "scripts/motions/mini_cheetah.toml",
    "solo12": "problems/jumps/solo12.toml",
    "spot": "scripts/motions/spot.toml",
    "talos": "problems/jumps/talos_hop.toml",
}
COLUMNS = (
    *(
        "name",
        "robot",
        "stunt",
        "mass_kg",
        "duration_s",
        "flight_s",
        "height_m",
        "forward_m",
        "left_m",
        "torque_share",
        "rate_share",
    ),
    *("friction", "proof", "landed", "on_feet_alone", "flights", "attitude_deg"),
)


@dataclass(frozen=True)
class Stunt:
    """A jump in the plane.

    Attributes
    ----------
    turns : of the base, backwards positive
    rise : how high the centre of mass rises in flight, in heights where it stands; free where None
    order : which feet leave last, and so land first: "rear" and "front", "front" and "rear", or "all" at once
    flights : so many, of a sequence
    step : height of the ground on which it lands over that which it leaves, in heights of the centre of mass
    edge : where the higher ground ends, in heights of the centre of mass from the foremost feet in the direction of
        the jump, where it stands
    """

    turns: int
    rise: float | None
    order: str = "rear"
    flights: int = 1
    step: float = 0.0
    edge: float = 0.0


STUNTS = {
    "backflip": Stunt(1, None),
    "high_backflip": Stunt(1, 0.9),
    "frontflip": Stunt(-1, None, "front"),
    "high_frontflip": Stunt(-1, 0.9, "front"),
    "low_hop": Stunt(0, 0.2, "all"),
    "hop": Stunt(0, 0.4, "all"),
    "high_hop": Stunt(0, 0.65, "all"),
    "hop_off_front": Stunt(0, 0.35, "front"),  # over the front legs, and back to the rear ones
    "hop_off_rear": Stunt(0, 0.35, "rear"),
    "jump_down": Stunt(0, None, step=-0.6, edge=0.12),
    "jump_far_down": Stunt(0, None, step=-1.1, edge=0.12),
    "jump_up": Stunt(0, None, step=0.35, edge=0.45),
    "jump_far_up": Stunt(0, None, step=0.6, edge=0.45),
    "two_hops": Stunt(0, 0.3, "all", flights=2),
    "three_hops": Stunt(0, 0.2, "all", flights=3),
    "two_hops_off_rear": Stunt(0, 0.3, flights=2),
    "two_backflips": Stunt(1, None, flights=2),
    "two_frontflips": Stunt(-1, None, "front", flights=2),
}


def main() -> None:
    """Make what is missing, or what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", help="of the names of motions")
    parser.add_argument("--again", action="store_true", help="plan also what is there")
    parser.add_argument("--bench", action="store_true", help="let robots track those without landings")
    parser.add_argument("--only-bench", action="store_true", help="the same, and plan nothing")
    parser.add_argument("--starts", type=int, default=2, help="of each search")
    parser.add_argument("--page", action="store_true", help="write the table and the picture of the page alone")
    options = parser.parse_args()
    if options.page:
        write_page()
        return
    PACK.mkdir(exist_ok=True)
    failures = []
    for name, robot, stunt, problem in wanted(options.words):
        rows = read_index()
        if options.only_bench and name not in rows:
            continue
        if options.again or name not in rows:
            reason = made(name, robot, stunt, problem, options.starts, options.again)
            if reason:
                failures.append(f"{name}: {reason}")
                print(failures[-1], flush=True)
                continue
        if (options.bench or options.only_bench) and not read_index()[name]["landed"]:
            benched(name)
    print(f"{len(read_index())} motions of {len({row['robot'] for row in read_index().values()})} robots")
    for failure in failures:
        print(f"not in the pack: {failure}")


def wanted(words: Sequence[str]) -> Iterator[tuple[str, str, str, fp.Problem]]:
    """Yield name, robot, stunt and problem of the motions whose names hold one of these words."""

    def is_wanted(name: str) -> bool:
        return not words or any(word in name for word in words)

    for robot, base in BASES.items():
        problem = None
        for stunt, row in STUNTS.items():
            name = f"{robot}_{stunt}"
            if not is_wanted(name):
                continue
            problem = problem or fp.load_problem(ROOT / base)
            of_stunt = planar_problem(problem, name, row)
            if of_stunt is not None:
                yield name, robot, stunt, of_stunt
    for path in sorted((ROOT / "problems" / "jumps" / "space").glob("*.toml")):
        if is_wanted(path.stem):
            robot, _, stunt = path.stem.partition("_")
            yield path.stem, robot, stunt, replace(fp.load_problem(path), name=path.stem)


def planar_problem(base: fp.Problem, name: str, stunt: Stunt) -> fp.Problem | None:
    """Return the problem of a stunt of the robot of another jump; None where its feet do not do it.

    Feet that leave first and last are those of the other jump, or the other way about. The end of the flight, but for
    its turns, is a guess.
    """
    jump = base.jump
    assert jump is not None, "the file is of a jump"
    takeoff = jump.takeoff.contacts
    landing = jump.landing.contacts
    has_sides = takeoff is not None and len(takeoff) > 1
    assert isinstance(base.start.orientation, float), "it is in a plane"
    assert isinstance(base.goal.orientation, float), "it is in a plane"
    turned = round((base.goal.orientation - base.start.orientation) / (2.0 * math.pi) * base.robot.plane.turn)
    if stunt.turns and not turned:  # the file is of a jump without a turn, because none with one was found
        return None
    if base.takeoff_frame.body == 0:  # it stands on its base, whose orientation is found: the file's own jump alone
        is_own = stunt.turns == turned and (stunt.rise is None or name.endswith("_hop"))
        return replace(base, name=name) if is_own and not name.endswith(("high_hop", "low_hop")) else None
    if not has_sides and (stunt.step or (stunt.order == "front" and stunt.turns == 0)):
        return None
    frame = base.takeoff.frame
    if has_sides:
        assert takeoff is not None
        assert landing is not None
        if stunt.order == "front":
            takeoff, landing = (takeoff[0], landing[0]), (takeoff[1], landing[1])
            frame = takeoff[1][0]
        elif stunt.order == "all":
            takeoff, landing = (takeoff[0],), (landing[-1],)
    orientation = base.start.orientation + 2.0 * math.pi * stunt.turns * base.robot.plane.turn
    duration = base.flight.duration if stunt.rise is None else fall_time(base, stunt.rise)
    flight = replace(base.flight, duration=duration, takeoff=replace(base.takeoff, frame=frame), landing=None)
    same_feet = stunt.order == "rear"
    flights = None if stunt.flights == 1 else (JumpFlight(repeat=stunt.flights),)
    height, edge = step_of(base, stunt, frame)
    return replace(
        base,
        name=name,
        goal=replace(base.start, orientation=orientation),
        flight=flight,
        self_clearances=base.self_clearances if same_feet else (),
        jump=replace(
            jump,
            fixed=() if stunt.rise is None else ("duration",),
            takeoff=replace(jump.takeoff, contacts=takeoff, durations=None, height=-min(height, 0.0) or None),
            landing=replace(
                jump.landing,
                contacts=landing,
                durations=landing_durations(base, stunt),
                height=max(height, 0.0) or None,
            ),
            flights=flights,
            edge=edge,
        ),
    )


def landing_durations(base: fp.Problem, stunt: Stunt) -> Durations | None:
    """Bounds of the phases of a flip's landing, s: those of the base, if it has some, the first longer for a high one.

    The feet that land first take up the fall, longer the longer it lasts: of a Go2's high front flips 6 of 12 land on
    the bench with the 0.25 s of its backflip, 49 of 50 with 0.29 s.
    """
    assert base.jump is not None
    durations = base.jump.landing.durations
    if durations is None or not stunt.turns or stunt.rise is None:
        return durations if stunt.turns else None
    longer = fall_time(base, stunt.rise) / base.flight.duration
    first = [round(bound * longer, 3) for bound in durations[0]]
    return [first, *durations[1:]]


def fall_time(problem: fp.Problem, rise: float) -> float:
    """Duration, s, of a flight that rises so many heights of the centre of mass where the robot stands."""
    return round(math.sqrt(8.0 * rise * standing_height(problem) / problem.flight.gravity), 3)


def standing_height(problem: fp.Problem) -> float:
    """Height of the centre of mass over the lowest frame where the robot stands, m."""
    robot = problem.robot
    com = float(
        pin.centerOfMass(robot.model, robot.model.createData(), robot.configuration(problem.initial.positions))
        @ robot.up
    )
    lowest = min(float(placement.translation @ robot.up) for placement in frame_placements(problem))
    return com - lowest


def frame_placements(problem: fp.Problem) -> Sequence[pin.SE3]:
    """Where all frames of a robot are as it stands."""
    robot = problem.robot
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration(problem.initial.positions))
    return list(data.oMf)


def step_of(problem: fp.Problem, stunt: Stunt, frame: str) -> tuple[float, float | None]:
    """Height of a stunt's landing over its takeoff, m, and where the higher ground ends from a frame, m.

    It ends beyond the feet that stand foremost, in the direction of the jump: a backflip's is backwards.
    """
    if not stunt.step:
        return 0.0, None
    assert problem.jump is not None
    assert problem.jump.takeoff.contacts is not None
    height = standing_height(problem)
    placements = frame_placements(problem)
    model = problem.robot.model
    along = problem.robot.plane.horizontal
    forwards = -1.0 if stunt.turns > 0 else 1.0
    origin = placements[model.getFrameId(frame)].translation @ along
    feet = [placements[model.getFrameId(foot)].translation @ along for foot in problem.jump.takeoff.contacts[0]]
    foremost = max(forwards * (foot - origin) for foot in feet)
    edge = forwards * (foremost + stunt.edge * height)
    return round(stunt.step * height, 2), round(float(edge), 2)


def made(name: str, robot: str, stunt: str, problem: fp.Problem, starts: int, again: bool) -> str:
    """Plan a motion and put it into the pack; what keeps it out of it, or nothing."""
    begin = time.process_time()
    folder = FOUND / name
    folder.mkdir(parents=True, exist_ok=True)
    refused = folder / "refused.txt"
    if refused.exists() and not again:
        return refused.read_text(encoding="utf-8")
    reason = ""
    for _ in range(3):  # links that overlap are kept apart, which may bring others together
        jump, reason = planned(problem, folder, starts, again)
        pairs = overlapping(jump)
        if not pairs:
            break
        reason = f"{pairs[0].links[0]} and {pairs[0].links[1]} overlap"
        problem = replace(problem, self_clearances=(*problem.self_clearances, *pairs))
    if reason or jump is None or jump.flight is None:
        write_atomically(refused, reason)
        return reason
    fp.save_problem(problem, PACK / f"{name}.toml")
    write_atomically(PACK / f"{name}.npz", packed(jump))
    figures = jump.check.figures
    begin_place, end_place = jump.state([0.0, jump.duration]).com_position
    moved = end_place - begin_place
    row = {
        "name": name,
        "robot": robot,
        "stunt": stunt,
        "mass_kg": f"{jump.robot.mass:.3g}",
        "duration_s": f"{jump.duration:.3f}",
        "flight_s": f"{sum(flight.duration for flight in jump.flights):.3f}",
        "height_m": f"{jump.height:.3f}",
        "forward_m": f"{moved[0]:.2f}",
        "left_m": f"{moved[1]:.2f}" if len(moved) > 2 else "0.00",
        "torque_share": share(figures["torque"], "torque" in jump.check.unlimited),
        "rate_share": share(figures["velocity"], "velocity" in jump.check.unlimited),
        "friction": f"{figures['friction']:.2f}",
        "proof": "proved",
        **dict.fromkeys(("landed", "on_feet_alone", "flights", "attitude_deg"), ""),
    }
    write_row(row)
    print(f"{name}: {time.process_time() - begin:.1f} s", flush=True)
    return ""


def planned(problem: fp.Problem, folder: Path, starts: int, again: bool) -> tuple[fp.Jump | None, str]:
    """Return the jump of a problem, its flight proved, and what is wrong with it; that of a run before, if any."""
    cached = folder / "jump.json"
    path = folder / "problem.toml"
    text = problem_text(problem, path)
    if not again and cached.exists() and path.exists() and path.read_text(encoding="utf-8") == text:
        return fp.load_jump(cached), ""
    cached.unlink(missing_ok=True)
    write_atomically(path, text)
    try:
        jump = fp.jump(fp.load_problem(path), starts=starts, helps=False)
    except fp.FloatplanError as error:
        return None, str(error)
    if not jump.ok or jump.flight is None:
        return None, jump.explanation
    jump = jump.with_certificate(*map(fp.certify, jump.flights))
    jump.save(cached)
    return jump, "" if jump.proved else "its flight is not proved"


def overlapping(jump: fp.Jump | None) -> list[fp.SelfClearance]:
    """Return pairs of links that overlap in a jump, to be kept apart by a little."""
    pairs = []
    for warning in () if jump is None else jump.warnings:
        if warning.kind == "overlap":
            first, _, second = warning.subject.partition(" ")
            pairs.append(fp.SelfClearance((first, second), 0.005))
    return pairs


def share(value: float, unlimited: bool) -> str:
    """A share of limits; nothing where there are none."""
    return "" if unlimited else f"{value:.2f}"


def packed(jump: fp.Jump) -> bytes:
    """The motion for mjlab at 50 Hz, compressed, in single precision, as learners have it."""
    path = jump.export("mjlab-npz", FOUND / "mjlab.npz", 50.0)
    with np.load(path, allow_pickle=False) as content:
        arrays = {name: content[name] for name in content.files}
    for name, values in arrays.items():
        if values.dtype == np.float64:
            arrays[name] = values.astype(np.float32)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def jump_of(name: str) -> fp.Jump:
    """Return the jump of a motion of the pack: that of a run before, or planned again."""
    cached = FOUND / name / "jump.json"
    return fp.load_jump(cached) if cached.exists() else fp.jump(fp.load_problem(PACK / f"{name}.toml"))


def benched(name: str) -> None:
    """Let robots track a motion of the pack, and write down how many land."""
    result = fp.bench(jump_of(name))
    landings = {
        "name": name,
        "landed": str(result.landed),
        "on_feet_alone": str(result.clean),
        "flights": str(result.flights),
        "attitude_deg": f"{math.degrees(result.landings.pitch_rms):.1f}",
    }
    write_row(landings)
    print(f"{name}: {result.landed} of {result.flights} land, {result.clean} on their feet alone", flush=True)


def read_index() -> dict[str, dict[str, str]]:
    """Rows of the index by their names."""
    if not INDEX.exists():
        return {}
    with INDEX.open(newline="", encoding="utf-8") as file:
        return {row["name"]: dict(row) for row in csv.DictReader(file)}


def write_row(row: dict[str, str]) -> None:
    """Write cells of a row of the index; others of the same name stay. Two runs may write at once."""
    FOUND.mkdir(parents=True, exist_ok=True)
    with (FOUND / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        rows = read_index()
        rows[row["name"]] = rows.get(row["name"], {}) | row
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        for name in sorted(rows):
            writer.writerow(rows[name])
        write_atomically(INDEX, text.getvalue())


def write_page() -> None:
    """Write the table of the pack into its page, and draw moments of some motions for it."""
    heading = "## All motions\n"
    before, _, _ = PAGE.read_text(encoding="utf-8").partition(heading)
    titles = ["motion", "kg", "flight, s", "height, m", "forward, m", "torque", "rate", "landed", "on feet alone"]
    keys = ("name", "mass_kg", "flight_s", "height_m", "forward_m", "torque_share", "rate_share")
    cells = []
    for row in read_index().values():
        landings = [f"{row[key]} of {row['flights']}" if row[key] else "" for key in ("landed", "on_feet_alone")]
        cells.append([*(row[key] for key in keys), *landings])
    write_atomically(PAGE, f"{before}{heading}\n{table(titles, cells)}\n")
    strips = []
    for name in SHOWN:
        with styled():
            strips.append(rendered(moments(jump_of(name), flying=3, title=name), SHEET_DPI))
    save(sheet([strips]), PICTURE)


if __name__ == "__main__":
    main()
