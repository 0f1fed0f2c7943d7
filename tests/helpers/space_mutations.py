"""Plans of flights in space tampered with at random, and a judge that shares nothing with the proof."""

import hashlib
import re
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from places import URDF
from proof_records import certify_record
from scipy.spatial.transform import Rotation
from space_chains import chain_file
from space_distances import Distances
from space_reference import angle, draw_coefficients, flown, free_robot, make_record

import floatplan as fp
from floatplan.arrays import read_only
from floatplan.plans.record import PlanRecord
from floatplan.robot.urdf.tree import urdf_path

INSTANTS = 401
BETWEEN = 1e-4  # [-] of a peak, that may be missed between these instants
FLOWN = 2e-9  # [rad] and [m] that DOP853 is off by, by far
HAIR = 0.125  # share of changes that come close to a tolerance
KINDS = (
    *("coefficient", "h", "duration", "start", "end", "goal", "axes", "turns", "limit", "com", "claim"),
    *("urdf", "nothing"),
)
SHAPES = ("obstacle", "obstacle", "obstacle", "pair", "foot", "collision", "clearance")  # where distances are asked
LEFT = 5e-9  # [m] that distances of true plans are above their margins
LOOKED = 5e-9  # [m] that the judge's distances may be off by


@dataclass(frozen=True)
class Case:
    """A tampered plan, and what was done."""

    kind: str
    record: PlanRecord


@cache
def base_plans(folder: str) -> list[PlanRecord]:
    """True plans: a quadruped, a diver's somersault with a goal of angles, and a chain."""
    rng = np.random.default_rng(5)
    go2 = fp.Robot.from_urdf("example-robot-data:go2_description/urdf/go2.urdf", base="free-flyer")
    diver = fp.Robot.from_urdf(URDF / "diver.urdf", base="free-flyer")
    chain = fp.Robot.from_urdf(chain_file(Path(folder), 5, 1), base="free-flyer")
    legs = draw_coefficients(rng, 12, 0.6, 0.25)
    arms = draw_coefficients(rng, 7, 1.2, 0.15)
    links = draw_coefficients(rng, 5, 1.0, 0.4)
    slack = {"slack": 1.001}
    return [
        make_record(go2, legs, 0.6, [0.2, 1.5, -0.1], ("FL_foot", "RR_foot"), axes="yxz", **slack),
        make_record(diver, arms, 1.2, [0.0, 60.0, 0.0], ("feet", "feet"), axes="yxz", **slack),
        make_record(chain, links, 1.0, [0.5, -0.3, 0.8], ("l0", "l5"), **slack),
        make_record(go2, legs, 0.6, [0.0, 0.0, 0.0], ("FL_foot", "RR_foot"), **slack),
    ]


