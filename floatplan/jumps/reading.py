"""Jumps' files, read: of jumps in a plane and in space; errors name file and key."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arguments import flag, many, number, numbers, one_of, optional, text
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming, refuse, single
from floatplan.files import check_finite, read_json
from floatplan.jumps.contacts import GroundContact
from floatplan.jumps.jump import ARRAYS, FORMAT, Jump
from floatplan.jumps.jump_motion import NextFlight
from floatplan.jumps.motion import Grid, Stance
from floatplan.jumps.spatial.jump import ARRAYS_IN_SPACE, FORMAT_IN_SPACE, SpatialJump
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.stance import SpatialGrid, SpatialStance
from floatplan.jumps.spatial.standing import Foot
from floatplan.plans.plan import rebuild
from floatplan.plans.reading import LARGEST, check_size, record_from_dict, recorded_robot
from floatplan.plans.record import POINT, TRIPLE, KeyedTable, RobotRecord, table
from floatplan.pool import one_thread
from floatplan.problem.file import problem_from_dict
from floatplan.problem.jump import JumpRequest
from floatplan.robot import Robot
from floatplan.robot.shapes.solids import frame_position
from floatplan.robot.standing import SOLE_ENDS, TIP, Spot
from floatplan.tables import Range

UNKNOWN = "must not be there: a jump's file has no such key"
CONTACT = KeyedTable(
    {
        "frames": many(text, "names of frames"),
        "suffix": one_of("", *SOLE_ENDS, TIP),
        "places": many(POINT, "places"),
        "depth": number(Range(0.0, 10.0, "m")),  # of a foot's point: no robot's foot is larger
        "vertical": flag,
    },
    {"rolls": flag},
    UNKNOWN,
)
STANCE = KeyedTable(
    {
        "side": one_of("takeoff", "landing"),
        "contacts": many(CONTACT, "tables"),
        "place": POINT,
        **dict.fromkeys(ARRAYS, many(lambda value, _: value, "numbers")),
    },
    unknown=UNKNOWN,
)
FOOT = KeyedTable(
    {"frame": text, "depth": number(Range(0.0, 10.0, "m"))},
    {"suffix": one_of(*Foot.of_soles), "point": TRIPLE, "rolls": flag},
    UNKNOWN,
)
STANCE_IN_SPACE = KeyedTable(
    {
        "side": one_of("takeoff", "landing"),
        "contacts": many(FOOT, "tables"),
        "friction": number("friction"),
        "axes": one_of(*map("".join, itertools.permutations("xyz"))),
        **dict.fromkeys(ARRAYS_IN_SPACE, many(lambda value, _: value, "numbers")),
    },
    unknown=UNKNOWN,
)
NEXT_FLIGHT = KeyedTable(
    {"plan": table, "shift": POINT, "stances": many(STANCE, "tables")},
    unknown=UNKNOWN,
)
JUMP = KeyedTable(
    {
        "format": one_of(FORMAT, FORMAT_IN_SPACE),
        "status": text,
        "explanation": text,
        "robot": table,
        "problem": table,
        "flight": optional(table),
        "stances": many(table, "tables"),
    },
    {"flights": many(table, "tables")},
    unknown="",
)


@one_thread
def load_jump(path: str | Path, urdf: str | Path | None = None) -> Jump:
    """Read a jump's file and the URDF that it names, or the same URDF elsewhere.

    Raises
    ------
    InputError
        Either is missing, damaged, or does not belong to the other.
    """
    path = as_path(path, "path")
    content = read_json(path, kind="a jump file")
    with naming(path):
        if not isinstance(content, dict) or content.get("format") not in (FORMAT, FORMAT_IN_SPACE):
            raise InputError(f"is no jump file: its format is not {FORMAT!r}", element="format")
        check_finite(content)
    urdf_path = optional(as_path)(urdf, "urdf")
    with naming(path), _within():
        return _read(content, path, urdf_path)


def _read(content: Mapping[str, Any], path: Path, urdf: str | Path | None) -> Jump:
    is_spatial = content["format"] == FORMAT_IN_SPACE
    JUMP(content, "")
    many(STANCE_IN_SPACE if is_spatial else STANCE, "tables")(content["stances"], "stances")
    flight = None
    if content["flight"] is not None:
        with _within("flight"):
            flight = rebuild(record_from_dict(content["flight"]), path, urdf)
    record = RobotRecord.from_dict(content["robot"])
    robot = recorded_robot(record, path, urdf) if flight is None else flight.robot
    if robot.sha256 != record.sha256:
        advice = "take the jump's file as it was written, or plan it again"
        raise InputError("is not the robot of the flight", element="robot.sha256", advice=advice)
    if isinstance(content["problem"].get("jump"), dict):  # a file without this key requires nothing of it
        content["problem"]["jump"].setdefault("pitch_error", 0.0)
    with _within("problem"):
        problem = problem_from_dict(content["problem"], robot)
    request = problem.jump or JumpRequest()
    check_size(content["stances"], "stances", LARGEST)
    if is_spatial != (robot.base == "free-flyer"):
        raise InputError(f"does not fit the format {content['format']!r}", element="robot.base")
    sides: dict[str, list[Any]] = {"takeoff": [], "landing": []}
    read_stance = read_spatial_stance if is_spatial else _read_stance
    for index, table_of_stance in enumerate(content["stances"]):
        stance = read_stance(table_of_stance, robot, problem.flight.gravity, f"stances[{index}]")
        sides[table_of_stance["side"]].append(stance)
    more = _read_next_flights(content.get("flights", ()), path, urdf, robot, problem.flight.gravity)
    if more and (is_spatial or flight is None):
        raise InputError("are of a jump in a plane that has a first one", element="flights")
    jump = (SpatialJump if is_spatial else Jump)(
        problem,
        request,
        flight,
        before=tuple(sides["takeoff"]),
        after=tuple(sides["landing"]),
        more=more,
        status=content["status"],
        explanation=content["explanation"],
    )
    for contact in jump.contacts:
        if request.feet != "auto" and (contact.radius > 0) != (request.feet == "rolling"):
            raise InputError(f"do not fit problem.jump.feet, {request.feet!r}", element="stances")
    if (flight is None) == all(sides.values()):
        raise InputError("do not fit the flight", element="stances")
    return jump


def _read_next_flights(
    content: Sequence[Any], path: Path, urdf: str | Path | None, robot: Robot, gravity: float
) -> tuple[NextFlight, ...]:
    """Flights after the first, each with what follows it."""
    many(NEXT_FLIGHT, "tables")(content, "flights")
    check_size(content, "flights", LARGEST)
    next_flights = []
    for index, table_of_flight in enumerate(content):
        element = f"flights[{index}]"
        with _within(f"{element}.plan"):
            plan = rebuild(record_from_dict(table_of_flight["plan"]), path, urdf)
        if plan.robot.sha256 != robot.sha256:
            raise InputError("is not of the robot of the first flight", element=f"{element}.plan.robot.sha256")
        stances = []
        for count, table_of_stance in enumerate(table_of_flight["stances"]):
            stances.append(_read_stance(table_of_stance, robot, gravity, f"{element}.stances[{count}]"))
        if not stances:
            raise InputError("must follow the flight", element=f"{element}.stances")
        along, up = table_of_flight["shift"]
        next_flights.append(NextFlight(plan, (float(along), float(up)), tuple(stances)))
    return tuple(next_flights)


@contextmanager
def _within(element: str | None = None) -> Iterator[None]:
    """Name the table of a jump's file in which an error is, and advise, where nothing else is, to take a whole file."""
    try:
        yield
    except InputError as error:
        errors = []
        for one in single(error):
            inner = one.within(element=element)
            advice = inner.advice or "take the file as it was written, or plan the jump again"
            errors.append(InputError(inner.reason, source=inner.source, element=inner.element, advice=advice))
        refuse(errors)


