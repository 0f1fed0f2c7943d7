"""Plans tampered with at random, and a judge that shares nothing with the proof: dense evaluation in floating point."""

import hashlib
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import proof_reference as reference
from places import URDF
from proof_plans import draw_coefficients, example_a, example_b, make_plan

from floatplan.arrays import read_only
from floatplan.plans.record import PlanRecord
from floatplan.robot.robot import Robot

ROOM = 5e-5  # [m] between obstacles and the motion
HAIR = 0.125  # share of changes that come as close to the tolerance as doubles can just tell
KINDS = (
    *("coefficient", "h", "duration", "torque", "velocity", "rate", "obstacle", "com", "mass", "goal", "claim"),
    "nothing",
)
GROUND = {"kind": "half-plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "margin": 0.0}


@dataclass(frozen=True)
class Case:
    """A tampered plan, its robot as the judge sees it, and what was done."""

    kind: str
    robot: Robot
    record: PlanRecord


def base_plans() -> list[PlanRecord]:
    """True plans with limits and obstacles close to what the motion needs: 0.01 % and 0.05 mm of room."""
    gymnast = Robot.from_urdf(URDF / "gymnast.urdf")
    rng = np.random.default_rng(5)
    sky = [
        {"kind": "circle", "center": [0.9, 2.4], "radius": 0.2},
        {"kind": "capsule", "start": [2.2, 0.0], "end": [2.2, 2.0], "radius": 0.1},
        {"kind": "circle", "center": [2.5, 1.2], "radius": 0.1, "velocity": [-0.4, 0.1], "window": [0.1, 0.8]},
    ]
    chain = Robot.from_urdf(URDF / "chain10.urdf", locked={f"q{k}": 0.1 * k for k in range(4, 9)})
    plans = [
        example_a(obstacles=sky, slack=1.0001, instants=20001),
        example_b(obstacles=[GROUND, {"kind": "circle", "center": [1.485, 3.342], "radius": 0.2}], grounded=True),
        make_plan(gymnast, draw_coefficients(rng, 2, 1.1, 0.15), frames=("foot", "hand"), obstacles=sky[:1]),
        make_plan(
            chain, draw_coefficients(rng, 5, 1.0, 0.15), duration=1.0, obstacles=sky[:2], slack=1.0001, instants=20001
        ),
    ]
    return [_tight_margins(plan) for plan in plans]


def _tight_margins(record: PlanRecord) -> PlanRecord:
    robot = load(record)
    dense = reference.evaluate(robot, record, np.linspace(0.0, record.duration, 8001))
    obstacles = []
    for obstacle in record.problem["obstacles"]:
        clear = reference.clearance(robot, record, dense, obstacle).min()
        room = ROOM if obstacle["kind"] != "half-plane" else 0.0
        assert clear > room - 1e-9, (obstacle, clear)
        obstacles.append(obstacle | {"margin": max(0.0, float(clear - room))})
    return replace(record, problem={**record.problem, "obstacles": obstacles})


def load(record: PlanRecord) -> Robot:
    return Robot.from_urdf(record.robot.file, plane=record.robot.plane, locked=record.robot.locked)


def mutate(rng: np.random.Generator, record: PlanRecord, folder: Path) -> Case:
    """One random change of a plan, its problem or its robot."""
    kind = str(rng.choice(KINDS))
    changed = globals()[f"_{kind}"](rng, record, folder)
    return Case(kind, load(changed), changed)


def _small(rng, low, high):
    """A change of random size; one in eight is a hair away from the tolerance of angles and places."""
    if low < -8 and rng.random() < HAIR:
        return float(rng.choice([-1.0, 1.0]) * 1e-8 * (1.0 + rng.uniform(-0.2, 0.2)))
    return float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(low, high))


def _nothing(rng, record, folder):
    return record


def _coefficient(rng, record, folder):
    b = np.array(record.coefficients)
    place = tuple(rng.integers(0, size) for size in b.shape)
    b[place] += _small(rng, -14, -2) * max(1.0, abs(b[place]))
    return replace(record, coefficients=read_only(b))


def _h(rng, record, folder):
    h = record.angular_momentum + _small(rng, -13, -2)
    flight = record.problem["flight"] | {"angular_momentum": "midpoint" if rng.random() < 0.5 else h}
    return replace(record, angular_momentum=h, problem=record.problem | {"flight": flight})