@cache
def shape_plans(folder: str) -> list[PlanRecord]:
    """True plans that keep clear of things by little: a diver, a quadruped over the ground, and a chain of lines."""
    rng = np.random.default_rng(8)
    diver = fp.Robot.from_urdf(URDF / "diver.urdf", base="free-flyer")
    go2 = fp.Robot.from_urdf("example-robot-data:go2_description/urdf/go2.urdf", base="free-flyer")
    chain = fp.Robot.from_urdf(chain_file(Path(folder), 5, 1), base="free-flyer")
    arms = draw_coefficients(rng, 7, 1.2, 0.15)
    legs = draw_coefficients(rng, 12, 0.6, 0.1)
    links = draw_coefficients(rng, 5, 1.0, 0.4)
    slack = {"slack": 1.001}
    rising = {"velocity": (0.3, -0.2, 3.2)}
    moving = {"velocity": [0.1, 0.0, -0.2], "window": [0.2, 1.1]}
    return [
        keeping_clear(
            make_record(diver, arms, 1.2, [0.0, 60.0, 0.0], ("feet", "feet"), axes="yxz", **slack),
            [
                {"kind": "sphere", "center": [0.3, -1.3, 2.0], "radius": 0.0, "margin": 0.02, **moving},
                {"kind": "capsule", "start": [1.3, -1.0, 2.2], "end": [1.4, 1.0, 2.0], "radius": 0.0, "margin": 0.0},
            ],
            [("left_arm", "legs"), ("left_arm", "right_arm")],
        ),
        keeping_clear(
            make_record(go2, legs, 0.6, [0.2, 0.5, -0.1], ("FL_foot", "RR_foot"), **slack, **rising),
            [
                {"kind": "half-space", "point": [0.0, 0.0, 9.0], "normal": [0.1, 0.0, -1.0], "margin": 0.01},
                {"kind": "box", "center": [1.2, 0.1, 0.5], "size": [0.0] * 3, "margin": 0.0, "window": [0.1, 0.5]},
            ],
            [("FL_calf", "RL_calf")],
            ground=True,
        ),
        keeping_clear(
            make_record(chain, links, 1.0, [0.5, -0.3, 0.8], ("l0", "l5"), **slack),
            [{"kind": "capsule", "start": [0.9, -0.6, 0.9], "end": [0.9, -0.2, 1.2], "radius": 0.0, "margin": 0.03}],
            [("l0", "l4")],
        ),
    ]


def keeping_clear(record, obstacles, pairs, ground=False):
    """A plan past obstacles that are grown until it just clears them, and links that keep apart as they do."""
    record = _with_lowest_foot(record) if ground else record
    distances = Distances(record, _dense(_Key(record)))
    clearances, grown, apart = [], [], []
    for obstacle in obstacles:
        distance = _least(distances, obstacle)
        room = distance - obstacle["margin"] - LEFT
        asked = dict(obstacle)
        if obstacle["kind"] == "half-space":
            normal = np.array(obstacle["normal"]) / np.linalg.norm(obstacle["normal"])
            asked["point"] = (np.array(obstacle["point"]) + room * normal).tolist()
        elif obstacle["kind"] == "box":
            assert room > 0, distance
            asked["size"] = [2 * room] * 3
        else:
            assert room > 0, distance
            asked["radius"] = room
        grown.append(asked)
        clearances.append(_least(distances, asked))
    for links in pairs:
        distance = distances.least(lambda times, links=links: distances.of_pair(links, times))
        assert distance > LEFT, (links, distance)
        apart.append({"links": list(links), "margin": distance - LEFT})
    more = {"obstacles": grown, "self_clearance": apart} | ({"ground": True} if ground else {})
    return replace(_with_problem(record, **more), clearance_min=min(clearances))


def _with_lowest_foot(record):
    """The same flight, its takeoff frame that foot which is lowest at takeoff."""
    distances = Distances(record, _dense(_Key(record)))
    heights = dict(zip((solid[0] for solid in distances.solids), distances.over_ground(np.zeros(1))[0], strict=True))
    return _taking_off_with(record, min(heights, key=lambda link: heights[link]))


def _taking_off_with(record, frame):
    body = free_robot(urdf_path(record.robot.file), record.robot.joints)
    dense = _dense(_Key(record))
    place = body.frame(frame, dense.attitudes[0], np.array(record.com["position0"]), dense.positions[0])
    flight = record.problem["flight"]
    return _with_problem(record, flight=flight | {"takeoff": {"frame": frame, "position": place.tolist()}})


def _least(distances, obstacle):
    low, high = obstacle.get("window") or (0.0, None)
    return distances.least(lambda times: distances.to_obstacle(obstacle, times), low, high)


def certificate_of(record: PlanRecord) -> fp.Certificate:
    """The certificate of a record, with the shapes of its robot where it asks for distances."""
    return fp.certify(record) if record.asks_clearance else certify_record(record)


def mutate(rng: np.random.Generator, record: PlanRecord, folder: Path) -> Case:
    """One random change of a plan, its problem or its robot."""
    kind = str(rng.choice(KINDS if not record.asks_clearance or rng.random() < 0.4 else SHAPES))
    return Case(kind, globals()[f"_{kind}"](rng, record, folder))


