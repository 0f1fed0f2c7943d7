"""Files of recorded motions, as their readers have them: what is in each, and the same written back.

Every reader returns the :class:`Recording` of a file; whatever is missing, of the wrong shape or no number is refused
with its key. Joints have their names where a file has names, else they are in the order of the robot's own file, or
in the other order that fits the file's own bodies.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arguments import without
from floatplan.arrays import Array, BoolArray
from floatplan.clips.pickles import NUMBERS, read_pickle
from floatplan.errors import InputError
from floatplan.files import read_regular

LARGEST_CLIP = 500_000_000  # [bytes] of a file, and of what it holds when it is unpacked
MOST_FRAMES = 200_000  # [-] an hour at 50 Hz
MOST_COLUMNS = 1000  # [-] of a CSV


@dataclass(frozen=True)
class SensibleNumbers:
    """Between what the numbers of a motion are."""

    frames: int = 4  # [-] at least: fewer have no acceleration that differs from noise
    fps: tuple[float, float] = (1.0, 1e5)  # [Hz]
    position: float = 1e4  # [m] of the base
    joint: float = 1e3  # [rad] and of a rotation vector
    length: float = 0.1  # [-] that a quaternion's may be off 1: stored digits, not another number


SENSIBLE = SensibleNumbers()


@dataclass(frozen=True, eq=False)
class Recording:
    """The numbers of a file.

    Attributes
    ----------
    fps : Hz, or None where the file does not say it
    position : (N, 3) m, of the base
    quaternion : (N, 4)
        In the order of ``quaternion_order``.
    joints : (N, J) rad
    quaternion_order : "xyzw", "wxyz"; or "" where the file does not say it
    joint_names : (J,), or None where the file has none
    body_places : (N, B, 3) m, or None
        Of the robot's links in an order that tells that of the joints.
    body_quaternions : (N, B, 4) w, x, y, z, or None, of the same
    contact_names, contacts : (C,), (N, C) whether each stands; none where the file does not say it
    others : other values of the file that are written again, by key
    """

    position: Array
    quaternion: Array
    joints: Array
    fps: float | None
    quaternion_order: str
    joint_names: tuple[str, ...] | None = None
    body_places: Array | None = None
    body_quaternions: Array | None = None
    contact_names: tuple[str, ...] = ()
    contacts: BoolArray | None = None
    others: Mapping[str, Any] = field(default_factory=dict)


def read_recording(path: Path, name: str | None) -> tuple[str, Recording]:
    """Read a file of a format, or of the one that its name and its keys are those of.

    Raises
    ------
    InputError
        The file cannot be read, is of none of the formats, or has what is wrong for its format.
    """
    kind = path.suffix.lower()
    if name is not None and name not in READERS:
        listed = ", ".join(READERS)
        raise InputError(f'no format "{name}" is known', element="format", advice=f"formats: {listed}")
    content = read_regular(path, LARGEST_CLIP, "a recorded motion")
    if kind not in CONTENTS:
        reason = f'a recorded motion has no name that ends in "{kind}"'
        raise InputError(reason, advice="give .csv, .npz or .pkl")
    data = CONTENTS[kind](content)
    is_table = isinstance(data, np.ndarray)
    of_tables = "unitree-csv"
    name = name or (of_tables if is_table else _by_keys(data))
    if is_table != (name == of_tables):
        raise InputError(f'a file "*{path.suffix}" is not of the format {name}', element="format")
    recording = READERS[name](data)
    _check(recording)
    return name, recording


def _by_keys(data: Mapping[str, Any]) -> str:
    """The format that has such keys."""
    for name, keys in KEYS.items():
        if keys <= set(data):
            return name
    formats = "; ".join(f"{name}: {', '.join(sorted(keys))}" for name, keys in KEYS.items())
    listed = ", ".join(sorted(map(str, data))[:20])
    raise InputError(f"its keys ({listed}) are of no known format", advice=f"formats: {formats}")


def _csv_table(content: bytes) -> Array:
    """Rows of numbers, with or without one line of names; frames and columns are counted before any is read."""
    if content.count(b"\n") > MOST_FRAMES + 1:
        raise InputError(f"has more than {MOST_FRAMES} frames", advice="cut it into clips")
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError("is not a text file in UTF-8") from None
    lines = [line for line in lines if line.strip()]
    if max((line.count(",") for line in lines), default=0) >= MOST_COLUMNS:
        raise InputError(f"has more than {MOST_COLUMNS} columns")
    rows: list[list[float]] = []
    for number, line in enumerate(lines):
        try:
            rows.append([float(cell) for cell in line.split(",")])
        except ValueError:
            if number == 0:  # a line of names
                continue
            raise InputError(f"row {number + 1} is not numbers with commas between them") from None
    if not rows:
        raise InputError("has no frame")
    widths = {len(row) for row in rows}
    if len(widths) > 1:
        raise InputError(f"has rows of {min(widths)} and of {max(widths)} numbers")
    return np.array(rows)


def _archive(content: bytes) -> dict[str, Array]:
    """The arrays of a NumPy archive; nothing in it is run, and its size is checked before it is unpacked."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > LARGEST_CLIP:
            raise InputError(f"holds more than {LARGEST_CLIP // 1_000_000} MB", advice="cut it into clips")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except InputError:
        raise
    except MemoryError:
        raise InputError("asks for more memory than there is") from None
    except Exception as error:  # of zip files and of NumPy's headers: there are a dozen kinds
        raise InputError(f"cannot be read as a NumPy archive: {type(error).__name__}") from None


