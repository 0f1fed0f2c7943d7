"""What each key of a problem file means, for its JSON Schema and for the reference; a test holds both to the tables."""

from __future__ import annotations

from dataclasses import dataclass

from floatplan.tables import LIMIT_TABLE, OBJECTIVE_TABLE, LimitRow

ANGLE = "rad or deg"
RATE = "rad/s or deg/s"
ACCELERATION = "rad/s^2 or deg/s^2"


@dataclass(frozen=True)
class Key:
    """A key: what it says, and its unit; empty where it has none. Angles are in the file's unit."""

    meaning: str
    unit: str = ""


TABLES: dict[str, str] = {
    "": "The whole file",
    "robot": "The robot: its URDF, and the choices that it leaves open",
    "robot.coupled.*": "How a joint follows another",
    "start": "Takeoff",
    "goal": "Landing",
    "flight": "The flight",
    "flight.takeoff": "What leaves the ground",
    "flight.landing": "What lands",
    "motion": "How joints may move, and what is best",
    "limits": "What motors and joints can do, at all times",
    "limits.motor.*": "A motor's torque falls with its rate: at most `stall - slope |rate|`",
    "obstacles[]": "What to keep clear of",
    "obstacles[circle]": "A disc",
    "obstacles[half-plane]": "Ground or a wall, solid on one side of a line",
    "obstacles[capsule]": "A bar with round ends",
    "self_clearance[]": "Two links to keep apart",
}

_OBJECTIVES = "; ".join(f"`{name}`: {row.description} ({row.unit})" for name, row in OBJECTIVE_TABLE.items())
_POSTURE = {
    "orientation": Key("Absolute angle of the base link; a full turn more is one somersault more", ANGLE),
    "positions": Key("Of the joints: by name, a list in joint order, or one number for all", ANGLE),
    "velocities": Key(
        "Rates of the joints, written as positions are; 'takeoff' at the start, 'landing' at the goal: the frame rests",
        RATE,
    ),
    "accelerations": Key("Of the joints, written as positions are; or 'free'", ACCELERATION),
}
_OBSTACLE = {
    "kind": Key("Which kind of obstacle"),
    "margin": Key("Distance to keep from it", "m"),
    "velocity": Key("Of one that moves: horizontal, vertical; it is where it is written at takeoff", "m/s"),
    "window": Key("When it exists: from, to, since takeoff; always, where left out", "s"),
}


def _limit(row: LimitRow) -> Key:
    words = '"none", "urdf"' if row.in_urdf else '"none"'
    unit = f"{row.unit} or {row.unit.replace('rad', 'deg')}" if row.unit.startswith("rad") else row.unit
    return Key(f"{row.description}: {words}, a number, or by {row.of.removesuffix('s')}", unit)


KEYS: dict[str, dict[str, Key]] = {
    "": {
        "name": Key("Of the problem, and of the folder of its results; the file's name where left out"),
        "angles": Key("Unit of all angles and rates in this file"),
        "ground": Key("Whether the robot stays above the line that it takes off from"),
    },
    "robot": {
        "urdf": Key("Path from this file's folder, or `example-robot-data:` and a path in that package"),
        "plane": Key('Horizontal and vertical axis, such as "xz"; found from the joints where left out'),
        "joints": Key("Joints to plan, in the order of all lists; all that turn about the plane's normal if left out"),
        "coupled": Key('Joints that follow others: a leader\'s name (with a minus, mirrored), a table, or "mirror"'),
        "locked": Key("Joints that stay where they are, by name", f"{ANGLE}, m of those that slide"),
        "reference": Key("Posture of an SRDF file beside the URDF, where joints that are not planned are locked"),
    },
    "robot.coupled.*": {
        "leader": Key("The planned joint that it follows"),
        "ratio": Key("Its position over the leader's"),
        "offset": Key("Its position where the leader's is zero", ANGLE),
    },
    "start": _POSTURE,
    "goal": _POSTURE,
    "flight": {
        "duration": Key("From takeoff to landing", "s"),
        "angular_momentum": Key(
            'About the centre of mass; "midpoint" of what monotonic joints need, or "free": found by the search',
            "kg m^2/s",
        ),
        "takeoff": Key("The frame that leaves the ground last; the base link at the origin where left out"),
        "landing": Key("The frame that lands first; the takeoff frame where left out"),
        "horizontal_velocity": Key("Of the centre of mass", "m/s"),
        "gravity": Key("Downwards", "m/s^2"),
    },
    "flight.takeoff": {
        "frame": Key("Name of a link or joint"),
        "position": Key("Where the frame is at takeoff: horizontal, vertical", "m"),
    },
    "flight.landing": {
        "frame": Key("Name of a link or joint"),
        "height": Key("Of the frame at landing; that of the ground, or of its takeoff, where left out", "m"),
    },
    "motion": {
        "degree": Key('Of the polynomials: one for all, one for each joint, or "auto": raised as needed'),
        "objective": Key(f"What is least. {_OBJECTIVES}"),
    },
    "limits": {
        "position": Key('Joint ranges: "urdf", "full" (one turn), or [low, high] by joint', ANGLE),
        **{row.key: _limit(row) for row in LIMIT_TABLE.values() if row.of != "base"},
        "motor": Key("Motors' curves, by joint"),
        "orientation_rate": Key(LIMIT_TABLE["orientation_rate"].description, RATE),
    },
    "limits.motor.*": {
        "stall": Key("Torque at rest", "N m"),
        "slope": Key("Torque that is lost with the rate", "N m s/rad"),
    },
    "obstacles[circle]": {
        **_OBSTACLE,
        "center": Key("Horizontal, vertical", "m"),
        "radius": Key("Of the disc", "m"),
    },
    "obstacles[half-plane]": {
        **_OBSTACLE,
        "point": Key("A place on the line: horizontal, vertical", "m"),
        "normal": Key("Direction away from what is solid: horizontal, vertical; of any length"),
    },
    "obstacles[capsule]": {
        **_OBSTACLE,
        "start": Key("One end of its middle line: horizontal, vertical", "m"),
        "end": Key("The other end", "m"),
        "radius": Key("Of the bar", "m"),
    },
    "self_clearance[]": {
        "links": Key("The two links"),
        "margin": Key("Distance to keep between them", "m"),
    },
}
