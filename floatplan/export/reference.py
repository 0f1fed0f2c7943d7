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
from floatplan.export.frames import Frames, gmr_pickle, mimickit_pickle, mjlab_arrays
from floatplan.export.motion import Exported
from floatplan.export.table import archive, check_size, number_rows
from floatplan.motion.flight import free_flyer
from floatplan.plans.trajectory import frame_times


def isaac_amp_content(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive as the AMP motion loader of Isaac Lab reads it.

    ``fps``, ``dof_names``, ``body_names``; ``dof_positions``, ``dof_velocities`` (N, J) and the motions of bodies of
    :class:`Frames`. The loader ignores other arrays: ``dof_torques`` (N, J), the motors' own, and of a jump the
    contacts.

    Raises
    ------
    InputError
        The rate is no whole number.
    """
    if rate % 1:
        raise InputError(f"{rate} Hz is no whole number, as these files have it", element="rate", advice="round it")
    frames = _frames(motion, rate, motion.names.bodies)
    whole = motion.at(frame_times(motion.duration, rate))
    order = list(map(motion.joints.index, frames.joints))
    arrays = {
        "fps": np.int64(rate),
        "dof_names": np.array(frames.joints),
        "body_names": np.array(frames.bodies),
        "dof_positions": frames.positions,
        "dof_velocities": frames.velocities,
        "dof_torques": whole.motor_torques[:, order],
    }
    return archive(arrays | dict(frames.body_motions) | dict(frames.contacts))


def motion_csv_content(motion: Exported, rate: float) -> str:
    """Return CSV without a header: root link's position, quaternion x y z w, joints; no time, rows 1/rate apart."""
    frames = _frames(motion, rate)
    return number_rows(np.concatenate((frames.base_position, frames.base_quaternion, frames.positions), axis=1))


def motion_csv_extras(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive of what such a CSV cannot hold, at the same frames.

    ``fps``; ``joint_names`` (J,) and ``joint_velocities`` (N, J); ``base_linear_velocity``, of the root link's origin,
    and ``base_angular_velocity`` (N, 3), in the world; and the contacts of a jump.
    """
    frames = _frames(motion, rate)
    arrays = {
        "fps": np.float64(rate),
        "joint_names": np.array(frames.joints),
        "joint_velocities": frames.velocities,
        "base_linear_velocity": frames.body_motions["body_linear_velocities"][:, 0],
        "base_angular_velocity": frames.body_motions["body_angular_velocities"][:, 0],
    }
    return archive(arrays | dict(frames.contacts))


def contact_extras(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive of ``fps`` and the contacts of a jump, as of :class:`Frames`; nothing of a plan."""
    contacts = _contacts(motion, frame_times(motion.duration, rate))
    return archive({"fps": np.float64(rate)} | contacts) if contacts else b""


def mjlab_content(motion: Exported, rate: float) -> bytes:
    """Return NumPy's archive of :func:`mjlab_arrays`.

    Raises
    ------
    InputError
        A body of the reading model has no name, and may be any of the robot's links.
    """
    mjcf = motion.names.mjcf
    if mjcf is not None and np.count_nonzero(mjcf.compiled.body_rootid == mjcf.base.base) != len(motion.names.bodies):
        raise InputError("has a body without a name", source=mjcf.path, element="model", advice="name its bodies")
    return archive(mjlab_arrays(_frames(motion, rate, motion.names.bodies, motion.names.bodies[0])))


def gmr_content(motion: Exported, rate: float) -> bytes:
    """Return a pickle as GMR saves retargeted motions, :func:`gmr_pickle`, with ``joint_names``."""
    frames = _frames(motion, rate, motion.names.bodies, motion.names.bodies[0])
    return gmr_pickle(frames, {"joint_names": list(frames.joints)})


def mimickit_content(motion: Exported, rate: float) -> bytes:
    """Return a pickle as MimicKit saves motions, :func:`mimickit_pickle`, with ``joint_names``.

    ``loop_mode`` 0: the motion ends where it ends.

    Raises
    ------
    InputError
        A joint slides, or a body of the reading model has several joints: MimicKit reads three as a rotation vector.
    """
    tree = motion.robot.file_tree
    for name in motion.names.joints:
        if not tree.joint[name].turns:
            reason = "slides: MimicKit has hinges only"
            raise InputError(reason, source=motion.robot.source, element=f"joint {name}", advice="lock it in the model")
    mjcf = motion.names.mjcf
    if mjcf is not None:
        bodies = mjcf.compiled.jnt_bodyid[list(mjcf.joints.values())].tolist()
        several = [name for name, body in zip(mjcf.joints, bodies, strict=True) if bodies.count(body) > 1]
        if several:
            reason = f"has several joints in one body: {', '.join(several)}; MimicKit takes three for a rotation vector"
            raise InputError(reason, source=mjcf.path, element="model", advice="give each joint a body")
    frames = _frames(motion, rate, motion.names.bodies[:1], motion.names.bodies[0])
    return mimickit_pickle(frames, {"loop_mode": 0, "joint_names": list(frames.joints)})


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
    position = frames.body_motions["body_positions"][:, 0]
    quaternion = frames.body_motions["body_rotations"][:, 0]
    rotation = Rotation.from_quat(quaternion, scalar_first=True)
    spin = rotation.apply(frames.body_motions["body_angular_velocities"][:, 0], inverse=True)
    velocity = frames.body_motions["body_linear_velocities"][:, 0]
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
        "qpos": np.concatenate((base_qpos, frames.positions), axis=1),
        "qvel": np.concatenate((base_qvel, frames.velocities), axis=1),
        "split_points": np.array([0, len(position)]),
    }
    return archive(arrays)


def _to_world(motion: Exported) -> Any:
    """The rotation, a ``pinocchio.Quaternion``, from the plan's world to one whose z axis is up."""
    return pin.Quaternion.FromTwoVectors(motion.robot.up, np.array([0.0, 0.0, 1.0])).normalized()


def _contacts(motion: Exported, times: Array) -> dict[str, Any]:
    """The contacts of a jump at times (N,), s, as of :class:`Frames`; none of a motion without phases."""
    contacts = motion.contacts(times)
    if not contacts:
        return {}
    return {
        "contact_names": contacts["contact_names"],
        "contacts": contacts["contacts"],
        "contact_forces": contacts["forces"] @ _to_world(motion).matrix().T,
    }


def _frames(motion: Exported, rate: float, bodies: tuple[str, ...] = (), base: str = "") -> Frames:
    """Return N frames of the joints, of the base, and of the bodies of these names.

    The base is the link of that name, or else the root link; without names it is the only body.

    Raises
    ------
    InputError
        The rate is wrong, or gives one frame only.
    """
    times = frame_times(motion.duration, rate)
    base = base or motion.robot.file_tree.root
    names = bodies if base in bodies else (base, *bodies)
    if len(times) < 2:
        reason = f"{rate} Hz give one frame of a motion of {motion.duration} s"
        raise InputError(reason, element="rate", advice="give a higher rate")
    check_size(len(times), len(names), rate)
    whole = motion.at(times)
    flyer = free_flyer(motion.robot)
    rotation_to_world = _to_world(motion)
    q = flyer.configurations(whole)
    v = flyer.velocities(whole)
    q[:, :3] = q[:, :3] @ rotation_to_world.matrix().T
    q[:, 3:7] = (Rotation.from_quat(rotation_to_world.coeffs()) * Rotation.from_quat(q[:, 3:7])).as_quat()
    of_bodies = body_motions(flyer.model, names, q, v)
    order = list(map(motion.joints.index, motion.names.joints))
    root = names.index(base)
    written = bodies or names
    first = len(names) - len(written)
    return Frames(
        rate=rate,
        joints=motion.names.joints,
        positions=whole.positions[:, order],
        velocities=whole.velocities[:, order],
        base_position=of_bodies["body_positions"][:, root],
        base_quaternion=np.roll(of_bodies["body_rotations"][:, root], -1, axis=1),
        bodies=written,
        body_motions={name: values[:, first:] for name, values in of_bodies.items()},
        contacts=_contacts(motion, times),
    )


def body_motions(model: Any, names: tuple[str, ...], q: Array, v: Array) -> dict[str, Array]:
    """Motion of bodies of a free-flyer model, from its coordinates (N, nq) and (N, nv); see :class:`Frames`."""
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
