"""Clips for tests: a small robot with two legs that hops with its legs held, and files of it in every format."""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
GRAVITY = 9.81
FOOT = 0.02  # [m] radius
REST = 0.4  # [s] before and after a hop
JOINTS = ("l_hip", "l_knee", "r_hip", "r_knee")  # as the file has them: one leg, then the other
BY_LEVELS = ("l_hip", "r_hip", "l_knee", "r_knee")
STANDING = {"l_hip": 0.5, "l_knee": -1.0, "r_hip": -0.5, "r_knee": 1.0}
POSTURE = np.array([STANDING[name] for name in JOINTS])


def _link(name: str, mass: float, shape: str, place: str) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/>'
        f'<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="{place}"/><geometry>{shape}</geometry></collision></link>'
    )


def _joint(name: str, parent: str, child: str, place: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
        '<axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="50" velocity="20"/></joint>'
    )


def robot_text() -> str:
    """URDF of a base with two legs of two links, whose feet are balls."""
    parts = [_link("base", 5.0, '<box size="0.2 0.2 0.1"/>', "0 0 0")]
    for side, y in (("l", 0.1), ("r", -0.1)):
        parts.append(_link(f"{side}_thigh", 0.5, '<box size="0.03 0.03 0.1"/>', "0 0 -0.1"))
        parts.append(_link(f"{side}_shank", 0.3, f'<sphere radius="{FOOT}"/>', "0 0 -0.2"))
        parts.append(_joint(f"{side}_hip", "base", f"{side}_thigh", f"0 {y} -0.05"))
        parts.append(_joint(f"{side}_knee", f"{side}_thigh", f"{side}_shank", "0 0 -0.2"))
    return f'<robot name="hopper">{"".join(parts)}</robot>'


def mjcf_text() -> str:
    """The same robot in MJCF."""
    legs = ""
    for side, y in (("l", 0.1), ("r", -0.1)):
        hinge = 'axis="0 1 0" range="-2.5 2.5" limited="true" damping="0"'
        legs += (
            f'<body name="{side}_thigh" pos="0 {y} -0.05"><joint name="{side}_hip" {hinge}/>'
            '<inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.02 0.02 0.02"/>'
            '<geom type="box" size="0.015 0.015 0.05" pos="0 0 -0.1"/>'
            f'<body name="{side}_shank" pos="0 0 -0.2"><joint name="{side}_knee" {hinge}/>'
            '<inertial pos="0 0 -0.2" mass="0.3" diaginertia="0.02 0.02 0.02"/>'
            f'<geom type="sphere" size="{FOOT}" pos="0 0 -0.2"/></body></body>'
        )
    return (
        '<mujoco model="hopper"><compiler angle="radian"/><worldbody><body name="base"><freejoint/>'
        '<inertial pos="0 0 0" mass="5" diaginertia="0.02 0.02 0.02"/><geom type="box" size="0.1 0.1 0.05"/>'
        f"{legs}</body></worldbody></mujoco>"
    )


def lowest(posture: Array) -> float:
    """Height of the lower foot's lowest point, m, where the base is level at height 0."""
    heights = []
    for hip, knee in (posture[:2], posture[2:]):
        heights.append(-0.05 - 0.2 * np.cos(hip) - 0.2 * np.cos(hip + knee) - FOOT)
    return float(min(heights))


@dataclass(frozen=True, eq=False)
class Sample:
    """A motion: places (N, 3), attitudes (N), joints (N, 4) in the order of JOINTS, at a rate, Hz."""

    places: Array
    attitudes: Rotation
    joints: Array
    fps: float

    @property
    def frames(self) -> int:
        """Their number N."""
        return len(self.places)

    def ordered(self, names: Sequence[str]) -> Array:
        """Joints (N, 4) in another order of theirs."""
        return self.joints[:, [JOINTS.index(name) for name in names]]

    def bodies(self) -> tuple[Array, Array]:
        """Places (N, 5, 3) and quaternions w, x, y, z (N, 5, 4) of base, left leg, right leg."""
        places = [self.places]
        turns = [self.attitudes]
        for first, y in ((0, 0.1), (2, -0.1)):
            hip = self.places + self.attitudes.apply([0.0, y, -0.05])
            thigh = self.attitudes * Rotation.from_rotvec(self.joints[:, first, None] * [0.0, 1.0, 0.0])
            knee = hip + thigh.apply([0.0, 0.0, -0.2])
            places += [hip, knee]
            turns += [thigh, thigh * Rotation.from_rotvec(self.joints[:, first + 1, None] * [0.0, 1.0, 0.0])]
        quaternions = [turn.as_quat()[:, [3, 0, 1, 2]] for turn in turns]
        return np.stack(places, axis=1), np.stack(quaternions, axis=1)


