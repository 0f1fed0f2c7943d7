"""MuJoCo's file is what the file of the robot takes: its actuators, its base's joints, in its order."""

import re

import mujoco
import numpy as np
import pytest
from long_cases import cases
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.errors import InputError
from floatplan.export.formats import export, read_notes

RATE = 1000.0
FREE = '<freejoint name="root"/>'
ROBOT = """
<mujoco>{before}<compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 1">{base}
  <geom type="box" size="0.1 0.1 0.15" mass="6"/>
  <body name="shin" pos="0 0 -0.15"><joint name="z_hip" axis="0 1 0" range="-2 2" {joint}/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.03" mass="1.5"/>
    <body name="foot" pos="0 0 -0.25"><joint name="a_ankle" axis="0 -1 0" range="-2 2"/>
      <geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.02" mass="0.6"/></body></body></body></worldbody>
  <actuator>{actuators}</actuator></mujoco>"""
ANKLE = '<motor name="m_ankle" joint="a_ankle" gear="2"/>'
ACTUATORS = {
    "motors of other gears": f'{ANKLE}<motor name="m_hip" joint="z_hip" gear="-7.5" ctrlrange="-9 9"/>',
    "a servo of positions": f'<position name="m_hip" joint="z_hip" kp="80" kv="2" gear="1.5"/>{ANKLE}',
    "a servo of rates": f'<velocity name="m_hip" joint="z_hip" kv="6"/>{ANKLE}',
    "position and rate": f'<position joint="z_hip" kp="60"/><velocity joint="z_hip" kv="3"/>{ANKLE}',
    "any bias": f'<general joint="z_hip" gainprm="-3" biastype="affine" biasprm="0.7 -5 0.2" gear="2"/>{ANKLE}',
    "two motors": f'{ANKLE}<motor joint="z_hip" gear="3" ctrlrange="-2 5"/><motor joint="z_hip" ctrlrange="-4 40"/>',
    "in its parent": f'<motor jointinparent="z_hip" gear="4"/>{ANKLE}',
}
LOSSES = 'damping="0.4" stiffness="3" springref="0.2"'


def model_file(folder, actuators="", *, base=FREE, name="robot.xml", **more):
    path = folder / name
    path.write_text(ROBOT.format(**({"before": "", "joint": ""} | more), base=base, actuators=actuators))
    return path


def plan_of(robot):
    start, goal = fp.Posture(0.1, {"z_hip": 0.2, "a_ankle": -0.3}), fp.Posture(2.0, {"z_hip": 0.9, "a_ankle": 0.5})
    start, goal = (
        fp.Posture(each.orientation, [dict(each.positions)[name] for name in robot.joints]) for each in (start, goal)
    )
    return fp.plan(fp.Problem(robot, start, goal, fp.Flight(duration=0.7)))


def content_of(path):
    with np.load(path) as archive:
        return dict(archive)


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    """Of the robot without actuators; robots with them move as it does."""
    return plan_of(fp.Robot.from_mjcf(model_file(tmp_path_factory.mktemp("robot"))))


