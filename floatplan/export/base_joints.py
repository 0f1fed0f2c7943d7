"""Coordinates of the base in an MJCF: of a free joint, or of joints that slide and rotate."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array, indices_of
from floatplan.errors import InputError
from floatplan.robot.mjcf.compiled import CompiledMjcf

SQUARE = 1e-6  # [-] cosine between axes at right angles, or one less that of equal axes
TOLERANCE = 1e-6  # [rad, m] between a pose of the base and the nearest that its joints can take


@dataclass(frozen=True, eq=False)
class _Pose:
    """A base displaced by its joints: its position (N, 3), and each joint's axis and anchor (N, 3), in the world."""

    position: Array
    axes: list[Array]
    anchors: list[Array]


@dataclass(frozen=True, eq=False)
class BaseJoints:
    """The joints between the world and the base of a compiled MJCF, by their ``numbers`` in its order.

    MuJoCo applies them one after the other, each in the frame displaced by those before it. None at all stand for a
    free joint, as a base that is fixed to the world in its file flies here.
    """

    model: CompiledMjcf
    numbers: Sequence[int]
    base: int

    def coordinates(self, position: Array, rotation: Rotation, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Return entries of qpos (N, q) and qvel (N, v) of these joints.

        Parameters
        ----------
        position, velocity : (N, 3) m, m/s, of the base's frame in the world
        rotation : N rotations from the base's axes to the world's
        spin : (N, 3) rad/s in the base's axes

        Raises
        ------
        InputError
            The joints do not reach the poses, or rotate about axes that are neither at right angles nor the same.
        """
        if self.is_free:
            quaternion = rotation.as_quat(scalar_first=True)
            return np.concatenate((position, quaternion), axis=1), np.concatenate((velocity, spin), axis=1)
        position = np.array(position)  # SciPy takes no array that is read-only
        velocity = np.array(velocity)
        spin = np.array(spin)
        angles = self._angles(rotation)
        slides = np.zeros((len(position), len(self._sliding)))
        at_zero = self._displaced(slides, angles, rotation)
        directions = np.stack([at_zero.axes[index] for index in self._sliding], axis=2)
        missing = position - at_zero.position
        slides = _solved(directions, missing)
        left = missing - np.einsum("nij,nj->ni", directions, slides)
        if np.ptp(left, axis=0).max() > TOLERANCE:  # a constant remainder is the position of the plane
            raise self._refused("does not reach the motion, which leaves its plane")
        displaced = self._displaced(slides, angles, rotation)
        in_world = rotation.apply(spin)
        hinge_rates = np.zeros_like(angles)
        rates = dict.fromkeys(self._balls, in_world)
        if self._hinges:
            hinge_axes = [displaced.axes[index] for index in self._hinges]
            hinge_rates = _solved(np.stack(hinge_axes, axis=2), in_world)
            for k, index in enumerate(self._hinges):
                rates[index] = hinge_axes[k] * hinge_rates[:, [k]]
        for index, rate in rates.items():
            velocity = velocity - np.cross(rate, displaced.position - displaced.anchors[index])
        return self._entries(slides, angles, rotation, (_solved(directions, velocity), hinge_rates, spin))

    @cached_property
    def is_free(self) -> bool:
        """Whether its configuration is that of a free joint."""
        return not self.numbers or bool(self._of_type("mjJNT_FREE"))

    @property
    def names(self) -> list[str]:
        """Names of the joints, in their order."""
        return [self.model.names["joint"][joint] for joint in self.numbers]

    def _of_type(self, name: str) -> list[int]:
        return indices_of(self.model.constants[name], self.model.jnt_type[self.numbers].tolist())

    @cached_property
    def _hinges(self) -> list[int]:
        return self._of_type("mjJNT_HINGE")

    @cached_property
    def _sliding(self) -> list[int]:
        return self._of_type("mjJNT_SLIDE")

    @cached_property
    def _balls(self) -> list[int]:
        return self._of_type("mjJNT_BALL")

    @property
    def _at_zero(self) -> Rotation:
        return Rotation.from_quat(self.model.body_quat[self.base], scalar_first=True)

    def _axis(self, index: int) -> Array:  # a copy, as SciPy takes no read-only array
        return np.array(self.model.jnt_axis[self.numbers[index]])

    def _angles(self, rotation: Rotation) -> Array:
        """Angles (N, hinges) of the hinges, rad, continuous in time; none where a ball joint has the orientation."""
        relative = self._at_zero.inv() * rotation
        axes = list(map(self._axis, self._hinges))
        if not axes:
            return np.zeros((len(rotation), 0))
        if len(axes) == 1:
            quaternion = relative.as_quat(scalar_first=True)
            angle = np.unwrap(2.0 * np.arctan2(quaternion[:, 1:] @ axes[0], quaternion[:, 0]))
            if (relative * Rotation.from_rotvec(-angle[:, None] * axes[0])).magnitude().max() > TOLERANCE:
                raise self._refused("does not reach the motion, which turns out of its plane")
            return np.asarray(angle[:, None])
        along = abs(float(axes[0] @ axes[2]))
        at_right_angles = abs(axes[0] @ axes[1]) < SQUARE and abs(axes[1] @ axes[2]) < SQUARE
        if not at_right_angles or SQUARE <= along <= 1.0 - SQUARE:
            raise self._refused("turns about axes that are neither at right angles nor the same")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # where the outer axes meet, the third angle is taken to be zero
            angles = relative.as_davenport(axes, "intrinsic")
        return _continuous(angles, same=along > 0.5)

    def _displaced(self, slides: Array, angles: Array, rotation: Rotation) -> _Pose:
        """The base displaced by slides (N, s), m, and angles (N, h), rad; a ball joint gives it its orientation."""
        position = np.tile(self.model.body_pos[self.base], (len(rotation), 1))
        frame = Rotation.concatenate([self._at_zero] * len(rotation))
        axes = []
        anchors = []
        for index, joint in enumerate(self.numbers):
            arm = np.array(self.model.jnt_pos[joint])
            axes.append(frame.apply(self._axis(index)))
            anchors.append(position + frame.apply(arm))
            if index in self._sliding:
                position = position + axes[-1] * slides[:, [self._sliding.index(index)]]
                continue
            if index in self._balls:
                frame = rotation
            else:
                frame = frame * Rotation.from_rotvec(angles[:, [self._hinges.index(index)]] * self._axis(index))
            position = anchors[-1] - frame.apply(arm)
        return _Pose(position, axes, anchors)

    def _entries(
        self, slides: Array, angles: Array, rotation: Rotation, rates: tuple[Array, Array, Array]
    ) -> tuple[Array, Array]:
        """Entries of qpos and qvel: rates of slides, of hinges, and the spin, which is that of a ball."""
        of_slides, of_hinges, spin = rates
        qpos = []
        qvel = []
        for index, joint in enumerate(self.numbers):
            if index in self._balls:
                qpos.append((self._at_zero.inv() * rotation).as_quat(scalar_first=True))
                qvel.append(spin)
                continue
            zero = self.model.qpos0[self.model.jnt_qposadr[joint]]
            if index in self._sliding:
                column = [self._sliding.index(index)]
                qpos.append(slides[:, column] + zero)
                qvel.append(of_slides[:, column])
            else:
                column = [self._hinges.index(index)]
                qpos.append(angles[:, column] + zero)
                qvel.append(of_hinges[:, column])
        return np.concatenate(qpos, axis=1), np.concatenate(qvel, axis=1)

    def _refused(self, reason: str) -> InputError:
        advice = 'give its base a free joint: <freejoint name="root"/>'
        return InputError(
            f"the base, which floats by {', '.join(self.names)}, {reason}", element="model", advice=advice
        )


def _solved(columns: Array, values: Array) -> Array:
    """The coefficients (N, k) of columns (N, 3, k) whose sum is nearest to values (N, 3), the least of several."""
    # singular values of less than 1e-9 of the largest are rounding
    return np.asarray(np.einsum("nij,nj->ni", np.linalg.pinv(columns, rcond=1e-9), values))


def _continuous(angles: Array, *, same: bool) -> Array:
    """Angles (N, 3) of the same rotations, each row as near to the one before as there is.

    Rotations about axes of which the second is at right angles to the others have two sets of angles: besides (a, b, c)
    there is (a + pi, -b, c + pi) where the outer axes are the same, else (a + pi, pi - b, c + pi).
    """
    rows = [angles[0]]
    for first in angles[1:]:
        a, b, c = first
        other = np.array([a + np.pi, -b if same else np.pi - b, c + np.pi])
        candidates = [row + 2 * np.pi * np.round((rows[-1] - row) / (2 * np.pi)) for row in (first, other)]
        rows.append(min(candidates, key=lambda row: float(np.abs(row - rows[-1]).sum())))
    return np.array(rows)
