"""A sceptic's plan files: each field that could make a false "proved", changed by itself."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import URDF
from proof_plans import draw_coefficients, example_b, make_plan
from proof_records import certify_record

from floatplan.arrays import read_only
from floatplan.robot.robot import Coupling, Robot

GROUND = {"kind": "half-plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "margin": 0.0}
CIRCLE = {"kind": "circle", "center": [1.485, 3.342], "radius": 0.2, "margin": 0.0}


@pytest.fixture(scope="module")
def honest():
    record = example_b(obstacles=[GROUND, CIRCLE], grounded=True)
    assert certify_record(record).proved
    return record


def changed(record, table, **values):
    """The record with values of a table of its problem replaced."""
    problem = dict(record.problem)
    where = problem
    *path, last = table.split(".")
    for name in path:
        where[name] = dict(where[name])
        where = where[name]
    where[last] = {**where[last], **values}
    return replace(record, problem=problem)


def with_robot(record, **values):
    return replace(record, robot=replace(record.robot, **values))


def with_urdf(record, folder, old, new):
    text = Path(record.robot.urdf).read_text()
    assert old in text
    path = folder / "changed.urdf"
    path.write_text(text.replace(old, new, 1))
    return with_robot(record, urdf=str(path), sha256=hashlib.sha256(path.read_bytes()).hexdigest())


def swapped(record, name):
    return replace(record, **{name: read_only(getattr(record, name)[::-1])})


REFUTED = {
    "goal in one place only": lambda r: replace(r, orientation=r.orientation | {"goal": r.orientation["goal"] + 1e-6}),
    "another goal, twice": lambda r: replace(
        changed(r, "goal", orientation=r.orientation["goal"] + 2.0 * np.pi),
        orientation=r.orientation | {"goal": r.orientation["goal"] + 2.0 * np.pi},
    ),
    "another start": lambda r: changed(r, "start", orientation=r.orientation["start"] + 1e-9),
    "goal positions": lambda r: changed(r, "goal", positions=[1e-7, 0.0]),
    "start accelerations": lambda r: changed(r, "start", accelerations=[0.0, 1e-4]),
    "landing height": lambda r: changed(r, "flight.landing", height=1e-6),
    "landing frame": lambda r: changed(r, "flight.landing", frame="foot"),
    "takeoff frame": lambda r: changed(r, "flight.takeoff", frame="hand"),
    "takeoff position": lambda r: changed(r, "flight.takeoff", position=[0.0, 1e-6]),
    "gravity asked": lambda r: changed(r, "flight", gravity=9.8),
    "gravity flown": lambda r: replace(r, com=r.com | {"gravity": 9.8}),
    "no gravity, twice": lambda r: replace(changed(r, "flight", gravity=0.0), com=r.com | {"gravity": 0.0}),
    "momentum asked": lambda r: changed(r, "flight", angular_momentum=r.angular_momentum + 1e-9),
    "centre": lambda r: replace(r, centre=read_only([1e-6, 0.0])),
    "amplitude": lambda r: replace(r, amplitude=read_only([np.pi, np.pi + 1e-6])),
    "amplitude beyond the range": lambda r: changed(r, "limits", position=[[-0.1, 0.1], [-np.pi, np.pi]]),
    "range upside down": lambda r: changed(r, "limits", position=[[np.pi, -np.pi], [-np.pi, np.pi]]),
    "joints swapped": lambda r: with_robot(r, joints=r.robot.joints[::-1]),
    "coefficients swapped": lambda r: swapped(r, "coefficients"),
    "negative limit": lambda r: changed(r, "limits", torque=[-1e3, 1e3]),
    "no velocity allowed": lambda r: changed(r, "limits", velocity=[0.0, None]),
    "plane turned": lambda r: with_robot(r, plane=r.robot.plane[::-1]),
    "claimed end": lambda r: replace(r, orientation=r.orientation | {"end": r.orientation["end"] + 1e-7}),
    "claimed torque": lambda r: replace(r, torque_peak=read_only(0.9 * r.torque_peak)),
    "obstacle's margin": lambda r: replace(r, problem=r.problem | {"obstacles": [GROUND, CIRCLE | {"margin": 9.0}]}),
    "ground turned over": lambda r: replace(
        r, problem=r.problem | {"obstacles": [GROUND | {"normal": [0, -1]}, CIRCLE]}
    ),
}


@pytest.mark.parametrize("name", REFUTED)
def test_is_refuted(honest, name):
    assert certify_record(REFUTED[name](honest)).verdict == "refuted"


@pytest.mark.parametrize("value", ["2.50001", "2.49999"])
def test_another_mass_with_its_hash(honest, tmp_path, value):
    assert certify_record(with_urdf(honest, tmp_path, 'mass value="2.5"', f'mass value="{value}"')).verdict == "refuted"


@pytest.fixture(scope="module")
def coupled():
    robot = Robot.from_urdf(
        URDF / "chain10.urdf",
        coupled={"q5": Coupling("q1", -0.7, 0.2)},
        locked={f"q{k}": 0.1 * k for k in (3, 4, 6, 7, 8, 9)},
    )
    record = make_plan(robot, draw_coefficients(np.random.default_rng(8), len(robot.joints), 0.9, 0.3), duration=0.9)
    assert certify_record(record).proved
    return record


@pytest.mark.parametrize("change", [{"ratio": -0.70001}, {"offset": 0.20001}, {"ratio": 0.7}, {"leader": "q2"}])
def test_another_coupling_is_refuted(coupled, change):
    table = {"q5": {**coupled.robot.coupled["q5"], **change}}
    assert certify_record(with_robot(coupled, coupled=table)).verdict == "refuted"