def _read_stance(content: Mapping[str, Any], robot: Robot, gravity: float, element: str) -> Stance:
    contacts = []
    for index, table_of_contact in enumerate(content["contacts"]):
        contacts.append(_read_contact(table_of_contact, robot, f"{element}.contacts[{index}]"))
    if not contacts:
        raise InputError("must name what stands", element=f"{element}.contacts")
    times = _times(content, element)
    size = 1 + len(robot.joints)
    count = len(times)
    y, v, a = (_array(content[name], f"{element}.{name}", (size, count)) for name in ("y", "v", "a"))
    ratios = _array(content["ratios"], f"{element}.ratios", (len(contacts) - 1, count))
    grid = Grid(times, y, v, a, ratios)
    return Stance(robot, float(gravity), tuple(contacts), complex(*content["place"]), grid)


def read_spatial_stance(content: Mapping[str, Any], robot: Robot, gravity: float, element: str) -> SpatialStance:
    """Return what a file holds of a stance in space; InputError names what is wrong with it."""
    feet = []
    for index, table_of_foot in enumerate(content["contacts"]):
        frame = table_of_foot["frame"]
        if frame not in robot.frame_names:
            raise InputError(f"the robot has no frame {frame!r}", element=f"{element}.contacts[{index}].frame")
        body, local = frame_position(robot.model, robot.joint_tree, frame)
        suffix = table_of_foot.get("suffix", "")
        if bool(suffix) != ("point" in table_of_foot):
            reason = "names a point of a sole by suffix and point, or by neither"
            raise InputError(reason, element=f"{element}.contacts[{index}]")
        rolls = table_of_foot.get("rolls") is True
        if suffix:
            local = np.array(table_of_foot["point"])
            if rolls:
                raise InputError("a sole does not roll", element=f"{element}.contacts[{index}].rolls")
        x, y, z = local.tolist()
        depth = float(table_of_foot["depth"])
        feet.append(Foot(frame, body, (x, y, z), depth, suffix, radius=depth if rolls else 0.0))
    if len(feet) < 2:
        raise InputError("must name two feet at least", element=f"{element}.contacts")
    times = _times(content, element)
    shape = (BASE + len(robot.joints), len(times))
    y, v, a = (_array(content[name], f"{element}.{name}", shape) for name in ("y", "v", "a"))
    planned_forces = _array(content["shares"], f"{element}.shares", (3 * len(feet), len(times)))
    grid = SpatialGrid(times, y, v, a, planned_forces)
    friction = float(content["friction"])
    return SpatialStance(robot, float(gravity), content["axes"], tuple(feet), friction, grid)