def _small(rng, low, high, tolerance=1e-8):
    """A change of random size; one in eight is near the tolerance."""
    if rng.random() < HAIR:
        return float(rng.choice([-1.0, 1.0]) * tolerance * (1.0 + rng.uniform(-0.5, 0.5)))
    return float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(low, high))


def _with_problem(record, **parts):
    return replace(record, problem={**record.problem, **parts})


def _nothing(rng, record, folder):
    return record


def _coefficient(rng, record, folder):
    b = np.array(record.coefficients)
    place = tuple(rng.integers(0, size) for size in b.shape)
    b[place] += _small(rng, -14, -2) * max(1.0, abs(b[place]))
    return replace(record, coefficients=read_only(b))


def _h(rng, record, folder):
    h = np.array(record.angular_momentum)
    which = rng.integers(0, 3)
    h[which] = -h[which] if rng.random() < 0.2 else h[which] + _small(rng, -13, -1)
    flight = record.problem["flight"]
    if rng.random() < 0.7:
        flight = flight | {"angular_momentum": h.tolist() if rng.random() < 0.7 else "free"}
    return replace(_with_problem(record, flight=flight), angular_momentum=read_only(h))


def _duration(rng, record, folder):
    flight = record.problem["flight"] | {"duration": record.duration * (1.0 + _small(rng, -13, -3))}
    return _with_problem(record, flight=flight)


def _turned_quaternion(rng, quaternion):
    """Another quaternion: a sign, two parts exchanged, or turned by a small angle."""
    q = np.array(quaternion)
    what = rng.integers(0, 4)
    if what == 0:
        q = -q  # the same attitude
    elif what == 1:
        k = rng.integers(0, 4)
        q[k] = -q[k]
    elif what == 2:
        i, j = rng.choice(4, 2, replace=False)
        q[[i, j]] = q[[j, i]]
    else:
        turn = rng.normal(size=3)
        turn *= _small(rng, -13, -1) / np.linalg.norm(turn)
        q = (Rotation.from_rotvec(turn) * Rotation.from_quat(q)).as_quat()
    return q.tolist()


def _start(rng, record, folder):
    q = _turned_quaternion(rng, record.orientation["start"]["quaternion_xyzw"])
    record = replace(record, orientation={**record.orientation, "start": {"quaternion_xyzw": q}})
    if rng.random() < 0.5:
        record = _with_problem(record, start=record.problem["start"] | {"orientation": {"quaternion_xyzw": q}})
    return record


def _end(rng, record, folder):
    q = _turned_quaternion(rng, record.orientation["end"]["quaternion_xyzw"])
    return replace(record, orientation={**record.orientation, "end": {"quaternion_xyzw": q}})


def _goal(rng, record, folder):
    asked = dict(record.problem["goal"]["orientation"])
    if "angles" in asked:
        angles = list(asked["angles"])
        angles[rng.integers(0, 3)] += _small(rng, -13, -1)
        asked["angles"] = angles
        q = Rotation.from_euler(asked["axes"].upper(), angles).as_quat().tolist()
    else:
        q = asked["quaternion_xyzw"] = _turned_quaternion(rng, asked["quaternion_xyzw"])
    if rng.random() < 0.8:
        record = replace(record, orientation={**record.orientation, "goal": {"quaternion_xyzw": q}})
    return _with_problem(record, goal=record.problem["goal"] | {"orientation": asked})


def _axes(rng, record, folder):
    end = str(rng.choice(["start", "goal"]))
    asked = dict(record.problem[end]["orientation"])
    if "axes" not in asked:
        return _goal(rng, record, folder)
    asked["axes"] = "".join(rng.permutation(list("xyz")))
    return _with_problem(record, **{end: record.problem[end] | {"orientation": asked}})


