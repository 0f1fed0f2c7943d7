"""Reference motions for programs that learn from them: frames at k/rate, in a world whose z axis is up.

Joints and bodies are in the order of the model of the reading program, or else of the robot's own file. A body's
pose is that of its link's frame. World: the plan's, rotated by the least angle that brings its vertical to z.
"""

from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array
from floatplan.errors import InputError, naming
from floatplan.export.motion import Exported
from floatplan.export.table import archive, check_size, number_rows
from floatplan.motion.flight import free_flyer
from floatplan.plans.trajectory import frame_times


def isaac_amp_content(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive as the AMP motion loader of Isaac Lab reads it.

    ``fps``, ``dof_names``, ``body_names`` and the arrays of :func:`_frames`. The loader ignores other arrays:
    ``dof_torques``, and of a jump ``contact_names`` (C,), ``contacts`` (N, C), whether each stands,
    ``contact_forces`` (N, C, 3), N, in the world.

    Raises
    ------
    InputError
        The rate is no whole number.
    """
    if rate % 1:
        raise InputError(f"{rate} Hz is no whole number, as these files have it", element="rate", advice="round it")
    names = motion.names
    frames = _frames(motion, rate, motion.names.bodies)
    contacts = motion.contacts(frame_times(motion.duration, rate))
    if contacts:
        forces = contacts["forces"] @ _to_world(motion).matrix().T
        contacts = {
            "contact_names": contacts["contact_names"],
            "contacts": contacts["contacts"],
            "contact_forces": forces,
        }
    about = {"fps": np.int64(rate), "dof_names": np.array(names.joints), "body_names": np.array(names.bodies)}
    return archive(about | frames | contacts)


def motion_csv_content(motion: Exported, rate: float) -> str:
    """Return CSV without a header: root link's position, quaternion x y z w, joints; no time, rows 1/rate apart."""
    frames = _frames(motion, rate)
    quaternion = np.roll(frames["body_rotations"][:, 0], -1, axis=1)
    return number_rows(np.concatenate((frames["body_positions"][:, 0], quaternion, frames["dof_positions"]), axis=1))


def loco_mujoco_content(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive of a trajectory of LocoMuJoCo, whose loader refuses other keys than its own.

    ``joint_names``, ``jnt_type`` (1 + J,): the free joint, then the others; ``njnt``, ``frequency``; ``qpos``
    (N, 7 + J): position, quaternion w x y z, joints; ``qvel`` (N, 6 + J): velocity in the world, angular velocity in
    the body, joints; ``split_points``: where the trajectory begins and ends. Where the base of the reading model floats
    by joints that slide and rotate, these replace the free joint, with their own coordinates.

    Raises
    ------
    InputError
        The reading model does not float by joints with names, or not by such as reach the motion.
    """
    names = motion.names
    tree = motion.robot.file_tree
    by_joints = names.mjcf if names.floats_by_joints else None
    of_base = [names.root] if by_joints is None else by_joints.base.names
    if not all(of_base):
        reason = "has no free joint with a name, by which LocoMuJoCo finds it"
        advice = 'add <freejoint name="root"/>'
        raise InputError(reason, element="model", advice=advice)
    frames = _frames(motion, rate)
    position = frames["body_positions"][:, 0]
    quaternion = frames["body_rotations"][:, 0]
    rotation = Rotation.from_quat(quaternion, scalar_first=True)
    spin = rotation.apply(frames["body_angular_velocities"][:, 0], inverse=True)
    velocity = frames["body_linear_velocities"][:, 0]
    types = [0]  # MuJoCo's number of a free joint; 2 is a slide, 3 a hinge
    base_qpos = np.concatenate((position, quaternion), axis=1)
    base_qvel = np.concatenate((velocity, spin), axis=1)
    if by_joints is not None:
        with naming(by_joints.path):
            base_qpos, base_qvel = by_joints.base.coordinates(position, rotation, velocity, spin)
        types = by_joints.compiled.jnt_type[by_joints.base.numbers].tolist()
    types += [3 if tree.joint[name].turns else 2 for name in names.joints]
    arrays = {
        "joint_names": np.array([*of_base, *names.joints]),
        "jnt_type": np.array(types),
        "njnt": np.int64(len(of_base) + len(names.joints)),
        "frequency": np.float64(rate),
        "qpos": np.concatenate((base_qpos, frames["dof_positions"]), axis=1),
        "qvel": np.concatenate((base_qvel, frames["dof_velocities"]), axis=1),
        "split_points": np.array([0, len(position)]),
    }
    return archive(arrays)


def _to_world(motion: Exported) -> Any:
    """The rotation, a ``pinocchio.Quaternion``, from the plan's world to one whose z axis is up."""
    return pin.Quaternion.FromTwoVectors(motion.robot.up, np.array([0.0, 0.0, 1.0])).normalized()


def _frames(motion: Exported, rate: float, bodies: tuple[str, ...] = ()) -> dict[str, Array]:
    """Return N frames of the joints, and of the bodies of these names, or else of the root link.

    ``dof_positions``, ``dof_velocities``, ``dof_torques`` (N, J), rad, rad/s, N m (m, m/s, N where they slide), the
    motors' own; in the world ``body_positions``, ``body_linear_velocities``, ``body_angular_velocities`` (N, B, 3),
    and ``body_rotations`` (N, B, 4), w x y z, of unit length, and never of opposite sign to the frame before.

    Raises
    ------
    InputError
        The rate is wrong, or gives one frame only.
    """
    times = frame_times(motion.duration, rate)
    bodies = bodies or (motion.robot.file_tree.root,)
    if len(times) < 2:
        reason = f"{rate} Hz give one frame of a motion of {motion.duration} s"
        raise InputError(reason, element="rate", advice="give a higher rate")
    check_size(len(times), len(bodies), rate)
    whole = motion.at(times)
    flyer = free_flyer(motion.robot)
    rotation_to_world = _to_world(motion)
    q = flyer.configurations(whole)
    v = flyer.velocities(whole)
    q[:, :3] = q[:, :3] @ rotation_to_world.matrix().T
    q[:, 3:7] = (Rotation.from_quat(rotation_to_world.coeffs()) * Rotation.from_quat(q[:, 3:7])).as_quat()
    order = list(map(motion.joints.index, motion.names.joints))
    arrays = {
        "dof_positions": whole.positions[:, order],
        "dof_velocities": whole.velocities[:, order],
        "dof_torques": whole.motor_torques[:, order],
    }
    return arrays | body_motions(flyer.model, bodies, q, v)


def body_motions(model: Any, names: tuple[str, ...], q: Array, v: Array) -> dict[str, Array]:
    """Motion of bodies of a free-flyer model, from its coordinates (N, nq) and (N, nv); see :func:`_frames`."""
    data = model.createData()
    frames = [model.getFrameId(name, pin.FrameType.BODY) for name in names]
    positions, linear, angular = np.empty((3, len(q), len(names), 3))
    rotations = np.empty((len(q), len(names), 3, 3))
    for k, (configuration, velocity) in enumerate(zip(q, v, strict=True)):
        pin.forwardKinematics(model, data, configuration, velocity)
        for body, frame in enumerate(frames):
            placement = pin.updateFramePlacement(model, data, frame)
            twist = pin.getFrameVelocity(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            positions[k, body] = placement.translation
            rotations[k, body] = placement.rotation
            linear[k, body] = twist.linear
            angular[k, body] = twist.angular
    wxyz = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(*positions.shape[:2], 4)
    is_opposite = np.einsum("kbi,kbi->kb", wxyz[1:], wxyz[:-1]) < 0
    wxyz[1:] *= np.cumprod(np.where(is_opposite, -1.0, 1.0), axis=0)[:, :, None]
    velocities = {"body_linear_velocities": linear, "body_angular_velocities": angular}
    return {"body_positions": positions, "body_rotations": wxyz} | velocities