def _times(content: Mapping[str, Any], element: str) -> Array:
    """Increasing instants of a stance."""
    times = _array(content["times"], f"{element}.times", (None,))
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise InputError("must be increasing instants", element=f"{element}.times")
    return times


def _read_contact(content: Mapping[str, Any], robot: Robot, element: str) -> GroundContact:
    frames = tuple(content["frames"])
    places = content["places"]
    if not frames or len(places) != len(frames):
        reason = f"has {len(frames)} frames and {len(places)} places, not as many of both"
        raise InputError(reason, element=element)
    radius = float(content["depth"]) if content.get("rolls") is True else 0.0
    spots = []
    for name, point in zip(frames, places, strict=True):
        if name not in robot.frames:
            raise InputError(f"the robot has no frame {name!r}", element=f"{element}.frames")
        spots.append(Spot(robot.frames[name].body, complex(*point), radius))
    return GroundContact(frames, content["suffix"], tuple(spots), float(content["depth"]), content["vertical"])


def _array(value: Any, element: str, shape: tuple[int | None, ...]) -> Array:
    """Finite numbers of a shape, in which None is any size; lists of no numbers have any other sizes."""
    array = numbers(value, element) if value != [] else np.zeros([size or 0 for size in shape])
    has_shape = len(array.shape) == len(shape)
    for own, size in zip(array.shape, shape, strict=False):
        if size is not None and own != size:
            has_shape = False
    if not has_shape:
        reason = f"has shape {array.shape}, not {shape}"
        raise InputError(reason, element=element)
    if not np.isfinite(array).all():
        raise InputError("must be finite numbers", element=element)
    return read_only(array.astype(np.float64))