def _turns(rng, record, folder):
    asked = dict(record.problem["goal"]["orientation"])
    if "angles" not in asked:
        return _goal(rng, record, folder)
    angles = list(asked["angles"])
    angles[rng.choice([0, 2])] += float(rng.choice([-2, -1, 0, 1, 2])) * 2 * np.pi
    asked["angles"] = angles
    return _with_problem(record, goal=record.problem["goal"] | {"orientation": asked})


def _limit(rng, record, folder):
    limits = dict(record.problem["limits"])
    key = str(rng.choice(["velocity", "acceleration", "torque", "orientation_rate"]))
    change = 1.0 + (rng.uniform(-1.5e-3, 1.5e-3) if rng.random() < HAIR else _small(rng, -4, -1))
    if key == "orientation_rate":
        limits[key] *= change
    else:
        values = list(limits[key])
        values[rng.integers(0, len(values))] *= change
        limits[key] = values
    return _with_problem(record, limits=limits)


def _com(rng, record, folder):
    com = {name: list(value) if isinstance(value, list) else value for name, value in record.com.items()}
    key = str(rng.choice(["position0", "velocity0", "gravity"]))
    if key == "gravity":
        com[key] += _small(rng, -14, -2)
    else:
        com[key][rng.integers(0, 3)] += _small(rng, -13, -2)
    return replace(record, com=com)


def _claim(rng, record, folder):
    key = str(rng.choice(["torque_peak", "velocity_peak"]))
    peaks = np.array(getattr(record, key))
    peaks[rng.integers(0, len(peaks))] *= 1.0 + _small(rng, -5, -1, 2e-3)
    return replace(record, **{key: read_only(peaks)})


def _urdf(rng, record, folder, keys=("mass", "ixx", "iyy", "izz", "ixz", "origin", "axis")):
    """One number of a link or a joint that carries mass, in another file."""
    text = urdf_path(record.robot.file).read_text()
    key = str(rng.choice(keys))
    pattern = {
        "mass": r'(<mass value=")([^"]+)(")',
        "origin": r'(<origin[^>]*xyz=")([^"]+)(")',
        "axis": r'(<axis xyz=")([^"]+)(")',
    }.get(key, rf'({key}=")([^"]+)(")')
    found = list(re.finditer(pattern, text))
    if not found:
        return record
    match = found[rng.integers(0, len(found))]
    numbers = np.array([float(word) for word in match[2].split()])
    which = rng.integers(0, len(numbers))
    if key == "axis" and rng.random() < 0.5:
        numbers = -numbers
    elif key in ("size", "radius", "length"):
        numbers[which] = abs(numbers[which] + _small(rng, -10, -2))
    elif key in ("origin", "axis"):
        numbers[which] += _small(rng, -13, -2)
    else:
        numbers[which] *= 1.0 + _small(rng, -13, -2)
    changed = text[: match.start(2)] + " ".join(map(repr, numbers.tolist())) + text[match.end(2) :]
    digest = hashlib.sha256(changed.encode()).hexdigest()
    path = folder / f"{digest[:16]}.urdf"
    path.write_text(changed)
    return replace(record, robot=replace(record.robot, urdf=str(path), sha256=digest))


def _obstacle(rng, record, folder):
    """One number of an obstacle: its size, place, margin, velocity or window."""
    obstacles = [dict(obstacle) for obstacle in record.problem["obstacles"]]
    obstacle = obstacles[rng.integers(0, len(obstacles))]
    key = str(rng.choice([key for key in obstacle if key != "kind"]))
    value = obstacle[key]
    if key == "window" and rng.random() < 0.2:
        obstacle[key] = [value[0], value[0]]
    elif isinstance(value, list):
        numbers = list(value)
        which = rng.integers(0, len(numbers))
        numbers[which] += _small(rng, -10, -1)
        obstacle[key] = sorted(numbers) if key == "window" else [abs(x) for x in numbers] if key == "size" else numbers
    else:
        obstacle[key] = abs(value + _small(rng, -10, -1))
    return _with_problem(record, obstacles=obstacles)


