"""Every value of a plan file, tampered with: what becomes of it is written down here, key by key."""

import copy
import json
import math
import re
from dataclasses import fields, replace

import numpy as np
import pytest
from long_cases import cases
from places import URDF
from proof_plans import draw_coefficients, make_plan

import floatplan as fp
from floatplan.certificate import branch_and_bound as say
from floatplan.certificate.enclosure import Balls
from floatplan.errors import InputError
from floatplan.plans.plan import load_plan, rebuild
from floatplan.plans.reading import record_from_dict
from floatplan.plans.record import PlanRecord
from floatplan.robot.robot import Coupling, Robot

CLAIM = "claim"  # proved: another value is refuted, or refused
ASKED = "asked"  # a constraint, or a part of one: another value asks something else, and that is judged
FREE = "free"  # no part of the statement, see docs/certificate.md
TABLE = {  # pattern of a path -> what its value is; the first that fits counts
    r"format": CLAIM,
    r"floatplan|status|ok|explanation|problem_file": FREE,
    r"problem\.name|problem\.jump\.friction": FREE,
    r"problem\.ground": ASKED,
    r"problem\.limits\.motor_torque\.q[123]": ASKED,
    r"problem\.(start|goal)\.(orientation|(positions|velocities|accelerations)\[.\])": CLAIM,
    r"problem\.flight\.(duration|angular_momentum|horizontal_velocity|gravity)": CLAIM,
    r"problem\.flight\.(takeoff\.position\[.\]|landing\.height)": CLAIM,
    r"problem\.flight\.(takeoff|landing)\.frame": CLAIM,
    r"problem\.motion\.(degree\[.\]|objective)": CLAIM,
    r"problem\.limits\.(position\[.\]\[.\]|(velocity|acceleration|torque)\[.\]|orientation_rate)": ASKED,
    r"problem\.limits\.motor\.q1\.(stall|slope)": ASKED,
    r"problem\.obstacles\[.\]\.(center|point|normal|start|end|velocity|window)\[.\]": ASKED,
    r"problem\.obstacles\[.\]\.(radius|margin|window|velocity)": ASKED,
    r"problem\.obstacles\[.\]\.kind": CLAIM,
    r"problem\.self_clearance\[.\]\.margin": ASKED,
    r"problem\.self_clearance\[.\]\.links\[.\]": ASKED,
    r"robot\.(urdf|sha256|plane|joints\[.\])": CLAIM,
    r"robot\.coupled\.q3\.(leader|ratio|offset)|robot\.locked\.q\d+|robot\.armature\.q\d+": CLAIM,
    r"robot\.damping\.q\d+": FREE,
    r"angular_momentum|centre\[.\]|amplitude\[.\]|coefficients\[.\]\[.\]": CLAIM,
    r"orientation\.(start|end|goal)": CLAIM,
    r"com\.(position0\[.\]|velocity0\[.\]|gravity)": CLAIM,
    r"torque_peak\[.\]|velocity_peak\[.\]|motor_torque_peak\.q[123]|clearance_min": CLAIM,
    r"objective\.name": CLAIM,
    r"angular_momentum_bounds\[.\]|objective\.value|solver\..*|out_of_plane_leak|certificate\..*|replay\..*": FREE,
    r"warnings\[.\]\..*|utilisation\[.\]\..*": FREE,
}