def _numbers(data: Mapping[str, Any], key: str, width: int | None = None) -> Array:
    """The table (N, width) of a key; refuse what is none."""
    if key not in data:
        raise InputError("is missing", element=key)
    try:
        values = np.asarray(data[key])
    except (ValueError, TypeError):  # lists of several lengths
        raise InputError("is not a table of numbers", element=key) from None
    if values.dtype.kind not in NUMBERS:
        raise InputError("is not a table of numbers", element=key)
    if values.ndim != 2 or (width is not None and values.shape[1] != width):
        expected = "(frames, columns)" if width is None else f"(frames, {width})"
        raise InputError(f"has the shape {values.shape}, not {expected}", element=key)
    return np.asarray(values, np.float64)


def _bodies(data: Mapping[str, Any], key: str, width: int) -> Array:
    """The table (N, B, width) of a key of bodies, with B at least 1."""
    values = np.asarray(data.get(key, np.empty(0)))
    if values.ndim != 3 or values.shape[1] < 1 or values.shape[2] != width or values.dtype.kind not in NUMBERS:
        raise InputError(f"has the shape {values.shape}, not (frames, bodies, {width})", element=key)
    return np.asarray(values, np.float64)


def _rate(data: Mapping[str, Any], key: str) -> float:
    """The frames a second of a key."""
    if key not in data:
        raise InputError("is missing", element=key)
    try:
        values = np.ravel(np.asarray(data[key]))
    except (ValueError, TypeError):  # lists of several lengths
        raise InputError("is not a number", element=key) from None
    if values.dtype.kind not in NUMBERS:
        raise InputError("is not a number", element=key)
    if len(values) != 1:
        raise InputError(f"has {len(values)} numbers, not one", element=key)
    return float(values[0])