def hops(
    fps: float,
    durations: Sequence[float] = (0.4,),
    *,
    gravity: float = GRAVITY,
    tilt: float = 0.0,
    steps: Sequence[float] = (0.0,),
    posture: Array = POSTURE,
) -> Sample:
    """Hops with the legs held, one after the other, at rest between them.

    Parameters
    ----------
    fps : Hz
    durations : s, of the flights
    gravity : m/s^2, at which the robot falls
    tilt : rad, by which the base tilts and comes back in each flight, as no body in the air does
    steps : m, by which the ground at the end of each flight is higher than at its begin
    posture : (4,) rad, in which the legs are held
    """
    begins = REST * np.arange(1, len(durations) + 1) + np.concatenate(([0.0], np.cumsum(durations)))[:-1]
    times = np.arange(int((begins[-1] + durations[-1] + REST) * fps) + 1) / fps
    heights = np.full(len(times), -lowest(posture))
    angles = np.zeros(len(times))
    for begin, duration, step in zip(begins, durations, [*steps, *[0.0] * len(durations)], strict=False):
        since = np.clip(times - begin, 0.0, duration)
        heights += since * (step / duration + 0.5 * gravity * (duration - since))
        angles += tilt * np.sin(np.pi * since / duration) ** 2
    places = np.stack([0.1 * times, np.zeros(len(times)), heights], axis=1)
    places[:, 0] = 0.0
    attitudes = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0])
    return Sample(places, attitudes, np.tile(posture, (len(times), 1)), fps)


def write_csv(sample: Sample, path: Path, order: str = "xyzw", digits: int = 6) -> Path:
    """Write rows of place, quaternion and joints."""
    quaternions = sample.attitudes.as_quat()
    if order == "wxyz":
        quaternions = quaternions[:, [3, 0, 1, 2]]
    rows = np.concatenate((sample.places, quaternions, sample.joints), axis=1)
    np.savetxt(path, rows, delimiter=",", fmt=f"%.{digits}f")
    return path


def mjlab_data(sample: Sample, names: Sequence[str] = JOINTS) -> dict[str, Array]:
    """Arrays of mjlab's files, its joints in an order of theirs."""
    places, quaternions = sample.bodies()
    return {
        "fps": np.array([sample.fps]),
        "joint_pos": sample.ordered(names),
        "joint_vel": np.gradient(sample.ordered(names), axis=0) * sample.fps,
        "body_pos_w": places,
        "body_quat_w": quaternions,
        "body_lin_vel_w": np.gradient(places, axis=0) * sample.fps,
        "body_ang_vel_w": np.zeros_like(places),
    }


def loco_data(sample: Sample) -> dict[str, Array]:
    """Arrays of LocoMuJoCo's trajectories."""
    quaternions = sample.attitudes.as_quat()[:, [3, 0, 1, 2]]
    return {
        "qpos": np.concatenate((sample.places, quaternions, sample.ordered(BY_LEVELS)), axis=1),
        "joint_names": np.array(["root", *BY_LEVELS]),
        "jnt_type": np.array([0, 3, 3, 3, 3]),
        "frequency": np.array(sample.fps),
        "split_points": np.array([0, sample.frames]),
    }


def amp_data(sample: Sample) -> dict[str, Array]:
    """Arrays of Isaac Lab's AMP, with which feet stand: as long as they are no more than a millimetre high."""
    places, quaternions = sample.bodies()
    stands = (sample.places[:, 2] + lowest(POSTURE)) < 1e-3
    return {
        "fps": np.array(sample.fps),
        "dof_names": np.array(BY_LEVELS),
        "body_names": np.array(["base", "l_thigh", "l_shank", "r_thigh", "r_shank"]),
        "dof_positions": sample.ordered(BY_LEVELS),
        "body_positions": places,
        "body_rotations": quaternions,
        "contact_names": np.array(["l", "r"]),
        "contacts": np.stack([stands, stands], axis=1),
    }


def gmr_data(sample: Sample) -> dict[str, object]:
    """The dictionary of a file of GMR."""
    quaternions = sample.attitudes.as_quat()
    return {"fps": sample.fps, "root_pos": sample.places, "root_rot": quaternions, "dof_pos": sample.joints}


def mimickit_data(sample: Sample) -> dict[str, object]:
    """The dictionary of a file of MimicKit: lists alone."""
    rows = np.concatenate((sample.places, sample.attitudes.as_rotvec(), sample.joints), axis=1)
    return {"fps": sample.fps, "loop_mode": 0, "frames": rows.tolist()}


def save_arrays(path: Path, data: Mapping[str, Any]) -> Path:
    """Write an archive of arrays."""
    np.savez(path, **data)
    return path


def write_all(sample: Sample, folder: Path) -> dict[str, Path]:
    """Write a motion in every format; return the files by the formats' names."""
    paths = {"unitree-csv": write_csv(sample, folder / "unitree.csv")}
    arrays = {"mjlab-npz": mjlab_data(sample), "loco-mujoco": loco_data(sample), "isaac-amp": amp_data(sample)}
    for name, data in arrays.items():
        paths[name] = folder / f"{name}.npz"
        save_arrays(paths[name], data)
    for name, plain in (("gmr-pkl", gmr_data(sample)), ("mimickit-pkl", mimickit_data(sample))):
        paths[name] = folder / f"{name}.pkl"
        paths[name].write_bytes(pickle.dumps(plain))
    return paths