def joint_torques(model, content, row):
    """What actuators, damping and springs give the joints of the file in MuJoCo, N m."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = (content[key][row] for key in ("qpos", "qvel", "ctrl"))
    mujoco.mj_forward(model, data)
    degrees = [model.joint(name).dofadr[0] for name in content["joint_names"].tolist()]
    return np.asarray(data.qfrc_actuator[degrees] + data.qfrc_passive[degrees])


@pytest.mark.parametrize("case", ACTUATORS)
@pytest.mark.parametrize("joint", ["", LOSSES])
def test_the_file_s_actuators_give_the_torques_of_the_plan(motion, tmp_path, case, joint):
    path = model_file(tmp_path, ACTUATORS[case], joint=joint)
    content = content_of(export(motion, "mujoco", tmp_path / "file.npz", RATE, model=path))
    model = mujoco.MjModel.from_xml_path(str(path))
    assert content["actuator_names"].tolist() == [model.actuator(k).name for k in range(model.nu)]
    assert content["joint_names"].tolist() == ["z_hip", "a_ankle"]  # Pinocchio has them by their names
    assert content["notes"].size == 0
    planned = {name: motion.at(content["time"]).motor_torques[:, k] for k, name in enumerate(motion.robot.motors)}
    for row in range(0, len(content["time"]), 50):
        torques = [planned[name][row] for name in content["joint_names"].tolist()]
        assert content["torque"][row] == pytest.approx(torques)
        assert joint_torques(model, content, row) == pytest.approx(content["torque"][row], abs=1e-9)


@pytest.mark.parametrize("case", ["motors of other gears", "a servo of positions", "position and rate"])
def test_flown_in_that_very_file_it_lands_as_planned(tmp_path, case):
    path = model_file(tmp_path, ACTUATORS[case], joint='damping="0.3"')
    plan = plan_of(fp.Robot.from_mjcf(path))
    content = content_of(export(plan, "mujoco", tmp_path / "file.npz", RATE))
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.gravity[:], model.opt.timestep = content["gravity"], 1 / RATE
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = content["qpos"][0], content["qvel"][0]
    for row in range(len(content["time"]) - 1):
        data.ctrl[:] = (content["ctrl"][row] + content["ctrl"][row + 1]) / 2
        mujoco.mj_step(model, data)
    assert data.qpos == pytest.approx(content["qpos"][-1], abs=2e-4)
    assert plan.at(plan.duration).positions[list(plan.robot.joints).index("z_hip")] == pytest.approx(
        data.qpos[7], abs=2e-4
    )


REFUSED = {
    "a muscle": '<muscle joint="z_hip" lengthrange="0 1"/>',
    "a damper": '<damper joint="z_hip" kv="2" ctrlrange="0 1"/>',
    "a filter": '<general joint="z_hip" dyntype="filter" dynprm="0.1"/>',
    "an integrator": '<intvelocity joint="z_hip" kp="2" actrange="-1 1"/>',
    "no gain": '<general joint="z_hip" gainprm="0"/>',
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_takes_no_torque_is_refused_by_its_name(motion, tmp_path, case):
    path = model_file(tmp_path, REFUSED[case].replace(" ", ' name="odd" ', 1) + ANKLE)
    with pytest.raises(InputError, match="no ctrl of it gives z_hip the torques of a motion") as refused:
        export(motion, "mujoco", tmp_path / "file.npz", model=path)
    assert (refused.value.source, refused.value.element) == (str(path), 'actuator "odd"')
    assert "--model" in str(refused.value)


NOTES = {
    "control that is clipped": (
        ANKLE + '<motor joint="z_hip" gear="5" ctrlrange="-0.01 0.01"/>',
        "z_hip takes .* clips",
    ),
    "force that is clipped": (ANKLE + '<position joint="z_hip" kp="9" forcerange="-0.1 0.1"/>', "z_hip takes .* clips"),
    "one direction": (ANKLE + '<motor joint="z_hip" ctrlrange="0 0.001"/>', "z_hip takes .* clips"),
    "no actuator": (ANKLE, r"no actuator gives these joints the torque that they take, N m: z_hip \("),
    "none at all": ("", "has no actuators; ctrl is the torque of each joint"),
    "one of the base": (f'<motor name="jet" site="s"/>{ACTUATORS["two motors"]}', "none of the robot's joints: jet"),
}


@pytest.mark.parametrize("case", NOTES)
def test_what_the_actuators_cannot_do_is_said(motion, tmp_path, floatplan, case):
    actuators, note = NOTES[case]
    path = model_file(tmp_path, actuators, base=f'{FREE}<site name="s"/>')
    file = export(motion, "mujoco", tmp_path / "file.npz", model=path)
    (said,) = read_notes(file)
    assert re.search(note, said)
    motion.save(tmp_path / "plan.json")
    run = floatplan("export", tmp_path / "plan.json", "-f", "mujoco", "--model", path)
    assert run.code == 0
    assert said in run.stderr.replace("\n", " ")


SLIDES = "".join(
    f'<joint name="t{axis}" type="slide" axis="{unit}"/>'
    for axis, unit in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
)


def hinges(order, more=""):
    units = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    return "".join(f'<joint name="r{k}" axis="{units[axis]}" {more}/>' for k, axis in enumerate(order))


BASES = {
    "slides and hinges": SLIDES + hinges("zxy", 'pos="0.1 0 0.2"'),
    "the turn is the middle one": SLIDES + hinges("xyz"),
    "Euler angles": SLIDES + hinges("yxy", 'ref="0.3"'),
    "hinges first": hinges("zxy") + SLIDES,
    "a ball": SLIDES + '<joint name="ball" type="ball" pos="0 0 0.1"/>',
    "in a plane": '<joint name="tx" type="slide" axis="1 0 0" ref="0.5"/><joint name="tz" type="slide" axis="0 0 1"/>'
    '<joint name="ry" axis="0 -1 0"/>',
}


@pytest.mark.parametrize("case", cases(BASES, {"the turn is the middle one", "hinges first"}))
def test_a_base_that_floats_by_joints_is_read_and_written_in_its_own_coordinates(motion, tmp_path, case):
    path = model_file(tmp_path, ACTUATORS["two motors"], base=BASES[case])
    robot = fp.Robot.from_mjcf(path)
    assert robot.tree.mass == pytest.approx(motion.robot.tree.mass)
    assert robot.tree.inertia == pytest.approx(motion.robot.tree.inertia)
    plan = plan_of(robot)
    content = content_of(export(plan, "mujoco", tmp_path / "file.npz", RATE))
    model, free = mujoco.MjModel.from_xml_path(str(path)), plan.full_motion(content["time"])
    assert content["qpos"].shape[1:] == (model.nq,)
    assert content["qvel"].shape[1:] == (model.nv,)
    data, twist = mujoco.MjData(model), np.zeros(6)
    for row in range(0, len(content["time"]), 25):
        data.qpos[:], data.qvel[:] = content["qpos"][row], content["qvel"][row]
        mujoco.mj_forward(model, data)
        assert data.body("trunk").xpos[[0, 2]] == pytest.approx(free.base_position[row, [0, 2]], abs=1e-9)
        turned = Rotation.from_quat(free.base_quaternion[row]).inv() * Rotation.from_quat(
            data.body("trunk").xquat, scalar_first=True
        )
        assert turned.magnitude() < 1e-7
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body("trunk").id, twist, 0)
        spin = Rotation.from_quat(free.base_quaternion[row]).apply(np.array(free.base_twist[row, 3:]))
        assert twist == pytest.approx([*spin, *free.base_velocity[row]], abs=1e-6)
    steps = np.abs(np.diff(content["qpos"], axis=0))
    assert steps.max() < 0.1  # no angle jumps, as from pi to -pi


def test_a_motion_that_such_a_base_does_not_reach_is_refused(motion, tmp_path):
    tilted = hinges("zxy").replace('"1 0 0"', '"1 0 1"')
    path = model_file(tmp_path, base=SLIDES + tilted, name="tilted.xml")
    with pytest.raises(InputError, match="neither at right angles nor the same") as refused:
        export(motion, "mujoco", tmp_path / "file.npz", model=path)
    assert "r0, r1, r2" in str(refused.value)
    sideways = BASES["in a plane"].replace('"1 0 0"', '"0 1 0"', 1).replace("0 -1 0", "1 0 0")
    path = model_file(tmp_path, base=sideways, name="sideways.xml")
    with pytest.raises(InputError, match="does not reach the motion"):
        export(motion, "mujoco", tmp_path / "file.npz", model=path)


def test_a_base_that_the_file_holds_has_a_note(tmp_path):
    plan = plan_of(fp.Robot.from_mjcf(model_file(tmp_path, ACTUATORS["two motors"], base="")))
    file = export(plan, "mujoco", tmp_path / "file.npz")
    assert "holds its base to the world" in read_notes(file)[0]
    assert content_of(file)["qpos"].shape[1] == 7 + 2


def test_gains_are_in_the_order_of_the_file(motion, tmp_path):
    kp = {"z_hip": 30.0, "a_ankle": 10.0}
    content = content_of(export(motion, "mujoco", tmp_path / "file.npz", kp=kp))
    assert dict(zip(content["joint_names"].tolist(), content["kp"].tolist(), strict=True)) == kp
