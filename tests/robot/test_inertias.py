"""Inertias that no body can have, refused or balanced as MuJoCo does, and masses that links carry."""

import json

import mujoco
import numpy as np
import pytest
from robot_samples import TWO_LINKS, inertial, joint, robot_text

import floatplan as fp
from floatplan.certificate.planar.inertia import cached_robot
from floatplan.errors import InputError
from floatplan.plans.reading import robot_record
from floatplan.problem.file import load_robot, save_problem

FLAT = 'ixx="0.004" ixy="0" ixz="0" iyy="0.013" iyz="0" izz="0.005"'  # 0.013 > 0.004 + 0.005
SKEWED = 'ixx="0.006" ixy="0.003" ixz="-0.001" iyy="0.009" iyz="0.004" izz="0.002"'  # turned, and not definite
NEGATIVE = 'ixx="-0.001" ixy="0" ixz="0" iyy="0.008" iyz="0" izz="0.008"'
BAD = {"triangle": FLAT, "indefinite, turned": SKEWED, "negative": NEGATIVE}
MEANS = {"triangle": 0.022 / 3, "indefinite, turned": 0.017 / 3, "negative": 0.005}


def bad_link(moments):
    return (
        f'<link name="b"><inertial><origin xyz="0.1 0.02 0" rpy="0.3 0.2 0.1"/><mass value="0.8"/><inertia {moments}/>'
        "</inertial></link>"
    )


def arm(moments):
    return robot_text(f'<link name="a">{inertial(3.0, "0 0 0")}</link>', bad_link(moments), joint("j", "a", "b"))


def written(folder, text, name="robot.urdf"):
    path = folder / name
    path.write_text(text)
    return path


def same_constants(robot, tolerance=1e-12):
    """The certificate, which reads file and record on its own, has the same robot."""
    proved = cached_robot(robot.path.read_bytes(), robot.path, robot_record(robot))
    coupling = robot.tree.coupling + np.diag(robot.tree.inertia)
    assert proved.inertia.re.mid == pytest.approx(coupling.real, abs=tolerance)
    assert abs(proved.inertia.im.mid) == pytest.approx(abs(coupling.imag), abs=tolerance)


@pytest.mark.parametrize("name", BAD)
def test_they_are_refused_with_what_can_be_done_or_balanced(tmp_path, name):
    path = written(tmp_path, arm(BAD[name]))
    with pytest.raises(InputError, match="balance_inertias = true under") as caught:
        fp.Robot.from_urdf(path)
    assert caught.value.element == 'link "b": inertia'
    assert "--balance-inertias" in str(caught.value)
    robot = fp.Robot.from_urdf(path, balance_inertias=True)
    (warning,) = robot.warnings
    assert warning.startswith("balanced: inertias that no body can have")
    assert warning.endswith(": b")
    assert robot.tree.inertia[1] == pytest.approx(MEANS[name], rel=1e-12)
    same_constants(robot)


@pytest.mark.parametrize("base", ["planar", "free-flyer"])
def test_they_are_balanced_as_mujoco_does(tmp_path, base):
    body = '<mujoco><worldbody><body name="b"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{}"/></body>'
    compiled = mujoco.MjModel.from_xml_string(
        body.format("0.004 0.013 0.005").replace("<worldbody>", '<compiler balanceinertia="true"/><worldbody>')
        + "</worldbody></mujoco>"
    )
    robot = fp.Robot.from_urdf(written(tmp_path, arm(FLAT)), balance_inertias=True, base=base)
    own = robot.joint_tree.links["b"].inertial.inertia
    assert np.linalg.eigvalsh(own) == pytest.approx(compiled.body_inertia[1], rel=1e-12)


def test_moments_without_a_positive_mean_are_refused_whatever_is_asked(tmp_path):
    path = written(tmp_path, arm('ixx="-0.01" ixy="0" ixz="0" iyy="0.004" iyz="0" izz="0.004"'))
    with pytest.raises(InputError, match="whose mean is not positive"):
        fp.Robot.from_urdf(path, balance_inertias=True)


def flight(robot):
    return fp.Problem(robot, fp.Posture(0.0, [0.1]), fp.Posture(0.3, [0.9]), fp.Flight(duration=0.5))