def _texts(data: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """The names of a key."""
    try:
        values = np.ravel(np.asarray(data.get(key, [])))
    except (ValueError, TypeError):  # lists of several lengths
        raise InputError("is not a list of names", element=key) from None
    if values.dtype.kind != "U":
        raise InputError("is not a list of names", element=key)
    return tuple(values.tolist())


def _optional_names(data: Mapping[str, Any], key: str) -> tuple[str, ...] | None:
    """The names of a key that a file may have."""
    return None if data.get(key) is None else _texts(data, key)


def _contacts(data: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of contacts of a file: none where it does not name them."""
    if data.get("contacts") is None or data.get("contact_names") is None:
        return {}
    names = _texts(data, "contact_names")
    contacts = _numbers(data, "contacts", len(names))
    return {"contact_names": names, "contacts": contacts > 0}


def _unitree(table: Array) -> Recording:
    if table.shape[1] < 8:
        raise InputError(f"has {table.shape[1]} columns, not position, quaternion and joints: 8 at least")
    return Recording(
        position=table[:, :3], quaternion=table[:, 3:7], joints=table[:, 7:], fps=None, quaternion_order=""
    )


def _mjlab(data: Mapping[str, Any]) -> Recording:
    places = _bodies(data, "body_pos_w", 3)
    quaternions = _bodies(data, "body_quat_w", 4)
    if places.shape[:2] != quaternions.shape[:2]:
        raise InputError(
            f"is of {quaternions.shape[:2]} frames and bodies, body_pos_w of {places.shape[:2]}", element="body_quat_w"
        )
    names = {key: _optional_names(data, key) for key in ("joint_names", "body_names")}
    return Recording(
        position=places[:, 0],
        quaternion=quaternions[:, 0],
        joints=_numbers(data, "joint_pos"),
        fps=_rate(data, "fps"),
        quaternion_order="wxyz",
        joint_names=names["joint_names"],
        body_places=places,
        body_quaternions=quaternions,
        others={"fps_shape": np.shape(data["fps"]), **names},
        **_contacts(data),
    )


def _gmr(data: Mapping[str, Any]) -> Recording:
    others = {key: value for key, value in data.items() if isinstance(value, (str, int, float, list))}
    return Recording(
        position=_numbers(data, "root_pos", 3),
        quaternion=_numbers(data, "root_rot", 4),
        joints=_numbers(data, "dof_pos"),
        fps=_rate(data, "fps"),
        quaternion_order="xyzw",
        joint_names=_optional_names(data, "joint_names"),
        others=without(others, KEYS["gmr-pkl"] | {"contact_names", "contacts", "contact_forces"}),
        **_contacts(data),
    )


def _mimickit(data: Mapping[str, Any]) -> Recording:
    frames = _numbers(data, "frames")
    if frames.shape[1] < 7:
        reason = f"has {frames.shape[1]} columns, not position, rotation vector and joints: 7 at least"
        raise InputError(reason, element="frames")
    if not np.isfinite(frames[:, 3:6]).all() or np.abs(frames[:, 3:6]).max(initial=0.0) > SENSIBLE.joint:
        raise InputError("has a rotation vector that is none", element="frames")
    return Recording(
        position=frames[:, :3],
        quaternion=Rotation.from_rotvec(np.array(frames[:, 3:6])).as_quat(),  # of a copy: it may be read-only
        joints=frames[:, 6:],
        fps=_rate(data, "fps"),
        quaternion_order="xyzw",
        joint_names=_optional_names(data, "joint_names"),
        others={"loop_mode": 0} | {key: data[key] for key in ("loop_mode", "joint_names") if key in data},
        **_contacts(data),
    )


def _loco_mujoco(data: Mapping[str, Any]) -> Recording:
    qpos = _numbers(data, "qpos")
    names = _texts(data, "joint_names")
    types = np.ravel(data.get("jnt_type", np.empty(0)))
    if len(types) != len(names) or not len(types) or types[0] != 0 or (types[1:] == 0).any():
        reason = "does not begin with one free joint, and one number for each name"
        raise InputError(reason, element="jnt_type", advice="give a trajectory of a model whose base is a free joint")
    splits = np.ravel(data.get("split_points", np.array([0, len(qpos)]))).tolist()
    if splits != [0, len(qpos)]:
        reason = f"are {splits[:4]}, which is not one trajectory of {len(qpos)} frames"
        raise InputError(reason, element="split_points", advice="give a file of one")
    if qpos.shape[1] != 6 + len(names):
        reason = f"has {qpos.shape[1]} columns for {len(names)} joints: {6 + len(names)} are theirs"
        raise InputError(reason, element="qpos")
    return Recording(
        position=qpos[:, :3],
        quaternion=qpos[:, 3:7],
        joints=qpos[:, 7:],
        fps=_rate(data, "frequency"),
        quaternion_order="wxyz",
        joint_names=names[1:],
        others={"root": names[0], "jnt_type": types},
    )


def _isaac_amp(data: Mapping[str, Any]) -> Recording:
    places = _bodies(data, "body_positions", 3)
    quaternions = _bodies(data, "body_rotations", 4)
    bodies = _texts(data, "body_names")
    if places.shape[:2] != quaternions.shape[:2] or places.shape[1] != len(bodies):
        raise InputError(f"is of {places.shape[1]} bodies, body_names of {len(bodies)}", element="body_positions")
    if "contacts" in data and "contact_names" not in data:
        raise InputError("is missing", element="contact_names")
    return Recording(
        position=places[:, 0],
        quaternion=quaternions[:, 0],
        joints=_numbers(data, "dof_positions"),
        fps=_rate(data, "fps"),
        quaternion_order="wxyz",
        joint_names=_texts(data, "dof_names"),
        others={"body_names": bodies},
        **_contacts(data),
    )


def _pickled(content: bytes) -> dict[str, Any]:
    """What a pickle holds by its keys."""
    data = read_pickle(content)
    if not isinstance(data, dict):
        raise InputError("holds no dictionary", advice="give the file of one motion")
    return data


CONTENTS: Mapping[str, Callable[[bytes], Any]] = {  # how files are read, by how their names end
    ".csv": _csv_table,
    ".npz": _archive,
    ".pkl": _pickled,
    ".pickle": _pickled,
}
READERS: dict[str, Callable[[Any], Recording]] = {
    "unitree-csv": _unitree,
    "mjlab-npz": _mjlab,
    "gmr-pkl": _gmr,
    "mimickit-pkl": _mimickit,
    "loco-mujoco": _loco_mujoco,
    "isaac-amp": _isaac_amp,
}
KEYS: dict[str, set[str]] = {
    "mjlab-npz": {"fps", "joint_pos", "body_pos_w", "body_quat_w"},
    "loco-mujoco": {"qpos", "joint_names", "frequency"},
    "isaac-amp": {"fps", "dof_names", "dof_positions", "body_positions", "body_rotations"},
    "gmr-pkl": {"fps", "root_pos", "root_rot", "dof_pos"},
    "mimickit-pkl": {"fps", "frames"},
}


def _check(recording: Recording) -> None:
    """Refuse what cannot be a motion, whatever the format."""
    count = len(recording.position)
    for name in ("quaternion", "joints", "contacts"):
        values = getattr(recording, name)
        if values is not None and len(values) != count:
            raise InputError(f"has {len(values)} frames of its {name}, {count} of its position")
    if count < SENSIBLE.frames:
        raise InputError(f"has {count} frames", advice=f"give {SENSIBLE.frames} at least")
    if count > MOST_FRAMES:
        raise InputError(f"has {count} frames, more than {MOST_FRAMES}", advice="cut it into clips")
    limited = (
        ("place", recording.position, SENSIBLE.position),
        ("quaternion", recording.quaternion, 1.0 + SENSIBLE.length),
        ("joints", recording.joints, SENSIBLE.joint),
    )
    for name, values, largest in limited:
        wrong = ~(np.abs(values) <= largest)  # of what is no number too
        if wrong.any():
            frame, column = np.argwhere(wrong)[0].tolist()
            value = values[frame, column]
            raise InputError(f"the {name} of frame {frame} has {value:g} in its column {column}, no sensible number")
    length = np.linalg.norm(recording.quaternion, axis=1)
    wrong = np.abs(length - 1.0) > SENSIBLE.length
    if wrong.any():
        frame = int(np.flatnonzero(wrong)[0])
        raise InputError(f"the quaternion of frame {frame} has the length {length[frame]:.3g}, not 1")
    if recording.fps is not None:
        check_rate(recording.fps)


def check_rate(fps: float, element: str = "fps") -> None:
    """Refuse frames a second that are none."""
    low, high = SENSIBLE.fps
    if not (low <= fps <= high):
        raise InputError(f"{fps:g} frames a second are not between {low:g} and {high:g}", element=element)


def continuous_signs(quaternions: Array) -> Array:
    """Quaternions (N, 4) of unit length, none of which is of opposite sign to the one before."""
    signed = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    changes_sign = (signed[1:] * signed[:-1]).sum(axis=1) < 0
    signed[1:] *= np.cumprod(np.where(changes_sign, -1.0, 1.0))[:, None]
    return np.asarray(signed)