def _duration(rng, record, folder):
    flight = record.problem["flight"] | {"duration": record.duration * (1.0 + _small(rng, -14, -3))}
    return replace(record, problem=record.problem | {"flight": flight})


def _limit(kind, rng, record):
    limits = dict(record.problem["limits"])
    peaks = getattr(record, f"{kind}_peak")
    change = 3e-9 * rng.uniform(-1.0, 1.0) if rng.random() < HAIR else _small(rng, -5, -1)
    limits[kind] = (np.array(peaks) * (1.0 + change)).tolist()
    return replace(record, problem=record.problem | {"limits": limits})


def _torque(rng, record, folder):
    return _limit("torque", rng, record)


def _velocity(rng, record, folder):
    return _limit("velocity", rng, record)


def _rate(rng, record, folder):
    limits = dict(record.problem["limits"])
    limits["orientation_rate"] *= 1.0 + _small(rng, -3, -0.5)
    return replace(record, problem=record.problem | {"limits": limits})


def _obstacle(rng, record, folder):
    obstacles = [dict(obstacle) for obstacle in record.problem["obstacles"]]
    index = int(rng.integers(len(obstacles)))
    if rng.random() < HAIR:
        room = ROOM if obstacles[index]["kind"] != "half-plane" else 0.0
        margin = obstacles[index]["margin"] + room + 4e-8 * rng.uniform(-1.0, 1.0)
        obstacles[index]["margin"] = max(0.0, margin)
        return replace(record, problem={**record.problem, "obstacles": obstacles})
    shift = 10.0 ** rng.uniform(-4, -2) * np.exp(2j * np.pi * rng.random())
    for key in ("center", "point", "start", "end"):
        if key in obstacles[index]:
            x, y = obstacles[index][key]
            obstacles[index][key] = [x + shift.real, y + shift.imag]
    return replace(record, problem={**record.problem, "obstacles": obstacles})


def _com(rng, record, folder):
    com = {key: list(value) if key != "gravity" else value for key, value in record.com.items()}
    com[str(rng.choice(["position0", "velocity0"]))][int(rng.integers(2))] += _small(rng, -13, -2)
    problem = record.problem
    if rng.random() < 0.5:
        problem = problem | {"flight": problem["flight"] | {"horizontal_velocity": com["velocity0"][0]}}
    return replace(record, com=com, problem=problem)


def _mass(rng, record, folder):
    text = Path(record.robot.file).read_text()
    masses = list(re.finditer(r'<mass value="([^"]+)"/>', text))
    chosen = masses[int(rng.integers(len(masses)))]
    value = float(chosen.group(1)) * (1.0 + _small(rng, -13, -2))
    changed = f'{text[: chosen.start()]}<mass value="{value!r}"/>{text[chosen.end() :]}'
    path = folder / f"{hashlib.sha256(changed.encode()).hexdigest()[:16]}.urdf"
    path.write_text(changed)
    robot = replace(record.robot, urdf=str(path), sha256=hashlib.sha256(changed.encode()).hexdigest())
    return replace(record, robot=robot)


def _goal(rng, record, folder):
    goal = dict(record.problem["goal"])
    change = _small(rng, -12, -2)
    if rng.random() < 0.5:
        goal["orientation"] += change
        orientation = record.orientation | {"goal": goal["orientation"]}
        return replace(record, orientation=orientation, problem=record.problem | {"goal": goal})
    key = str(rng.choice(["positions", "velocities", "accelerations"]))
    goal[key] = [goal[key][0] + change, *goal[key][1:]]
    return replace(record, problem=record.problem | {"goal": goal})


def _claim(rng, record, folder):
    change = 1.0 + _small(rng, -6, -1)
    key = str(rng.choice(["torque_peak", "velocity_peak", "clearance_min", "orientation"]))
    if key == "orientation":
        value = record.orientation | {"end": record.orientation["end"] + _small(rng, -12, -3)}
    elif key == "clearance_min":
        value = record.clearance_min + _small(rng, -6, -2)
    else:
        value = read_only(getattr(record, key) * change)
    return replace(record, **{key: value})