MJCF = """<mujoco model="m"><worldbody><body name="a"><freejoint/>
<inertial pos="0 0 0" mass="3" diaginertia="0.02 0.03 0.04"/>
<body name="b" pos="0.3 0 0"><joint name="j" axis="0 1 0" range="-90 90"/>
<inertial pos="0.1 0 0" mass="0.8" diaginertia="0.004 0.013 0.005"/><geom type="sphere" size="0.01"/>
</body></body></worldbody></mujoco>"""


def test_those_of_an_mjcf_are_balanced_by_mujoco(tmp_path):
    path = written(tmp_path, MJCF, "robot.xml")
    with pytest.raises(InputError, match=r"MuJoCo refuses it.*balance_inertias = true"):
        fp.Robot.from_mjcf(path)
    robot = fp.Robot.from_mjcf(path, balance_inertias=True)
    assert any(warning.startswith("balanced") and warning.endswith(": b") for warning in robot.warnings)
    assert robot.tree.inertia[1] == pytest.approx(0.022 / 3, rel=1e-12)
    same_constants(robot)


SOURCES = {"urdf": (arm(FLAT), "robot.urdf"), "mjcf": (MJCF, "robot.xml")}


@pytest.mark.parametrize("kind", SOURCES)
def test_a_payload_is_a_point_mass_of_its_link(tmp_path, kind):
    """Mass, centre and inertia are those of both, in a plane and in space, and what the certificate reads."""
    text, name = SOURCES[kind]
    path = written(tmp_path, text, name)
    payload = [{"link": "b", "mass": 0.6, "at": [0.05, 0.3, -0.1]}, fp.Payload("a", 1.5)]
    bare, laden = (fp.Robot.from_file(path, balance_inertias=True, payload=carried) for carried in (None, payload))
    assert laden.mass == pytest.approx(bare.mass + 2.1, rel=1e-12)
    before, after = bare.tree, laden.tree
    place = laden.frames["b"].local + complex(0.05, -0.1)
    center = (0.8 * before.center[1] + 0.6 * place) / 1.4
    moved = 0.8 * abs(before.center[1] - center) ** 2 + 0.6 * abs(place - center) ** 2
    assert after.center[1] == pytest.approx(center, rel=1e-12)
    assert after.inertia[1] == pytest.approx(before.inertia[1] + moved, rel=1e-12)
    same_constants(laden)
    in_space = fp.Robot.from_file(path, balance_inertias=True, payload=payload, base="free-flyer")
    assert in_space.mass == pytest.approx(laden.mass, rel=1e-12)
    assert laden.file_tree.links["b"].inertial.mass == pytest.approx(1.4, rel=1e-12)


WRONG_PAYLOADS = {
    "unknown link": ({"link": "z", "mass": 1.0}, 'no link is called "z"'),
    "no mass": ({"link": "a"}, "payload.mass: is missing"),
    "no weight": ({"link": "a", "mass": 0.0}, "payload.mass"),
    "negative": ({"link": "a", "mass": -1.0}, "payload.mass"),
    "too heavy": ({"link": "a", "mass": 1e8, "at": [1e5, 0, 0]}, "heavier than any robot's"),
    "a text": ("trunk", "payload"),
    "not a place": ({"link": "a", "mass": 1.0, "at": [0, 0]}, "payload.at"),
    "another key": ({"link": "a", "mass": 1.0, "place": [0, 0, 0]}, "unknown key"),
    "in a list": ([{"link": "a", "mass": 1.0}, {"link": "a", "mass": float("nan")}], r"payload\[1\].mass"),
}


@pytest.mark.parametrize("name", WRONG_PAYLOADS)
def test_a_wrong_payload_is_refused(tmp_path, name):
    payload, reason = WRONG_PAYLOADS[name]
    with pytest.raises(InputError, match=reason):
        fp.Robot.from_urdf(written(tmp_path, TWO_LINKS), payload=payload)


PROBLEM = """[robot]
urdf = "robot.urdf"
balance_inertias = true
payload = {payload}
[start]
orientation = 0
positions = [0.1]
[goal]
orientation = 0.3
positions = [0.9]
[flight]
duration = 0.5
"""
CARRIED = '{ link = "b", mass = 0.6, at = [0.05, 0, -0.1] }'


