"""A jump's file that is spoiled in one place: its check says so, or reading refuses it."""

import json

import numpy as np
import pytest
from jumps import backflip
from long_cases import cases

from floatplan.errors import InputError
from floatplan.jumps.check import sentences_on
from floatplan.jumps.reading import load_jump

STANCES = range(4)


def arrays(change, name, *stances):
    def spoil(content):
        for index in stances:
            stance = content["stances"][index]
            stance[name] = change(np.array(stance[name])).tolist()

    return spoil


def contacts(change, *stances):
    return lambda content: [change(each) for index in stances for each in content["stances"][index]["contacts"]]


def in_problem(**changes):
    return lambda content: content["problem"].update(changes)


def circle(*center):
    return in_problem(obstacles=[{"kind": "circle", "center": center, "radius": 0.05}])


def weak_pairs(content):
    """Limits of the sum of left and right, which no single motor has."""
    del content["problem"]["limits"]["motor_torque"]
    content["problem"]["limits"]["torque"] = [20.0] * 4


def bend(values):
    """The front calves stretched in the middle of the stance, which the rows of their rates follow."""
    values[2] += 0.02 * np.sin(np.pi * np.linspace(0.0, 1.0, values.shape[1])) ** 2
    return values


SPOILED = {  # what is changed; the figure that shows it, or what reading says
    "forces scaled": (arrays(lambda ratios: 3 * ratios, "ratios", 0), "friction"),
    "forces shifted": (arrays(lambda ratios: ratios + 0.4, "ratios", 3), "slip"),
    "a phase shifted": (arrays(lambda times: times + 0.01, "times", 1), "gap"),
    "all phases shifted": (arrays(lambda times: times + 0.01, "times", *STANCES), "gap"),
    "a phase stretched": (arrays(lambda times: 1.1 * times, "times", 0), "torque"),
    "a phase left out": (lambda content: content["stances"].pop(0), "rest"),
    "a start in motion": (
        lambda content: content["problem"]["jump"]["takeoff"].update(com_velocity=[1.0, 0.0]),
        "begin",
    ),
    "phases swapped": (lambda content: content["stances"].insert(0, content["stances"].pop(1)), "junction"),
    "accelerations between nodes": (arrays(lambda a: 1.3 * a, "a", 1), "residual"),
    "a posture bent": (arrays(bend, "y", 1), "derivative"),
    "rates beyond the limit": (arrays(lambda v: 2 * v, "v", 1), "velocity"),
    "a place moved": (arrays(lambda place: place + np.array([0.01, 0.0]), "place", 1), "junction"),
    "places raised": (arrays(lambda place: place + np.array([0.0, 0.01]), "place", 0, 1), "level"),
    "feet moved": (contacts(lambda each: each.update(places=[[0.02, -0.213]] * 2), *STANCES), "residual"),
    "feet that hover": (contacts(lambda each: each.update(depth=each["depth"] + 0.05), *STANCES), "lifted"),
    "links in the ground": (contacts(lambda each: each.update(depth=each["depth"] - 0.02), *STANCES), "ground"),
    "the ground in steps": (contacts(lambda each: each.update(depth=each["depth"] + 3e-3), 0), "level"),
    "one foot of two": (
        contacts(lambda each: each.update(frames=each["frames"][:1], places=each["places"][:1]), 1),
        "torque",
    ),
    "another gravity": (lambda content: content["problem"]["flight"].update(gravity=9.0), "residual"),
    "weak motors": (
        lambda content: content["problem"]["limits"].update(motor_torque={"FL_calf_joint": 20.0}),
        "torque",
    ),
    "weak pairs of motors": (weak_pairs, "torque"),
    "a slippery ground": (lambda content: content["problem"]["jump"].update(friction=0.4), "friction"),
    "an obstacle where it stands": (circle(-0.1, 0.45), "obstacles"),
    "an obstacle where it flies": (circle(0.0, 0.75), "obstacles"),
    "links that overlap": (in_problem(self_clearance=[{"links": ["base", "RL_calf"]}]), "self_distance"),
    "the flight's momentum": (
        lambda content: content["flight"].update(angular_momentum=1.001 * content["flight"]["angular_momentum"]),
        "takeoff_seam",
    ),
    "a flight that is none": (lambda content: content["flight"].update(ok=False), "the flight's plan does not hold"),
    "nothing that stands": (lambda content: content["stances"][1].update(contacts=[]), "must name what stands"),
    "endless rates": (arrays(lambda v: 1e200 * v, "v", 1), "is larger than anything in a flight"),
    "endless depths": (contacts(lambda each: each.update(depth=1e200), *STANCES), "is outside 0 to 10 m"),
    "a foot without a name": (contacts(lambda each: each.update(frames=[], places=[]), 1), "has 0 frames and 0 places"),
    "no number": (arrays(lambda y: np.nan * y, "y", 0), "is not finite"),
    "another side": (lambda content: content["stances"][1].update(side="flight"), "must be 'takeoff' or 'landing'"),
}
DAILY = {
    "forces scaled",
    "a phase shifted",
    "feet that hover",
    "endless rates",
}


@pytest.mark.parametrize("case", cases(SPOILED, SPOILED.keys() - DAILY))
def test_a_spoiled_file_is_refused(case, tmp_path):
    spoil, shown = SPOILED[case]
    found = backflip()
    path = found.save(tmp_path / "jump.json")
    content = json.loads(path.read_text())
    spoil(content)
    path.write_text(json.dumps(content))
    try:
        again = load_jump(path)
    except InputError as error:
        assert shown in str(error)  # noqa: PT017
        return
    check = again.check
    assert not check.ok
    assert not again.ok
    shows = {shown: check.figures[shown]} if shown in check.figures else {}
    assert sentences_on(again.request, shows)[0] or shown in check.sentences
