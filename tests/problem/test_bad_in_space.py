"""Every bad input of a flight in space is refused with file, key and reason, in Python and on the command line."""

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w
from places import ROOT

import floatplan as fp

NOT_YET = "is for flights in a plane, and not yet for those in space"
HALF_A_TURN = "is half a turn from the start, and which way round is left open"
AXES = "is not three of the letters x, y, z with neighbours that differ"
EITHER = "give either quaternion_xyzw, or angles and axes"
NEITHER = "is neither an angle nor an Attitude"
MOMENTUM = "must be 0, three numbers, 'suggested' or 'free'"


def q(*numbers):
    return {"quaternion_xyzw": list(numbers)}


def angles(*numbers, axes="yxz"):
    return {"angles": list(numbers), "axes": axes}


def ball(**others):
    return {"kind": "sphere", "center": [0, 0, 5], "radius": 0.1, **others}


OBSTACLE, KINDS = "obstacles", "is not a table with kind = 'sphere', 'capsule', 'half-space' or 'box'"
GOAL, H, SPEED, LEAVES, LANDS = (
    "goal.orientation",
    "flight.angular_momentum",
    "flight.horizontal_velocity",
    "flight.takeoff",
    "flight.landing",
)
BAD = [  # what is written under a key, the key that is named, and what is said of it
    (GOAL, 30, GOAL, "must be an Attitude"),
    (GOAL, [0, 0, 0, 1], GOAL, NEITHER),
    (GOAL, {}, f"{GOAL}.quaternion_xyzw", EITHER),
    (GOAL, {"quaternion": [0, 0, 0, 1]}, f"{GOAL}.quaternion", "did you mean 'quaternion_xyzw'"),
    (GOAL, q(0, 0, 0, 0), f"{GOAL}.quaternion_xyzw", "length zero"),
    (GOAL, q(1e-8, 0, 0, 0), f"{GOAL}.quaternion_xyzw", "length zero"),
    (GOAL, q(0, 0, 1), f"{GOAL}.quaternion_xyzw", "is not four numbers"),
    (GOAL, q(0, 0, 0, 0, 1), f"{GOAL}.quaternion_xyzw", "is not four numbers"),
    (GOAL, q(0, 0, 1e300, 1e300), f"{GOAL}.quaternion_xyzw[2]", "1e+300 is outside -1e+06 to 1e+06\n"),
    (GOAL, {**q(0, 0, 0, 1), "axes": "xyz"}, f"{GOAL}.axes", "a quaternion has no axes"),
    (GOAL, {**q(0, 0, 0, 1), **angles(0, 0, 0)}, f"{GOAL}.quaternion_xyzw", EITHER),
    (GOAL, q(1, 0, 0, 0), GOAL, HALF_A_TURN),
    (GOAL, q(0, -2, 2, 1e-4), GOAL, HALF_A_TURN),
    (GOAL, angles(0, 0, 0, axes="xyy"), f"{GOAL}.axes", AXES),
    (GOAL, angles(0, 0, 0, axes="xyzx"), f"{GOAL}.axes", AXES),
    (GOAL, angles(0, 0, 0, axes="XYZ"), f"{GOAL}.axes", AXES),
    (GOAL, angles(0, 0, 0, axes=""), f"{GOAL}.axes", AXES),
    (GOAL, angles(0, 0, 0, axes=["x", "y", "z"]), f"{GOAL}.axes", "is not a text"),
    (GOAL, {"angles": [0, 0, 0]}, f"{GOAL}.axes", "is missing"),
    (GOAL, {"axes": "xyz"}, f"{GOAL}.quaternion_xyzw", EITHER),
    (GOAL, angles(0, 0), f"{GOAL}.angles", "is not three numbers"),
    (GOAL, angles(1e300, 0, 0), f"{GOAL}.angles[0]", "is outside -10000 to 10000 rad"),
    (GOAL, angles(0, 71, 0), GOAL, "its second angle about 'yxz' is 71 degrees; it must be within -70 to 70"),
    (GOAL, angles(0, -110, 0), GOAL, "its second angle about 'yxz' is -110 degrees"),
    (GOAL, angles(0, 90, 0, axes="zxz"), "start.orientation", "must be within 20 to 160"),
    (H, 3.0, H, MOMENTUM),
    (H, "fast", H, "'suggested', not 'fast'"),
    (H, [], H, "[] is not three numbers"),
    (H, [1, 2], H, "[1, 2] is not three numbers"),
    (H, [1, 2, 3, 4], H, "[1, 2, 3, 4] is not three numbers"),
    (H, [[1, 2, 3]], H, "is not three numbers"),
    (H, {"x": 1}, H, "is not three numbers"),
    (H, [1e30, 0, 0], f"{H}[0]", "is outside -1e+09 to 1e+09 kg m^2/s"),
    (SPEED, 2.0, SPEED, "must be two numbers, along x and y"),
    (SPEED, [1, 2, 3], SPEED, "is not two numbers"),
    (SPEED, [1e9, 0], f"{SPEED}[0]", "is outside -10000 to 10000 m/s"),
    (LEAVES, {"frame": "nose"}, f"{LEAVES}.frame", "the robot has no frame 'nose'"),
    (LEAVES, {"frame": "base", "position": [1, 2]}, f"{LEAVES}.position", "must be three numbers"),
    (LEAVES, {"frame": "base", "position": [1, 2, 3, 4]}, f"{LEAVES}.position", "is not two numbers, nor three"),
    (LANDS, {"frame": "nose"}, f"{LANDS}.frame", "the robot has no frame 'nose'"),
    ("start.velocities", "takeoff", "start.velocities", NOT_YET),
    ("goal.velocities", "landing", "goal.velocities", NOT_YET),
    ("jump", {"landing": {"displacement": [1]}}, "jump.landing.displacement", "is not two numbers"),
    ("jump", {"takeoff": {"contacts": [["paw"]]}}, "jump.takeoff.contacts[0]", "the robot has no frame 'paw'"),
    (OBSTACLE, [{"kind": "circle", "center": [0, 0], "radius": 1}], f"{OBSTACLE}[0]", KINDS),
    (OBSTACLE, [{"kind": "half-plane", "normal": [0, 1]}], f"{OBSTACLE}[0]", KINDS),
    (
        OBSTACLE,
        [{"kind": "capsule", "start": [0, 0], "end": [0, 1], "radius": 1}],
        f"{OBSTACLE}[0].start",
        "three numbers",
    ),
    (OBSTACLE, [ball(center=[0, 0])], f"{OBSTACLE}[0].center", "three numbers"),
    (OBSTACLE, [ball(radius=0)], f"{OBSTACLE}[0].radius", "is 0, and what has no volume keeps nothing away"),
    (
        OBSTACLE,
        [{"kind": "capsule", "start": [0, 0, 5], "end": [0, 1, 5], "radius": 0}],
        f"{OBSTACLE}[0].radius",
        "is 0, and what has no volume keeps nothing away",
    ),
    (OBSTACLE, [ball(velocity=[0, 1])], f"{OBSTACLE}[0].velocity", "three numbers"),
    (OBSTACLE, [ball(window=[90, 91])], f"{OBSTACLE}[0].window", "lies outside the flight"),
    (OBSTACLE, [ball(window=[2, 1])], f"{OBSTACLE}[0].window", "the window ends"),
    (OBSTACLE, [ball(size=1)], f"{OBSTACLE}[0].size", "unknown key"),
    (
        OBSTACLE,
        [{"kind": "box", "center": [0, 0, 0], "size": [1, 1, 0]}],
        f"{OBSTACLE}[0].size",
        "has an edge that is 0",
    ),
    (OBSTACLE, [{"kind": "half-space", "normal": [0, 0, 0]}], f"{OBSTACLE}[0].normal", "length zero"),
    ("self_clearance", [{"links": ["base", "forearm"]}], "self_clearance[0].links", "no link 'forearm' with a shape"),
    ("robot.base", "free", "robot.base", "must be 'planar' or 'free-flyer', not 'free'"),
    ("robot.base", "planar", "start.orientation", "must be an angle, where the robot flies in a plane"),
    ("robot.plane", "xz", "robot.plane", "a flight in space has none"),
    ("robot.coupled", "mirror", 'robot.coupled "mirror"', "name the pairs"),
    ("robot.joints", [], "robot.joints", "no joint is left to plan"),
]