@pytest.fixture(scope="module")
def honest():
    """A plan with something under every key."""
    robot = Robot.from_urdf(
        URDF / "chain10.urdf",
        coupled={"q3": Coupling("q1", -0.7, 0.2)},
        locked={f"q{k}": 0.1 for k in range(4, 11)},
        armature={"q1": 0.02, "q3": 0.5},
        damping={"q2": 0.1},
    )
    assert robot.joints == ("q1", "q2")
    coefficients = draw_coefficients(np.random.default_rng(8), 2, 0.9, 0.3)
    obstacles = [
        {"kind": "circle", "center": [9.0, 9.0], "radius": 0.2, "margin": 0.01, "velocity": [0.1, 0.0], "window": None},
        {"kind": "half-plane", "point": [0.0, -30.0], "normal": [0.0, 1.0], "margin": 0.0, "window": [0.2, 0.7]},
        {"kind": "capsule", "start": [9.0, 0.0], "end": [9.0, 2.0], "radius": 0.1, "margin": 0.0},
    ]
    pairs = [{"links": [robot.tree.names[0], robot.tree.names[2]], "margin": 1e-6}]
    record = make_plan(robot, coefficients, duration=0.9, obstacles=obstacles, self_clearance=pairs)
    motor = {"q1": {"stall": 1e3, "slope": 0.1}}
    own = {"motor": motor, "motor_torque": {"q1": 900.0, "q2": 800.0, "q3": 700.0}}
    limits = record.problem["limits"] | own | {"acceleration": [9e5, 8e5]}
    record = replace(
        record,
        problem=record.problem | {"limits": limits, "ground": False, "jump": {"friction": 0.6}},
        motor_torque_peak=fp.certify(record).motor_torque_peak,
        warnings=[{"kind": "ground"}],
        utilisation=[{"joint": "q1"}],
        out_of_plane_leak=0.0,
        solver={"seed": 0},
        certificate={"verdict": "refuted"},
        replay={"landed": False},
    )
    assert fp.certify(record).proved
    return record


def leaves(content, path=()):
    """Paths of all that is neither a table nor a list in plain data."""
    if isinstance(content, dict):
        return [leaf for key, value in content.items() for leaf in leaves(value, (*path, key))]
    if isinstance(content, list):
        return [leaf for index, value in enumerate(content) for leaf in leaves(value, (*path, index))]
    return [path]


@pytest.fixture(params=cases(["one", "all"], {"all"}))
def chosen(request, honest):
    """Leaves of a record: all, or of each key the last of its list."""
    paths = leaves(honest.to_dict())
    return (
        paths if request.param == "all" else [*{re.sub(r"\[\d+\]", "", name_of(path)): path for path in paths}.values()]
    )


def name_of(path):
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")


def what(path):
    name = name_of(path)
    return next(kind for pattern, kind in TABLE.items() if re.fullmatch(pattern, name))


def value_at(content, path):
    for part in path:
        content = content[part]
    return content


def tampered(content, path, value):
    content = copy.deepcopy(content)
    value_at(content, path[:-1])[path[-1]] = value
    return content


def judged(content):
    """The certificate's verdict on the content of a plan file, "refused" where it is refused."""
    try:
        return fp.certify(record_from_dict(content)).verdict
    except InputError:
        return "refused"


def test_every_key_is_in_the_table(honest):
    content = honest.to_dict()
    assert set(content) == {field.name for field in fields(PlanRecord)}
    for path in leaves(content):
        assert what(path) in (CLAIM, ASKED, FREE)
    used = {pattern for pattern in TABLE if any(re.fullmatch(pattern, name_of(p)) for p in leaves(content))}
    assert used == set(TABLE)


def test_another_number_under_any_key_is_seen(honest, chosen):
    """By a thousandth of it, or of one; limits and obstacles are judged as they then are."""
    content = honest.to_dict()
    for path in chosen:
        value = value_at(content, path)
        if isinstance(value, bool) or not isinstance(value, float):
            continue
        verdict = judged(tampered(content, path, value + 1e-2 * max(1.0, abs(value))))
        wanted = {CLAIM: ("refuted", "refused"), FREE: ("proved",), ASKED: ("proved", "refuted")}[what(path)]
        assert verdict in wanted, (name_of(path), verdict)


def test_another_word_under_any_key_is_seen(honest, chosen):
    content = honest.to_dict()
    for path in chosen:
        value = value_at(content, path)
        if isinstance(value, str):
            verdict = judged(tampered(content, path, value + "?"))
            wanted = ("proved", "refused") if what(path) == FREE else ("refused",)
            assert verdict in wanted, (name_of(path), verdict)


