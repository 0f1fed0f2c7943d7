"""An MJCF says which way gravity points, and its base may float by joints; turned inertias of any size are read."""

from types import SimpleNamespace

import numpy as np
import pytest

import floatplan as fp
from floatplan.errors import InputError
from floatplan.robot.mjcf import compiled

UNITS = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
BESIDE = {"x": "0 0.08 0.1", "y": "0.08 0 0.1", "z": "0.08 0.1 0"}  # in the plane of the turn


def robot_file(folder, axes, gravity="", quat="1 0 0 0", base="<freejoint/>"):
    """A robot with an arm about each of these axes."""
    arms = "".join(
        f'<body name="arm{k}"><joint name="j{k}" axis="{UNITS[axis]}" range="-1 1"/>'
        f'<inertial pos="{BESIDE[axis]}" mass="1" diaginertia="0.02 0.03 0.025"/><geom size="0.03"/></body>'
        for k, axis in enumerate(axes)
    )
    path = folder / "robot.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/>{gravity}<worldbody><body name="base" quat="{quat}">{base}'
        f'<geom type="box" size="0.1 0.12 0.15" mass="4"/>{arms}</body></worldbody></mujoco>'
    )
    return path


def option(gravity):
    return f'<option gravity="{gravity}"/>'


TURNED = "0.7071067811865476 0.7071067811865476 0 0"  # by 90 degrees about x: the base's y axis is up
PLANES = {  # axes of joints, gravity, orientation of the base: gravity in its axes, the plane
    "z by default": ("yyx", "", "1 0 0 0", (0, 0, -1), "xz"),
    "hips about the vertical count for nothing": ("zzy", option("0 0 -9.81"), "1 0 0 0", (0, 0, -1), "xz"),
    "a vertical that is x": ("yyz", option("-3 0 0"), "1 0 0 0", (-1, 0, 0), "zx"),
    "a vertical that is y": ("xxy", option("0 -9.81 0"), "1 0 0 0", (0, -1, 0), "zy"),
    "a base that is turned": ("zzx", "", TURNED, (0, -1, 0), "xy"),
    "no gravity": ("zzy", option("0 0 0"), "1 0 0 0", None, "xy"),
    "gravity that is switched off": ("zzy", '<option><flag gravity="disable"/></option>', "1 0 0 0", None, "xy"),
}


@pytest.mark.parametrize("case", PLANES)
def test_the_plane_s_vertical_is_along_the_file_s_gravity(tmp_path, case):
    axes, gravity, quat, direction, plane = PLANES[case]
    robot = fp.Robot.from_mjcf(robot_file(tmp_path, axes, gravity, quat))
    assert robot.plane.name == plane
    assert not any("gravity" in warning for warning in robot.warnings)
    if direction is None:
        assert robot.gravity_direction is None
    else:
        assert robot.gravity_direction == pytest.approx(direction)
        assert robot.up == pytest.approx(-robot.gravity_direction)


def test_as_many_about_two_axes_of_which_one_is_vertical(tmp_path):
    assert fp.Robot.from_mjcf(robot_file(tmp_path, "zy")).plane.name == "xz"
    with pytest.raises(InputError, match=r'give plane="zx" or plane="yx"|give plane="yx" or plane="zx"'):
        fp.Robot.from_mjcf(robot_file(tmp_path, "zy", option("1 0 0")))


