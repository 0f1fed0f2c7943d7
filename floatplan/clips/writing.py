"""A clip written in the format of the file that it was read from, with its columns; velocities are the clip's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from floatplan.arguments import without
from floatplan.arrays import Array
from floatplan.clips.clip import Clip
from floatplan.clips.flights import FOOT_CLEARANCE
from floatplan.clips.formats import Recording, read_recording
from floatplan.errors import InputError, naming
from floatplan.export.frames import Frames, gmr_pickle, mimickit_pickle, mjlab_arrays
from floatplan.export.reference import body_motions
from floatplan.export.table import archive, number_rows
from floatplan.files import write_atomically
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.robot.urdf.base import FREE_FLYER as BASE


def write_clip(clip: Clip, path: str | Path) -> Path:
    """Write a clip in the format of its file, at its own rate.

    Numbers are written so that they read back bit for bit. Formats with velocities have those of ``clip.velocities``,
    and of a clip without any those of the splines between its frames.

    Raises
    ------
    InputError
        The file that the clip was read from has bodies that are no links of the robot; or the new one cannot be
        written.
    """
    target = Path(path)
    with naming(clip.path):
        content = WRITERS[clip.layout.format](clip)
    write_atomically(target, content)
    return target


def _velocities(clip: Clip) -> Array:
    """Velocities (N, 6 + J) of Pinocchio's model, the base's in its own axes."""
    if clip.velocities is not None:
        return clip.velocities
    straight = CubicSpline(clip.times, np.concatenate((clip.base_position, clip.positions), axis=1))(clip.times, 1)
    rotations = Rotation.from_quat(clip.base_quaternion)
    angular = RotationSpline(clip.times, rotations)(clip.times, 1)
    linear = rotations.apply(straight[:, :3], inverse=True)
    return np.concatenate((linear, angular, straight[:, 3:]), axis=1)


def _joints(clip: Clip, values: Array) -> Array:
    """Columns (N, J) of the joints in the file's order, from the model's."""
    return np.ascontiguousarray(values[:, [clip.joints.index(name) for name in clip.layout.joints]])


def _quaternion(clip: Clip, order: str) -> Array:
    return clip.base_quaternion if order == "xyzw" else np.roll(clip.base_quaternion, 1, axis=1)


def _frames(clip: Clip, bodies: tuple[str, ...] = ()) -> Frames:
    """The frames of a clip, its joints in the file's order, with the motions of bodies of these names."""
    velocity = _velocities(clip)
    contacts = {}
    if clip.contacts is not None:
        contacts = {"contact_names": np.array(clip.contact_names), "contacts": clip.contacts}
    return Frames(
        rate=clip.fps,
        joints=clip.layout.joints,
        positions=_joints(clip, clip.positions),
        velocities=_joints(clip, velocity[:, BASE:]),
        base_position=clip.base_position,
        base_quaternion=clip.base_quaternion,
        bodies=bodies,
        body_motions=body_motions(clip.robot.model, bodies, clip.configurations, velocity) if bodies else {},
        contacts=contacts,
    )


def _unitree(clip: Clip) -> bytes:
    quaternion = _quaternion(clip, clip.layout.quaternion)
    return number_rows(np.concatenate((clip.base_position, quaternion, _joints(clip, clip.positions)), axis=1)).encode()


def _gmr(clip: Clip) -> bytes:
    bodies = clip.layout.others.get("link_body_list")
    bodies = bodies if isinstance(bodies, list) else []
    are_links = all(isinstance(name, str) and name in clip.robot.file_tree.links for name in bodies)
    return gmr_pickle(_frames(clip, tuple(bodies) if are_links else ()), clip.layout.others)


def _mimickit(clip: Clip) -> bytes:
    return mimickit_pickle(_frames(clip), clip.layout.others)