def _pair(rng, record, folder):
    pairs = [dict(pair) for pair in record.problem["self_clearance"]]
    pair = pairs[rng.integers(0, len(pairs))]
    if rng.random() < 0.7:
        pair["margin"] = abs(pair["margin"] + _small(rng, -10, -2))
    else:
        links = sorted({shape[0] for shape in Distances(record, _dense(_Key(record))).capsules})
        pair["links"] = [str(link) for link in rng.choice(links, 2, replace=False)]
    return _with_problem(record, self_clearance=pairs)


def _foot(rng, record, folder):
    """Another link that leaves the ground where it is."""
    links = sorted({shape[0] for shape in Distances(record, _dense(_Key(record))).solids})
    return _taking_off_with(record, str(rng.choice(links)))


def _clearance(rng, record, folder):
    return replace(record, clearance_min=record.clearance_min + _small(rng, -6, -2, 2e-4))


def _collision(rng, record, folder):
    """One number of a link's shape, in another file."""
    return _urdf(rng, record, folder, ["size", "radius", "length", "origin"])


class _Key:
    """A record that is equal to another where their motions are."""

    def __init__(self, record):
        self.record = record
        h, start = record.angular_momentum, record.orientation["start"]["quaternion_xyzw"]
        self.key = (record.coefficients.tobytes(), tuple(h), record.duration, tuple(start), record.robot.sha256)

    def __eq__(self, other):
        return self.key == other.key

    def __hash__(self):
        return hash(self.key)


@lru_cache(maxsize=8)
def _dense(key):
    return flown(key.record, np.linspace(0.0, key.record.duration, INSTANTS))


def judge(record: PlanRecord) -> str:
    """Say "invalid" where a violation beyond the tolerance is seen, "valid" where there is room, else "unclear"."""
    verdict = "valid"
    for excess, noise in questions(record):
        if excess > noise:
            return "invalid"
        if not excess < -noise:
            verdict = "unclear"
    return verdict


def questions(record):
    """Violations beyond the tolerances, and what they may be off by."""
    dense = _dense(_Key(record))
    problem = record.problem
    start, goal = (_rotation(problem[end]["orientation"]) for end in ("start", "goal"))
    stated = {name: Rotation.from_quat(value["quaternion_xyzw"]) for name, value in record.orientation.items()}
    last = dense.attitudes[-1]
    yield angle(last, goal.as_matrix()) - 1e-8, FLOWN
    yield angle(last, stated["end"].as_matrix()) - 1e-8, FLOWN
    for one, other in ((start, stated["start"]), (goal, stated["goal"])):
        yield (one.inv() * other).magnitude() - 1e-12, 1e-14
    yield from _turn_questions(problem, dense, start)
    for index, end in ((0, "start"), (-1, "goal")):
        for name, tolerance in (("positions", 1e-8), ("velocities", 1e-7), ("accelerations", 1e-5)):
            off = np.abs(getattr(dense, name)[index] - problem[end][name]).max()
            yield off - tolerance, 0.02 * tolerance + 1e-12 * np.abs(getattr(dense, name)[index]).max()
    yield from _path_questions(record, dense)
    limits = problem["limits"]
    rate = np.linalg.norm(dense.rates, axis=1).max()
    peaks = [(dense.velocities, "velocity"), (dense.accelerations, "acceleration"), (dense.torques, "torque")]
    shares = [(np.abs(values).max(0), _peaks(values), np.array(limits[key])) for values, key in peaks]
    shares.append((np.array([rate]), np.array([rate]), np.array([limits["orientation_rate"]])))
    for seen, peak, limit in shares:
        is_beyond = (seen / limit).max() > 1.0 + 1e-6
        yield (1.0, 0.0) if is_beyond else ((peak / limit).max() + BETWEEN - 1.0, BETWEEN)
    for claimed, values in ((record.torque_peak, dense.torques), (record.velocity_peak, dense.velocities)):
        off = np.abs(claimed / np.maximum(_peaks(values), 1e-3) - 1.0).max()
        yield off - 2e-3, 3e-4

    if record.asks_clearance:
        yield from _distance_questions(record, dense)


