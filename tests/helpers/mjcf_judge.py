"""A robot read from MJCF against MuJoCo's own functions: masses, kinematics, centre of mass, momentum."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from floatplan.robot import Robot
from floatplan.robot.mjcf.compiled import import_mujoco

import_mujoco()  # so that MuJoCo writes no log of its warnings
FREE, HINGE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE


class Judge:
    """The same file, compiled by MuJoCo."""

    def __init__(self, path: Path, robot: Robot, seed: int = 0) -> None:
        self.robot, self.rng = robot, np.random.default_rng(seed)
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.bodies = {self.name(body): body for body in range(1, self.model.nbody)}
        self.base = self.bodies[robot.file_tree.root]
        self.joints = {self.joint(number): number for number in range(self.model.njnt)}

    def name(self, body: int) -> str:
        return self.model.body(body).name or f"body{body}"

    def joint(self, number: int) -> str:
        return self.model.joint(number).name or f"{self.name(self.model.jnt_bodyid[number])}_joint"

    def mass(self) -> float:
        """Relative error of the mass."""
        mass = float(self.model.body_subtreemass[self.base])
        return abs(self.robot.mass - mass) / mass

    def kinematics(self) -> float:
        """Largest error of the bodies' frames in a random posture of all joints, m and of unit vectors."""
        model, data, positions = self.model, self.data, {}
        mujoco.mj_resetData(model, data)
        for name, number in self.joints.items():
            if model.jnt_bodyid[number] != self.base:
                data.qpos[model.jnt_qposadr[number]] = positions[name] = self.rng.uniform(-3, 3)
        mujoco.mj_kinematics(model, data)
        placements = self.robot.file_tree.placements(positions)
        rotation, place = data.xmat[self.base].reshape(3, 3), data.xpos[self.base]
        errors = [0.0]
        for name, body in self.bodies.items():
            if model.body_rootid[body] == self.base:
                found = placements[name]
                errors.append(abs(rotation @ found.rotation - data.xmat[body].reshape(3, 3)).max())
                errors.append(abs(place + rotation @ found.translation - data.xpos[body]).max())
        return float(max(errors))

    def momentum(self) -> tuple[float, float]:
        """Relative error of the angular momentum in a random state of the planned joints, and that of the CM, m."""
        robot, model, data = self.robot, self.model, self.data
        positions, rates = self.rng.uniform(-1, 1, (2, len(robot.joints)))
        q, v = np.array(robot.reference + robot.selection @ positions), np.array(robot.selection @ rates)
        q[2], v[2] = self.rng.uniform(-1, 1, 2)
        mujoco.mj_resetData(model, data)
        for name, position, rate in list(zip(robot.model.names[1:], q, v, strict=True))[3:]:
            data.qpos[model.jnt_qposadr[self.joints[name]]] = position
            data.qvel[model.jnt_dofadr[self.joints[name]]] = rate
        normal = np.array(robot.plane.normal)
        self._turn_base(normal, q[2], v[2])
        for function in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_subtreeVel):
            function(model, data)
        own = robot.model.createData()
        found = float(normal @ pin.computeCentroidalMomentum(robot.model, own, q, v).angular)
        true = float(normal @ data.subtree_angmom[self.base])
        pin.framesForwardKinematics(robot.model, own, q)
        root = own.oMf[robot.model.getFrameId(robot.file_tree.root, pin.FrameType.BODY)]
        turned = data.xmat[self.base].reshape(3, 3).T
        off = root.actInv(pin.centerOfMass(robot.model, own, q)) - turned @ (data.subtree_com - data.xpos)[self.base]
        return abs(found - true) / max(abs(true), 1e-3), float(abs(off).max())

    def _turn_base(self, normal: npt.NDArray[Any], angle: float, rate: float) -> None:
        model, data = self.model, self.data
        for number in np.flatnonzero(model.jnt_bodyid == self.base).tolist():
            first, degree = model.jnt_qposadr[number], model.jnt_dofadr[number]
            if model.jnt_type[number] == FREE:
                mujoco.mju_axisAngle2Quat(data.qpos[first + 3 : first + 7], normal, angle)
                data.qvel[degree + 3 : degree + 6] = rate * normal
            elif model.jnt_type[number] == HINGE:
                sign = np.sign(model.jnt_axis[number] @ normal)
                data.qpos[first] += sign * angle
                data.qvel[degree] = sign * rate
