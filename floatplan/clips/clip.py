"""A recorded motion of a robot: where its base and its joints are, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from floatplan.arrays import Array, BoolArray, read_only
from floatplan.clips.curve import ClipCurve
from floatplan.clips.flights import ClipFlight, Ground, Scene
from floatplan.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class FileLayout:
    """How the file of a clip has its numbers, so that another clip can be written in the same form.

    Attributes
    ----------
    format : name of the format
    joints : (J,) names in the order of the file's columns
    quaternion : "xyzw" or "wxyz", where the file does not say it itself
    others : what else the file holds, by its keys, that does not change with the motion
    """

    format: str
    joints: tuple[str, ...]
    quaternion: str = "xyzw"
    others: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Clip:
    """A recorded motion of N frames of a robot with J joints that move.

    Attributes
    ----------
    robot : Robot
        With a free base.
    path : Path
        The file that it was read from.
    fps : float, Hz
    base_position : (N, 3) m
        Of the root link's origin, in the world, whose z axis is up.
    base_quaternion : (N, 4) x, y, z, w
        Of unit length, and nowhere of opposite sign to the frame before.
    positions : (N, J) rad, m where a joint slides
        In the order of ``robot.model_joints``.
    contacts : (N, C) bool, optional
        Whether each foot stands, where the file says so; its names are ``contact_names``.
    remarks : what was assumed when it was read, a sentence each
    layout : FileLayout
    feet : names of links whose bodies are feet; None: by their shapes
    ground_height : m, of a level ground; None: by the feet that stand
    velocities : (N, 6 + J), optional
        Of Pinocchio's model, the base's in its own axes: of a repaired clip.
    """

    robot: Robot
    path: Path
    fps: float
    base_position: Array
    base_quaternion: Array
    positions: Array
    layout: FileLayout
    contacts: BoolArray | None = None
    contact_names: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    feet: tuple[str, ...] | None = None
    ground_height: float | None = None
    velocities: Array | None = None

    @property
    def frames(self) -> int:
        """Their number N."""
        return len(self.positions)

    @property
    def duration(self) -> float:
        """From the first frame to the last, s."""
        return (self.frames - 1) / self.fps

    @cached_property
    def times(self) -> Array:
        """Of the frames (N,), s."""
        return read_only(np.arange(self.frames) / self.fps)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names (J,) of the joints, in the order of ``positions``."""
        return self.robot.model_joints

    @cached_property
    def configurations(self) -> Array:
        """Configurations (N, 7 + J) of ``robot.model``: position of the base, quaternion x, y, z, w, joints."""
        return read_only(np.concatenate((self.base_position, self.base_quaternion, self.positions), axis=1))

    @cached_property
    def curve(self) -> ClipCurve:
        """The motion between its frames."""
        return ClipCurve(self.robot, self.fps, self.base_position, self.base_quaternion, self.positions)

    @cached_property
    def scene(self) -> Scene:
        """Heights of feet and other bodies over the ground."""
        return Scene.of(self.curve, self.contacts, self.feet, self.ground_height)

    @property
    def ground(self) -> Ground:
        """Height of the ground along the clip."""
        return self.scene.ground

    @cached_property
    def flights(self) -> tuple[ClipFlight, ...]:
        """The flights in it, in their order."""
        return self.scene.flights()

    def __repr__(self) -> str:
        return f"Clip({self.path.name!r}, {self.robot.name!r}, {self.frames} frames at {self.fps:g} Hz)"