@pytest.fixture(scope="module")
def written():
    content = (ROOT / "problems" / "space" / "free_ur5.toml").read_text()
    return content.replace("../../urdf", str(ROOT / "urdf"))


@pytest.mark.parametrize(("key", "value", "named", "reason"), BAD)
def test_it_is_refused_with_file_key_and_reason(written, key, value, named, reason, tmp_path, floatplan):
    content = tomllib.loads(written)
    *tables, last = key.split(".")
    table = content
    for name in tables:
        table = table[name]
    table.pop(last, None)
    if value is not None:
        table[last] = value
    path = tmp_path / "bad.toml"
    path.write_text(tomli_w.dumps(content))
    with pytest.raises(fp.InputError) as refused:
        fp.load_problem(path)
    told = f"{refused.value}\n"
    (line, *_) = (each for each in told.splitlines() if named in each)
    assert line.startswith(f"{path}: {named}: "), told
    assert reason in told
    run = floatplan("plan", path)
    assert (run.code, run.stdout) == (2, "")
    assert "".join(line.split()) in "".join(run.stderr.split())
    assert not Path("runs").exists()


def test_a_goal_beyond_double_precision_is_named_at_once(floatplan, tmp_path):
    problem = fp.load_problem(ROOT / "problems" / "space" / "diver_full_twist.toml")
    orientation = problem.goal.orientation
    somersault, tilt, twist = orientation.angles
    goal = replace(problem.goal, orientation=replace(orientation, angles=(4 * somersault, tilt, twist)))
    plan = fp.plan(replace(problem, goal=goal))
    assert plan.ok
    path = tmp_path / "plan.json"
    plan.save(path)
    run = floatplan("certify", path)
    assert run.code == 1
    said = " ".join(run.stdout.split())
    assert "goal.orientation: the goal to within 1e-08 rad is beyond double precision: a small turn grows " in said
    assert "fewer turns or a shorter flight may help" in said
    certificate = fp.certify(plan, budget=4096)
    assert certificate.verdict == "undecided"
    assert certificate.subintervals < 100  # more of them would be rounding as well