def _peaks(values):
    """Largest magnitudes (n,) over instants (K, n) side by side, by parabolas through each largest one's neighbours.

    Towards landing a chain's torques rise so steeply that the largest sampled one is a thousandth below the peak.
    """
    sizes = np.abs(values)
    before, here, after = sizes[:-2], sizes[1:-1], sizes[2:]
    curvature = 2.0 * here - before - after
    is_peak = (here >= before) & (here >= after) & (curvature > 0.0)
    rise = np.where(is_peak, (before - after) ** 2 / (8.0 * np.where(is_peak, curvature, 1.0)), 0.0)
    return np.maximum((here + rise).max(0), np.maximum(sizes[0], sizes[-1]))


def _distance_questions(record, dense):
    problem = record.problem
    distances = Distances(record, dense)
    clearances = []
    for obstacle in problem["obstacles"]:
        least = _least(distances, obstacle)
        clearances.append(least)
        yield obstacle["margin"] - 1e-8 - least, LOOKED
    if clearances:
        yield abs(record.clearance_min - min(clearances)) - 2e-4, 1e-6
    for pair in problem["self_clearance"]:
        least = distances.least(lambda times, pair=pair: distances.of_pair(pair["links"], times))
        yield pair["margin"] - 1e-8 - least, LOOKED
    if problem.get("ground"):
        yield -1e-8 - distances.least(distances.over_ground), LOOKED


def _turn_questions(problem, dense, start):
    asked, begin = problem["goal"]["orientation"], problem["start"]["orientation"]
    if "axes" not in asked:
        return
    axes = asked["axes"].upper()
    angles = Rotation.from_matrix(dense.attitudes).as_euler(axes)
    angles[:, [0, 2]] = np.unwrap(angles[:, [0, 2]], axis=0)
    first = begin["angles"] if begin.get("axes") == asked["axes"] else start.as_euler(axes)
    off = np.abs(angles[-1] - angles[0] - (np.array(asked["angles"]) - first)).max()
    yield off - 1.0, 1e-3
    yield np.abs(angles[:, 1]).max() - np.radians(70) - 0.01, 1e-3


def _path_questions(record, dense):
    flight, com, end = record.problem["flight"], record.com, record.duration
    body = free_robot(urdf_path(record.robot.file), record.robot.joints)
    at = np.array(com["position0"]), np.array(com["velocity0"])
    fall = np.array([0.0, 0.0, com["gravity"] / 2 * end**2])
    left = body.frame(flight["takeoff"]["frame"], dense.attitudes[0], at[0], dense.positions[0])
    path = at[0] + at[1] * end - fall
    landed = body.frame(flight["landing"]["frame"], dense.attitudes[-1], path, dense.positions[-1])
    yield np.abs(left - flight["takeoff"]["position"]).max() - 1e-8, FLOWN
    yield abs(landed[2] - flight["landing"]["height"]) - 1e-8, FLOWN
    pairs = [(com["gravity"], flight["gravity"]), *zip(com["velocity0"], flight["horizontal_velocity"], strict=False)]
    if not isinstance(flight["angular_momentum"], str):
        pairs += list(zip(record.angular_momentum, flight["angular_momentum"], strict=True))
    for number, other in pairs:
        yield abs(number - other) - 1e-12 * max(1.0, abs(number), abs(other)), 1e-13 * max(1.0, abs(number))


def _rotation(asked):
    if "axes" in asked:
        return Rotation.from_euler(asked["axes"].upper(), asked["angles"])
    return Rotation.from_quat(asked["quaternion_xyzw"])
