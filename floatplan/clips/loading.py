"""A clip from a file and a robot: which column is which joint, how quaternions are written, how fast the frames go."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from floatplan.arguments import FINITE, many, optional, text
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.clips.clip import Clip, FileLayout
from floatplan.clips.formats import Recording, check_rate, continuous_signs, read_recording
from floatplan.errors import InputError, naming
from floatplan.export.model_names import own_names
from floatplan.motion.spatial.kinematics import body_poses
from floatplan.motion.spatial.rotations import of_quaternions
from floatplan.pool import one_thread
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.links import missing_meshes
from floatplan.tables import CHOICES


@one_thread
def load_clip(
    path: str | Path,
    *,
    model: str | Path | Robot,
    format: str | None = None,  # noqa: A002 - as the command has it
    fps: float | None = None,
    quaternion: str | None = None,
    feet: Sequence[str] | None = None,
    ground: float | None = None,
) -> Clip:
    """Read a recorded motion of a robot.

    Parameters
    ----------
    path : path
        A file of one of the formats ``unitree-csv``, ``mjlab-npz``, ``gmr-pkl``, ``mimickit-pkl``, ``loco-mujoco``,
        ``isaac-amp``.
    model : path, or Robot with a free base
        The URDF or MJCF of the robot.
    format : str, optional
        One of these; where left out, that of the file's name and keys.
    fps : float, optional
        Frames a second, Hz, of a file that does not say it; 30 where left out, which a remark says.
    quaternion : str, optional
        "xyzw" or "wxyz", in a CSV; where left out, that of both which leaves the feet on one level.
    feet : sequence of str, optional
        Links whose bodies are the feet; where left out, by their shapes.
    ground : float, optional
        Height of a level ground, m; where left out, by the feet that stand.

    Returns
    -------
    Clip
        See its ``flights``, and :func:`floatplan.check_clip`.

    Raises
    ------
    InputError
        The file or the model cannot be read, or the one is not a motion of the other: file, key and reason.
    """
    source = as_path(path, "path")
    for name, value in (("format", format), ("quaternion", quaternion)):
        optional(text)(value, name)
    optional(FINITE)(fps, "fps")
    optional(many(text, "names of links"))(feet, "feet")
    optional(FINITE)(ground, "ground")
    robot = model if isinstance(model, Robot) else Robot.from_file(model, base="free-flyer")
    if robot.base != "free-flyer":
        raise InputError("is a robot in a plane", element="model", advice='load it with base="free-flyer"')
    with naming(source):
        name, recording = read_recording(source, format)
        rate, of_rate = _rate(recording, fps)
        positions, joints, of_joints = _positions(robot, recording)
        _check_ranges(robot, positions)
        order, of_quaternion = _quaternion_order(recording, quaternion)
        clip = Clip(
            robot=robot,
            path=source,
            fps=rate,
            base_position=read_only(recording.position),
            base_quaternion=read_only(_xyzw(recording.quaternion, order or "xyzw")),
            positions=read_only(positions),
            layout=FileLayout(format=name, joints=joints, quaternion=order or "xyzw", others=recording.others),
            contacts=recording.contacts,
            contact_names=recording.contact_names,
            remarks=tuple(remark for remark in (_of_shapes(robot), of_rate, of_joints, of_quaternion) if remark),
            feet=None if feet is None else tuple(feet),
            ground_height=ground,
        )
        return clip if order else _with_likelier_order(clip, recording)


def _of_shapes(robot: Robot) -> str:
    """What is remarked of a model whose links have no collision shapes, or whose meshes are not there."""
    if any(link.collisions for link in robot.file_tree.links.values()):
        missing = missing_meshes(robot.file_tree, robot.path.parent)
        if not missing:
            return ""
        link, mesh = missing[0]
        others = f" and {len(missing) - 1} more are" if len(missing) > 1 else " is"
        return f"the mesh {mesh} of {link}{others} not found: lines between the joints are in place of it"
    return "the model has no collision shapes: what touches the ground is taken for lines between its joints"


def _rate(recording: Recording, fps: float | None) -> tuple[float, str]:
    """Frames a second, and what is remarked of it."""
    if fps is not None:
        check_rate(fps)
        if recording.fps is not None and abs(recording.fps - fps) > 1e-6 * fps:
            reason = f"the file says {recording.fps:g} frames a second, not {fps:g}"
            raise InputError(reason, element="fps", advice="leave it out")
        return float(fps), ""
    if recording.fps is not None:
        return recording.fps, ""
    usual = 30.0  # [Hz] of most files that do not say it
    return usual, f"the file does not say its frames a second: taken for {usual:g}; give fps where it is another"


def _positions(robot: Robot, recording: Recording) -> tuple[Array, tuple[str, ...], str]:
    """Positions (N, J) in the order of the robot's model, the names of the file's columns, and what is remarked.

    Raises
    ------
    InputError
        The file has other joints than the robot, or another number of them.
    """
    own = own_names(robot).joints
    width = recording.joints.shape[1]
    if recording.joint_names is not None:
        names = recording.joint_names
        lacking = [name for name in own if name not in names]
        unknown = [name for name in names if name not in own]
        if lacking or unknown or width != len(names):
            problems = [f"the robot has no joint {unknown[0]!r}"] if unknown else []
            problems += [f"the file has no joint {lacking[0]!r}"] if lacking else []
            problems += [f"it has {width} columns for {len(names)} names"] if width != len(names) else []
            raise InputError("; ".join(problems), advice="give the model of the robot that the file is of")
        return _in_order(names, recording.joints, robot.model_joints), names, ""
    if width != len(own):
        reason = f"has {width} joints, the model {len(own)}"
        raise InputError(reason, advice="give the model of the robot that the file is of")
    if recording.body_places is None:
        remark = "the file names no joints: taken in the order of the model's file"
        return _in_order(own, recording.joints, robot.model_joints), own, remark
    return _positions_by_bodies(robot, own, recording)


def _positions_by_bodies(
    robot: Robot, own: tuple[str, ...], recording: Recording
) -> tuple[Array, tuple[str, ...], str]:
    """The same of a file without names, by which order of joints its bodies are where it has them."""
    orders = {
        "the order of the model's file": own,
        "the order by levels of the tree, as PhysX has it": _by_levels(robot),
    }
    misfits = {}
    for words, names in orders.items():
        positions = _in_order(names, recording.joints, robot.model_joints)
        misfits[words] = _misfit(robot, recording, positions)
    best = min(misfits, key=lambda words: misfits[words])
    names = orders[best]
    remark = f"the file names no joints: taken in {best}"
    tolerance = 0.02  # [m] that a body may be from where the file has it
    if not misfits[best] < tolerance:
        remark += f", though no body of it fits the file's within {1e3 * tolerance:.0f} mm"
    return _in_order(names, recording.joints, robot.model_joints), names, remark


def _misfit(robot: Robot, recording: Recording, positions: Array) -> float:
    """How far the robot's joints are from the nearest of the file's bodies, m: rms over some frames."""
    bodies = recording.body_places
    assert bodies is not None, "the file has bodies"
    frames = np.unique(np.linspace(0, len(positions) - 1, 9).astype(np.int64))  # 9 tell the orders apart
    attitudes = of_quaternions(_xyzw(recording.quaternion[frames], recording.quaternion_order))
    poses = body_poses(robot, recording.position[frames], attitudes, positions[frames])
    apart = np.linalg.norm(bodies[frames][:, :, None] - poses.places[:, None, 1:], axis=3)
    return float(np.sqrt((apart.min(axis=1) ** 2).mean()))


def _by_levels(robot: Robot) -> tuple[str, ...]:
    """Joints in the order of the tree's levels: those nearest to the root first, each level in the file's order."""
    tree = robot.file_tree
    moving = own_names(robot).joints
    names: list[str] = []
    level = [tree.root]
    while level:
        joints = []
        for link in level:
            joints += [joint for joint in tree.joints if joint.parent == link]
        names += [joint.name for joint in joints if joint.name in moving]
        level = [joint.child for joint in joints]
    return tuple(names)


def _in_order(names: Sequence[str], positions: Array, order: Sequence[str]) -> Array:
    """Columns (N, J) of joints of these names in another order of theirs."""
    column = {name: number for number, name in enumerate(names)}
    return np.ascontiguousarray(positions[:, [column[name] for name in order]])


def _check_ranges(robot: Robot, positions: Array) -> None:
    """Refuse positions that no joint can have, as degrees are taken for radians."""
    tree = robot.file_tree
    for number, name in enumerate(robot.model_joints):
        joint = tree.joint[name]
        if not joint.turns or joint.lower is None or joint.upper is None:
            continue
        beyond = np.maximum(joint.lower - positions[:, number], positions[:, number] - joint.upper)
        if beyond.max() > 50.0:  # [rad] as of degrees read as radians
            reason = f"is {beyond.max():.3g} rad outside of its range in frame {int(beyond.argmax())}"
            raise InputError(reason, element=name, advice="give positions in radians, not in degrees")


def _quaternion_order(recording: Recording, order: str | None) -> tuple[str, str]:
    """The order of the quaternion's numbers, "" where neither file nor caller says it; and what is remarked of it."""
    if order is not None and order not in CHOICES["quaternion"]:
        raise InputError(f'"{order}" is no order of a quaternion', element="quaternion", advice="give xyzw or wxyz")
    of_format = recording.quaternion_order
    if order and of_format and order != of_format:
        raise InputError(f"the format has {of_format}, not {order}", element="quaternion", advice="leave it out")
    return order or of_format, ""


