"""Exports: each is read back by a reader that knows nothing of the plan, and gives the motion to 1e-9."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import floatplan as fp
from floatplan.errors import InputError
from floatplan.export.formats import FORMATS, export

HEADER = '<mujoco><compiler fusestatic="true" balanceinertia="false"/></mujoco>'


@pytest.fixture(params=["handstand", "coupled"])
def plan(request: pytest.FixtureRequest) -> fp.Plan:
    return request.getfixturevalue(request.param)


def test_mujoco_flies_from_the_exported_file(plan: fp.Plan, tmp_path: Path) -> None:
    """The URDF with a free joint, the file's first state, and its torques: it lands where the file ends."""
    with np.load(export(plan, "mujoco", tmp_path / "file")) as archive:
        content = dict(archive)
    model, order = free_model(plan, content["joint_names"].tolist())
    model.opt.gravity[:] = content["gravity"]
    duration = content["time"][-1]
    steps = round(duration / 1e-3)
    model.opt.timestep = duration / steps
    torques = CubicSpline(content["time"], content["ctrl"])
    data = mujoco.MjData(model)
    qpos, qvel = np.array([*range(7), *(7 + order)]), np.array([*range(6), *(6 + order)])
    data.qpos[qpos], data.qvel[qvel] = content["qpos"][0], content["qvel"][0]
    fly(model, data, lambda time: torques(time), 6 + order, steps)
    np.testing.assert_allclose(data.qpos[qpos], content["qpos"][-1], atol=1e-6)
    np.testing.assert_allclose(data.qvel[qvel], content["qvel"][-1], atol=1e-5)


def free_model(plan: fp.Plan, names: list[str]) -> tuple[Any, np.ndarray]:
    """The robot's URDF, free in space, for MuJoCo; and the place of each named joint among its joints."""
    root = plan.robot.layout.tree.root
    free = f'<link name="outside"/><joint name="free" type="floating"><parent link="outside"/><child link="{root}"/>'
    head, _, rest = plan.robot.xml.partition("<link")
    spec = mujoco.MjSpec.from_string(f"{head}{HEADER}{free}</joint><link{rest}")
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in spec.joints:
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    model = spec.compile()
    return model, np.array([model.jnt_qposadr[model.joint(name).id] - 7 for name in names])


def fly(model: Any, data: Any, torques: Callable[[float], np.ndarray], joints: np.ndarray, steps: int) -> None:
    def push(_: Any, now: Any) -> None:
        now.qfrc_applied[joints] = torques(now.time)

    mujoco.set_mjcb_control(push)
    try:
        mujoco.mj_step(model, data, nstep=steps)
    finally:
        mujoco.set_mjcb_control(None)


@pytest.mark.parametrize("form", [form for form in FORMATS if form != "unitree-sdk"])
def test_the_command_writes_beside_the_plan_or_where_told(
    floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path, form: str
) -> None:
    plan_file = handstand.save(tmp_path / "run" / "plan.json")
    run = floatplan("export", plan_file, "--format", form)
    assert run.code == 0, run
    assert Path(run.stdout.strip()) == plan_file.parent / FORMATS[form].file
    told = tmp_path / "elsewhere" / "file"
    assert floatplan("export", plan_file, "-f", form, "-o", told, "--rate", "100", "--quiet").stdout == ""
    assert told.stat().st_size > 0


def test_python_names_the_formats(handstand: fp.Plan) -> None:
    with pytest.raises(
        InputError,
        match="must be one of csv, csv-full, parquet, npz, pinocchio, mujoco, ros, mcap, unitree, unitree-sdk",
    ):
        export(handstand, "bvh")