CONTRADICTIONS = {
    "all turn about the vertical": ({"axes": "zz"}, {}, (0, 0, -1)),
    "upwards": ({"axes": "yy", "gravity": option("0 0 9.81")}, {}, (0, 0, 1)),
    "a plane of the user": ({"axes": "yyz"}, {"plane": "xy"}, (0, 0, -1)),
    "space, where z is up": ({"axes": "yyz", "gravity": option("0 -2 0")}, {"base": "free-flyer"}, (0, -1, 0)),
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_a_plan_whose_gravity_is_not_the_file_s_has_a_warning(tmp_path, floatplan, case):
    given, choices, direction = CONTRADICTIONS[case]
    robot = fp.Robot.from_mjcf(robot_file(tmp_path, **given), **choices)
    along = ", ".join(f"{each:g}" for each in direction)
    (warning,) = [each for each in robot.warnings if "gravity" in each]
    assert f"the file's gravity points along ({along}) in the root link's axes" in warning
    if robot.in_plane is None:
        return
    zero = np.zeros(len(robot.joints))
    ends = fp.Posture(0.0, zero), fp.Posture(0.3, zero + 0.4)
    plan = fp.plan(fp.Problem(robot, *ends, fp.Flight(duration=0.6)))
    (said,) = [each for each in plan.warnings if each.kind == "gravity"]
    assert (said.subject, said.unit) == ("base", "rad")
    assert said.value > said.limit == pytest.approx(np.pi / 4)
    floating = fp.plan(fp.Problem(robot, *ends, fp.Flight(duration=0.6, gravity=0.0)))
    assert "gravity" not in [each.kind for each in floating.warnings]
    shown = floatplan("info", robot.path, *(("--plane", choices["plane"]) if choices else ()))
    assert "contradict each other" in " ".join(shown.stdout.split())


SLIDES = "".join(f'<joint name="t{axis}" type="slide" axis="{unit}"/>' for axis, unit in UNITS.items())
HINGES = "".join(f'<joint name="r{axis}" axis="{UNITS[axis]}"/>' for axis in "zxy")
HELD = {
    "two slides along one axis": SLIDES.replace(UNITS["z"], UNITS["y"]) + HINGES,
    "two turns about one axis": SLIDES + HINGES.replace(UNITS["x"], UNITS["z"]),
    "five joints": SLIDES + HINGES.replace('<joint name="ry" axis="0 1 0"/>', ""),
    "four slides and two turns": SLIDES + SLIDES.split("/>")[0].replace("tx", "t") + "/>" + HINGES.split("/>", 1)[1],
    "a ball that cannot slide": '<joint name="b" type="ball"/>',
    "a turn in the plane of the slides": "/>".join(SLIDES.split("/>")[:2]) + '/><joint name="c" axis="1 0 0"/>',
}
FLOATS = {
    "hinges": SLIDES + HINGES,
    "hinges first": HINGES + SLIDES,
    "a ball": SLIDES + '<joint name="b" type="ball"/>',
}


@pytest.mark.parametrize("case", FLOATS)
@pytest.mark.parametrize("base", ["planar", "free-flyer"])
def test_six_independent_joints_are_a_free_base(tmp_path, case, base):
    robot = fp.Robot.from_mjcf(robot_file(tmp_path, "yy", base=FLOATS[case]), base=base)
    alone = fp.Robot.from_mjcf(robot_file(tmp_path, "yy"), base=base)
    (warning,) = robot.warnings
    assert warning.startswith("read as the free base: ")
    assert robot.xml == alone.xml
    zero = np.zeros(2)
    if base == "planar":
        plan = fp.plan(fp.Problem(robot, fp.Posture(0.0, zero), fp.Posture(0.2, zero + 0.4), fp.Flight(duration=0.5)))
        robot_file(tmp_path, "yy", base=FLOATS[case])
        assert fp.certify(plan).proved


@pytest.mark.parametrize("case", HELD)
def test_other_joints_hold_the_base(tmp_path, case):
    with pytest.raises(
        InputError, match="which do not let it move freely, in a plane or in space; let it have"
    ) as held:
        fp.Robot.from_mjcf(robot_file(tmp_path, "yy", base=HELD[case]))
    assert held.value.element == 'body "base"'


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e4, 1e8])
def test_turned_inertias_of_any_size_are_read(tmp_path, size):
    """What rounding leaves unsymmetric of them grows with them."""
    path = robot_file(tmp_path, "yy", quat="0.3 0.5 -0.7 0.2")
    moments = " ".join(map(str, size * np.array([3.1, 4.3, 5.7])))
    inertial = f'<inertial pos="0 0.1 0" quat="1 0.3 0.2 0.1" mass="{1 + size}" diaginertia="{moments}"/>'
    path.write_text(
        path.read_text().replace('diaginertia="0.02 0.03 0.025"/>', 'diaginertia="0.02 0.03 0.025" quat="1 2 3 4"/>')
    )
    path.write_text(path.read_text().replace('<geom type="box"', f'{inertial}<geom type="box"'))
    robot = fp.Robot.from_mjcf(path)
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(robot.xml)
    for each in (robot, fp.Robot.from_urdf(urdf), fp.Robot.from_urdf(urdf, base="free-flyer")):
        for inertia in each.model.inertias:
            assert (inertia.inertia == inertia.inertia.T).all()
    payload = {"link": "base", "mass": size, "at": [0.3, 0.1, -0.2]}
    assert fp.Robot.from_mjcf(path, payload=payload).mass == pytest.approx(robot.mass + size)


def test_a_version_of_mujoco_that_is_wrong_is_refused_where_it_simulates(monkeypatch, tmp_path):
    broken = SimpleNamespace(__version__="4.0.0", get_mju_user_warning=lambda: print)
    monkeypatch.setattr(compiled, "import_optional", lambda *_, **__: broken)
    with pytest.raises(InputError, match=r"MuJoCo 4\.0\.0 computes wrong accelerations under contacts; install it"):
        compiled.import_mujoco()
    broken.__version__ = "4.0.1"
    assert compiled.import_mujoco() is broken
    assert fp.Robot.from_mjcf(robot_file(tmp_path, "y")).joints == ("j0",)  # compiling is right in all