@pytest.mark.parametrize("form", ["{}", "[{}]"])
def test_problem_files_have_both_and_write_them_back(tmp_path, form):
    written(tmp_path, arm(FLAT))
    file = written(tmp_path, PROBLEM.format(payload=form.format(CARRIED)), "problem.toml")
    problem = fp.load_problem(file)
    assert problem.robot.payload == (fp.Payload("b", 0.6, (0.05, 0.0, -0.1)),)
    again = load_robot(save_problem(problem, tmp_path / "again.toml"))
    assert (again.balance_inertias, again.payload) == (True, problem.robot.payload)
    assert again.tree.coupling.tolist() == problem.robot.tree.coupling.tolist()


class TestPlans:
    @pytest.fixture
    def file(self, tmp_path):
        robot = fp.Robot.from_urdf(
            written(tmp_path, arm(FLAT)),
            balance_inertias=True,
            payload=[{"link": "b", "mass": 0.6, "at": [0.05, 0, -0.1]}, {"link": "a", "mass": 0.5}],
        )
        plan = fp.plan(flight(robot), prove=True)
        assert plan.certificate.proved
        return plan.save(tmp_path / "plan.json")

    def test_what_is_read_again_is_the_same_robot(self, file):
        plan = fp.load_plan(file)
        assert plan.robot.balance_inertias
        assert [each.mass for each in plan.robot.payload] == [0.6, 0.5]
        assert fp.certify(file).proved
        assert fp.replay(file).orientation_error < 1e-6
        assert fp.replay(file, engine="mujoco").orientation_error < 1e-6

    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("payload", None),
            ("payload", []),
            ("payload", [{"link": "b", "mass": 0.6, "at": [0.05, 0, -0.1]}]),
            (
                "payload",
                [{"link": "b", "mass": 0.61, "at": [0.05, 0, -0.1]}, {"link": "a", "mass": 0.5, "at": [0, 0, 0]}],
            ),
            (
                "payload",
                [{"link": "b", "mass": 0.6, "at": [0.05, 0, -0.12]}, {"link": "a", "mass": 0.5, "at": [0, 0, 0]}],
            ),
            (
                "payload",
                [{"link": "a", "mass": 0.6, "at": [0.05, 0, -0.1]}, {"link": "a", "mass": 0.5, "at": [0, 0, 0]}],
            ),
            ("balance_inertias", None),
            ("balance_inertias", False),
        ],
    )
    def test_another_robot_is_not_proved(self, file, key, value):
        content = json.loads(file.read_text())
        content["robot"][key] = value
        if value is None:
            del content["robot"][key]
        file.write_text(json.dumps(content))
        assert not fp.certify(file).proved


def test_the_command_line_takes_them(tmp_path, floatplan):
    path = written(tmp_path, arm(FLAT))
    assert floatplan("info", path).code == 2
    done = floatplan("info", path, "--balance-inertias", "--json")
    facts = json.loads(done.stdout)
    assert (done.code, facts["balance_inertias"], facts["payload"]) == (0, True, [])
    file = written(tmp_path, PROBLEM.format(payload=CARRIED), "problem.toml")
    shown = floatplan("info", file)
    assert "payload" in shown.stdout
    assert "0.6 kg on b at 0.05, 0, -0.1 m" in " ".join(shown.stdout.split())
    refused = floatplan("info", file, "--balance-inertias")
    assert refused.code == 2
    assert "--balance-inertias" in refused.stderr
    ends = ("--start", "0,0.1", "--goal", "0.3,0.9", "--duration", "0.5")
    planned = floatplan("plan", path, *ends, "--balance-inertias", "-o", tmp_path / "out", "--no-figures")
    assert planned.code == 0, planned.stderr
    assert json.loads((tmp_path / "out" / "plan.json").read_text())["robot"]["balance_inertias"] is True
    assert floatplan("certify", tmp_path / "out" / "plan.json").code == 0
    first = floatplan("init", path, "--balance-inertias", "-o", tmp_path / "first.toml")
    assert first.code == 0, first.stderr
    assert load_robot(tmp_path / "first.toml").balance_inertias
