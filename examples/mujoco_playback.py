"""Export to MuJoCo and playback: the plan's torques, in an engine that knows nothing of floatplan.

Needs ``mujoco``. MuJoCo reads the same URDF; a floating joint above its root link lets it fly. For a look at it, give
``model`` and ``data`` to ``mujoco.viewer.launch_passive`` and step as here.
"""

from pathlib import Path

import mujoco
import numpy as np

import floatplan as fp

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"
FLOATING = """
<link name="world"/>
<joint name="free" type="floating"><parent link="world"/><child link="{root}"/></joint>
</robot>"""

plan = fp.plan(fp.load_problem(PROBLEMS / "handstand.toml"))
motion = np.load(plan.export("mujoco", "handstand.npz"))

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
for torque in torques[:, order]:
    data.qfrc_applied[6:] = torque
    mujoco.mj_step(model, data)

landed, planned = data.qpos, np.append(motion["qpos"][-1, :7], motion["qpos"][-1, 7:][order])
print(f"joints land {np.abs(landed[7:] - planned[7:]).max():.1e} rad from the plan")
print(f"the base lands {np.linalg.norm(landed[:3] - planned[:3]):.1e} m from it")
