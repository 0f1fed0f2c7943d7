"""Playback in MuJoCo: the plan's torques, in an engine that knows nothing of floatplan.

Needs ``mujoco``. MuJoCo reads the same URDF; a floating joint above its root link lets it fly. For a look at it, give
``model`` and ``data`` to ``mujoco.viewer.launch_passive`` and step as here.
"""

import sys
from pathlib import Path

import matplotlib.style
import mujoco
import numpy as np
from matplotlib.figure import Figure

import floatplan as fp

HERE = Path(__file__).resolve().parent
OUT = Path(sys.argv[1] if sys.argv[1:] else "runs/mujoco_playback")
FLOATING = """
<link name="world"/>
<joint name="free" type="floating"><parent link="world"/><child link="{root}"/></joint>
</robot>"""

plan = fp.plan(fp.load_problem(HERE.parent / "problems" / "handstand.toml"))
with np.load(plan.export("mujoco", OUT / "handstand.npz")) as file:
    motion = dict(file)

assert plan.robot.path is not None
floating = FLOATING.format(root=plan.robot.layout.tree.root)
model = mujoco.MjModel.from_xml_string(plan.robot.path.read_text().replace("</robot>", floating))
model.opt.timestep = motion["time"][1] - motion["time"][0]
model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
model.opt.gravity = motion["gravity"]
names = [model.joint(index).name for index in range(1, model.njnt)]
order = [motion["joint_names"].tolist().index(name) for name in names]

data = mujoco.MjData(model)
data.qpos[:] = np.append(motion["qpos"][0, :7], motion["qpos"][0, 7:][order])
data.qvel[:] = np.append(motion["qvel"][0, :6], motion["qvel"][0, 6:][order])
torques = (motion["ctrl"][1:] + motion["ctrl"][:-1]) / 2
flown = [data.qpos.copy()]
for torque in torques[:, order]:
    data.qfrc_applied[6:] = torque
    mujoco.mj_step(model, data)
    flown.append(data.qpos.copy())

planned = np.concatenate((motion["qpos"][:, :7], motion["qpos"][:, 7:][:, order]), axis=1)
off = np.abs(np.array(flown) - planned)
print(f"joints land {off[-1, 7:].max():.1e} rad from the plan")
print(f"the base lands {np.linalg.norm(off[-1, :3]):.1e} m from it")

with matplotlib.style.context(HERE / "examples.mplstyle"):
    figure = Figure()
    joints, errors = figure.subplots(1, 2)
    for index, name in enumerate(names):
        joints.plot(motion["time"], np.degrees(np.array(flown)[:, 7 + index]), label=f"{name}, in MuJoCo")
        joints.plot(motion["time"], np.degrees(planned[:, 7 + index]), "k:", label="planned" if index else None)
    joints.set(xlabel="time (s)", ylabel="position (degrees)", xlim=(0, plan.duration))
    joints.legend()
    errors.semilogy(motion["time"][1:], off[1:, 7:].max(axis=1), label="joints (rad)")
    errors.semilogy(motion["time"][1:], np.linalg.norm(off[1:, :3], axis=1), label="place of the base (m)")
    errors.set(xlabel="time (s)", ylabel="off the plan", xlim=(0, plan.duration))
    errors.legend()
    figure.savefig(OUT / "mujoco_playback.png")