def _loco_mujoco(clip: Clip) -> bytes:
    others = clip.layout.others
    velocity = _velocities(clip)
    rotations = Rotation.from_quat(clip.base_quaternion)
    linear = rotations.apply(velocity[:, :3].copy())  # SciPy takes no read-only array here
    joint_rates = _joints(clip, velocity[:, BASE:])
    return archive(
        {
            "joint_names": np.array([others["root"], *clip.layout.joints]),
            "jnt_type": np.asarray(others["jnt_type"]),
            "njnt": np.int64(1 + len(clip.layout.joints)),
            "frequency": np.float64(clip.fps),
            "qpos": np.concatenate(
                (clip.base_position, _quaternion(clip, "wxyz"), _joints(clip, clip.positions)), axis=1
            ),
            "qvel": np.concatenate((linear, velocity[:, 3:BASE], joint_rates), axis=1),
            "split_points": np.array([0, clip.frames]),
        }
    )


def _isaac_amp(clip: Clip) -> bytes:
    frames = _frames(clip, tuple(clip.layout.others["body_names"]))
    names = clip.contact_names
    contacts = clip.contacts
    if contacts is None:
        names = clip.scene.foot_names
        contacts = clip.scene.foot_clearances(clip.times) < FOOT_CLEARANCE
    return archive(
        {
            "fps": np.int64(round(clip.fps)) if clip.fps == round(clip.fps) else np.float64(clip.fps),
            "dof_names": np.array(frames.joints),
            "body_names": np.array(frames.bodies),
            "dof_positions": frames.positions,
            "dof_velocities": frames.velocities,
            **frames.body_motions,
            "contact_names": np.array(names),
            "contacts": contacts,
        }
    )


def _mjlab(clip: Clip) -> bytes:
    others = clip.layout.others
    names = others.get("body_names")
    if not names or any(name not in clip.robot.file_tree.links for name in names):
        _, recording = read_recording(clip.path, clip.layout.format)
        names = _body_names(clip, recording)
    unnamed = [key for key in ("joint_names", "body_names") if not others.get(key)]
    arrays = without(mjlab_arrays(_frames(clip, names)), unnamed)
    return archive(arrays | {"fps": np.full(others.get("fps_shape", ()), clip.fps)})


def _body_names(clip: Clip, recording: Recording) -> tuple[str, ...]:
    """The links that a file's bodies are, by where they are in some of its frames.

    Raises
    ------
    InputError
        A body is at no link.
    """
    places = recording.body_places
    assert places is not None, "the format has bodies"
    robot = clip.robot
    links = list(robot.file_tree.links)
    columns = [robot.model_joints.index(name) for name in clip.layout.joints]
    frames = np.unique(np.linspace(0, len(places) - 1, 9).astype(np.int64))  # 9 tell the links apart
    positions = np.empty((len(frames), len(columns)))
    positions[:, columns] = recording.joints[frames]
    quaternions = np.roll(recording.quaternion[frames], -1, axis=1)
    q = np.concatenate((recording.position[frames], quaternions, positions), axis=1)
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    own = body_motions(robot.model, tuple(links), q, np.zeros((len(frames), robot.model.nv)))
    apart = np.linalg.norm(places[frames][:, :, None] - own["body_positions"][:, None], axis=3).mean(axis=0)
    turned = np.zeros_like(apart)
    if recording.body_quaternions is not None:
        theirs = of_quaternions(np.roll(recording.body_quaternions[frames[0]], -1, axis=1))
        ours = of_quaternions(np.roll(own["body_rotations"][0], -1, axis=1))
        cosines = (np.einsum("bij,lij->bl", theirs, ours) - 1.0) / 2.0
        # 0.1 m/rad tells links apart whose frames are at one point
        turned = 0.1 * np.arccos(np.clip(cosines, -1.0, 1.0))
    nearest = (apart + turned).argmin(axis=1)
    nearest[0] = links.index(robot.file_tree.root)
    off = apart[np.arange(len(nearest)), nearest]
    if off.max() > 0.02:  # [m] that a body of the file may be from its link
        body = int(off.argmax())
        reason = f"body {body} is {off[body]:.2g} m from every link of the model"
        raise InputError(reason, element="body_pos_w", advice="give the model that the file was made with")
    return tuple(links[number] for number in nearest)


WRITERS: dict[str, Callable[[Clip], bytes]] = {
    "unitree-csv": _unitree,
    "mjlab-npz": _mjlab,
    "gmr-pkl": _gmr,
    "mimickit-pkl": _mimickit,
    "loco-mujoco": _loco_mujoco,
    "isaac-amp": _isaac_amp,
}
