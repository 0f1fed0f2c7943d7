"""A controller for a backflip: it reads a jump's file, flips a Go2 in MuJoCo, with contact, and corrects it in the
air.

Needs `floatplan[jump,replay,robots]`. Two commands write what a controller needs; the loop in `fly` is the one that
runs on a robot, 500 times a second. Here a simulation stands in for sensors and motors: 5 % heavier than planned,
with rotors that nobody told the plan of.
"""

import subprocess
import sys
from math import atan2, degrees, nan, pi, remainder
from pathlib import Path
from xml.etree import ElementTree

import matplotlib.style
import mujoco
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
PROBLEM = HERE.parent / "problems" / "jumps" / "go2.toml"
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/fly_a_go2")
HEAVIER, ROTORS, FRICTION = 1.05, 0.0045, 0.8  # [-], [kg m^2] at the joints, [-]: planned for 1, 0 and 0.6
FOOT = 0.022  # [m] radius of the feet
STEP = 0.5e-3  # [s] of the simulation
CLEAR = 5e-3  # [m] of feet above the ground as planned: nothing that is measured below is of a free flight
AFTER = 1.0  # [s] that it is to stand at the end
TIPPED = 30.0  # [degrees] of the trunk: no more is standing

FILES = {name: str(OUT / name) for name in ("jump.json", "plan.json", "trajectory.npz")}
EXPORT = ["export", FILES["jump.json"], "-f", "npz", "--rate", "500", "-o", FILES["trajectory.npz"], "-q"]
for words in (["jump", str(PROBLEM), "-o", str(OUT), "-q"], EXPORT):
    subprocess.run([sys.executable, "-m", "floatplan", *words], check=True)
with np.load(FILES["trajectory.npz"], allow_pickle=False) as file:
    jump = dict(file)
plan = fp.load_plan(FILES["plan.json"])  # of the jump's flight
robot, normal, up = plan.robot, plan.robot.plane.normal, plan.robot.plane.vertical
names, feet = jump["joint_names"].tolist(), jump["contact_names"].tolist()
in_flight = ~jump["contacts"].any(axis=1)
flight = int(jump["phase"][in_flight][0])
takeoff, touchdown = jump["phase_begin"][flight : flight + 2]


def on_the_ground() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The URDF's links and joints on a free base, with spheres for feet, where the jump begins."""
    urdf = ElementTree.fromstring(robot.xml)
    for link in urdf.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    ElementTree.SubElement(ElementTree.SubElement(urdf, "mujoco"), "compiler", fusestatic="false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(urdf, encoding="unicode"))
    spec.option.timestep, spec.option.gravity = STEP, jump["gravity"]
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10
    for joint in spec.joints:
        joint.armature = ROTORS
    spec.body(robot.layout.tree.root).add_freejoint()
    touching = {"friction": [FRICTION, 0, 0], "solref": [4e-3, 1]}
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], zaxis=up, **touching)
    for foot in feet:
        spec.body(foot).add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[FOOT, 0, 0], contype=0, **touching)
    model = spec.compile()
    model.body_mass[:] *= HEAVIER
    model.body_inertia[:] *= HEAVIER
    data = mujoco.MjData(model)
    data.qpos[:3] -= lowest_foot(model, data, 0) * up
    return model, data


def lowest_foot(model: mujoco.MjModel, data: mujoco.MjData, row: int) -> float:
    """Place the robot as the jump's file says, and return how high its lowest foot is, m."""
    data.qpos[:7] = jump["q"][row, [0, 1, 2, 6, 3, 4, 5]]
    data.qpos[[model.joint(name).qposadr[0] for name in names]] = jump["q"][row, 7:]
    mujoco.mj_kinematics(model, data)
    return min(float(data.body(foot).xpos @ up) for foot in feet) - FOOT


def fly(correct: bool) -> tuple[float, bool, np.ndarray]:
    """Fly with or without: by how much touchdown is off, degrees, whether it stands, and its pitch, degrees."""
    model, data = on_the_ground()
    heights = [lowest_foot(model, mujoco.MjData(model), row) for row in range(len(jump["time"]))]
    is_clear = np.array(heights) - heights[0] > CLEAR
    places, rates = ([getattr(model.joint(name), key)[0] for name in names] for key in ("qposadr", "dofadr"))
    weakest, strongest = model.jnt_actfrcrange[[model.joint(name).id for name in names]].T
    planned, motors = ([names.index(name) for name in which] for which in (robot.joints, robot.motors))
    replanner, missed, period, pitches = fp.Replanner(plan, rate=250), nan, jump["time"][1], []
    for tick in range(round((jump["time"][-1] + AFTER) / period)):
        row, t = min(tick, len(jump["time"]) - 1), tick * period - takeoff
        q, v, torques = (jump[name][row, -len(names) :].copy() for name in ("q", "v", "tau"))
        positions, velocities = data.qpos[places], data.qvel[rates]
        pitch, pitch_rate = 2 * atan2(data.qpos[4:7] @ normal, data.qpos[3]), data.qvel[3:6] @ normal
        pitches.append(pitch)
        if np.isnan(missed) and t >= touchdown - takeoff:
            missed = abs(degrees(remainder(pitch - plan.problem.final.orientation, 2 * pi)))
        if correct and in_flight[row]:
            if is_clear[row]:
                replanner.update(t, pitch, pitch_rate, positions[planned], velocities[planned])
            reference = replanner.reference(t)
            q[motors], v[motors] = robot.motor_ratios @ reference.positions, robot.motor_ratios @ reference.velocities
            torques[motors] = reference.motors
        torques += jump["kp"] * (q - positions) + jump["kd"] * (v - velocities)
        data.qfrc_applied[rates] = np.clip(torques, weakest, strongest)
        mujoco.mj_step(model, data, nstep=round(period / STEP))
    return missed, abs(degrees(remainder(pitch, 2 * pi))) < TIPPED, np.degrees(np.unwrap(pitches))


base = jump["q"][:, 3:7]
planned = np.degrees(np.unwrap(2 * np.arctan2(base[:, :3] @ normal, base[:, 3])))
with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure()
    axes = figure.subplots()
    axes.axvspan(takeoff, touchdown, color="#ebebeb", label="planned to be in the air")
    for way, correct, line in (("as planned", False, "--"), ("corrected", True, "-")):
        missed, stands, pitch = fly(correct)
        print(f"{way}: {missed:.1f} degrees off at touchdown, and {'stands' if stands else 'falls'}")
        label = f"{way}: {'stands' if stands else 'falls'} in the end"
        axes.plot(jump["time"], pitch[: len(planned)] - planned, line, label=label)
    axes.set(xlabel="time (s)", ylabel="trunk, off the plan (degrees)", xlim=(0, jump["time"][-1]))
    axes.legend()
    figure.savefig(OUT / "fly_a_go2.png")