def _with_likelier_order(clip: Clip, recording: Recording) -> Clip:
    """The clip with its quaternions as x, y, z, w, unless only the other order leaves the feet on one level."""
    other = replace(clip, base_quaternion=read_only(_xyzw(recording.quaternion, "wxyz")))
    usual = _off_the_ground(clip)
    unusual = _off_the_ground(other)
    level = 0.05  # [m] that feet are off one level, of a robot that walks or hops
    if not (unusual < level and unusual < 0.5 * usual):
        remark = "the file does not say the order of its quaternions: taken as x, y, z, w, as is usual"
        return replace(clip, remarks=(*clip.remarks, remark))
    remark = "quaternions taken as w, x, y, z: with x, y, z, w it does not stand on its feet"
    return replace(other, layout=replace(clip.layout, quaternion="wxyz"), remarks=(*clip.remarks, remark))


def _off_the_ground(clip: Clip) -> float:
    """How far feet are from being what stands on one level, m.

    That is by how much the height of the lowest foot changes in the lower half of its heights, without the lowest
    tenth, and how far it usually is above the lowest of all other bodies. It is infinite where there seems to be no
    foot, as of a robot that a wrong order puts on its head.
    """
    try:
        scene = clip.scene
    except InputError:
        return math.inf
    lowest = scene.foot_heights.min(axis=1)
    low, high = np.percentile(lowest, [10, 50])
    above = lowest - scene.other_heights.min(axis=1, initial=np.inf)
    return float(high - low + max(np.median(above), 0.0))


def _xyzw(quaternions: Array, order: str) -> Array:
    """Quaternions (N, 4) x, y, z, w, of unit length and continuous signs."""
    return continuous_signs(quaternions if order == "xyzw" else np.roll(quaternions, -1, axis=1))