def test_a_number_that_is_not_finite_is_refused_anywhere_in_a_file(honest, chosen, tmp_path):
    content = honest.to_dict()
    path = tmp_path / "plan.json"
    for place in chosen:
        for number in ("1e999", "-1e999", "NaN", "Infinity", "1" + "0" * 400):
            text = json.dumps(tampered(content, place, "@"))
            path.write_text(text.replace('"@"', number))
            for judge in (fp.certify, load_plan):
                with pytest.raises(InputError, match="is not finite") as caught:
                    judge(path)
                assert (caught.value.source, caught.value.element) == (str(path), name_of(place))


@pytest.mark.parametrize(
    ("table", "key"),
    [('"gravity": 9.81', "gravity"), ('"margin": 0.01', "margin"), ('"urdf": ', "urdf"), ('"seed": 0', "seed")],
)
def test_a_key_given_twice_is_refused(honest, tmp_path, table, key):
    """The second would count, and a reader may have seen the first."""
    text = json.dumps(honest.to_dict())
    assert table in text
    path = tmp_path / "plan.json"
    path.write_text(text.replace(table, f'"{key}": 0.0, {table}', 1))
    for judge in (fp.certify, load_plan):
        with pytest.raises(InputError, match="twice") as caught:
            judge(path)
        assert (caught.value.source, caught.value.element) == (str(path), key)


def test_a_clearance_without_obstacles_is_a_false_claim(honest):
    bare = replace(honest, problem=honest.problem | {"obstacles": []})
    assert fp.certify(bare).verdict == "refuted"
    assert fp.certify(replace(bare, clearance_min=None)).proved
    assert fp.certify(replace(honest, clearance_min=None)).verdict == "refuted"
    for record in (bare, replace(honest, clearance_min=None)):
        with pytest.raises(InputError) as caught:
            rebuild(record)
        assert caught.value.element == "clearance_min"


@pytest.mark.parametrize("tolerance", [math.inf, math.nan])
def test_no_tolerance_proves_by_itself(tolerance):
    assert say.at_most("ground", (), 1.0, 0.0, 0.0, tolerance, None).verdict != "proved"
    assert say.at_least("ground", (), 1.0, 2.0, 3.0, tolerance, None).verdict != "proved"
    assert say.near("ground", (), Balls.exact([1.0]), [1.0], tolerance).verdict != "proved"
    with np.errstate(invalid="ignore"):
        assert say.near("ground", (), Balls.exact([math.inf]), [math.inf], 1.0).verdict != "proved"
        assert say.near("ground", (), Balls.exact([1.0]), [math.nan], 1.0).verdict != "proved"


SHORT = [
    [0.0, 5e-324],
    [-1.0, 5e-324],
    [5e-324, 1e-323],
    [0.45, math.nextafter(0.45, 1)],
    [math.nextafter(0.9, 0), 0.9],
]
OUTSIDE = [[-2.0, -1.0], [2.0, 3.0], [-5e-324, 0.0], [0.9, 2.0], [0.9, math.nextafter(0.9, 1)]]


@pytest.mark.parametrize("window", [*SHORT, *OUTSIDE])
def test_a_window_of_no_length_ends_with_a_verdict(honest, window):
    obstacle = honest.problem["obstacles"][0] | {"window": window}
    certificate = fp.certify(replace(honest, problem=honest.problem | {"obstacles": [obstacle]}))
    own = next(finding for finding in certificate.findings if (finding.kind, finding.subject[:1]) == ("obstacle", (0,)))
    assert own.verdict == "proved"
    said = [certificate.clearance_min, *certificate.orientation_end]
    said += [value for f in certificate.findings for value in (f.bound, f.instant, f.limit, f.gap)]
    assert not any(value is not None and math.isnan(value) for value in said)


def test_an_obstacle_that_is_there_for_an_instant_is_not_passed_over(honest):
    """It covers the robot, in a window shorter than any cell."""
    for window in SHORT[:1] + SHORT[3:]:
        obstacle = honest.problem["obstacles"][0] | {"center": [0.0, 0.0], "radius": 5.0, "window": window}
        record = replace(honest, problem=honest.problem | {"obstacles": [obstacle]})
        assert not fp.certify(record).proved
    assert (
        fp.certify(
            replace(honest, problem=record.problem | {"obstacles": [obstacle | {"window": [0.0, 1e-9]}]})
        ).verdict
        == "refuted"
    )
