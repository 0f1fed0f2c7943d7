"""Distances in space for the judge of tampered plans: Pinocchio places the shapes, a closed form says how far they are.

The capsules and solids of the robot room are taken as they are, as the certificate takes them.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation
from space_reference import free_robot, joints_at

from floatplan.certificate.certificate import capsules_of, solids_of
from floatplan.plans.reading import recorded_robot
from floatplan.plans.record import RobotRecord
from floatplan.robot.urdf.tree import urdf_path

POINTS = 33  # instants around a least distance, each time closer together
ZOOMS = 4
NEAR = 5e-3  # [m] above the least of the first look, up to which others are looked at as well
MOST = 6  # of these


class _Key:
    """A robot's record, equal to another where the file is the same."""

    def __init__(self, record: RobotRecord):
        self.record = record

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.record.sha256 == other.record.sha256

    def __hash__(self) -> int:
        return hash(self.record.sha256)


@lru_cache(maxsize=16)
def _shapes(key: _Key) -> tuple[list[Any], list[Any], Any]:
    robot = recorded_robot(key.record)
    return capsules_of(robot), solids_of(robot), robot


class Distances:
    """Distances of a record's robot at any times, its attitudes interpolated between those that were flown."""

    def __init__(self, record, dense):
        self.record = record
        quaternions = _quaternions(dense.attitudes)
        self.quaternions = make_interp_spline(dense.times, quaternions, k=7)
        self.dense = dense
        self.capsules, self.solids, self.robot = _shapes(_Key(record.robot))
        self.body = free_robot(urdf_path(record.robot.file), record.robot.joints)

    def poses(self, times, links):
        """Rotations (N, L, 3, 3) and places (N, L, 3) of links in the world."""
        q = self.quaternions(times)
        attitudes = _matrices(q / np.linalg.norm(q, axis=1, keepdims=True))
        positions = joints_at(self.record, times)[0]
        com = self.record.com
        path = np.array(com["position0"]) + np.outer(times, com["velocity0"])
        path[:, 2] -= com["gravity"] / 2 * np.asarray(times) ** 2
        model, data = self.body.model, self.body.data
        names = sorted(set(links))
        frames = [model.getFrameId(name) for name in names]
        rotations, places = np.empty((len(times), len(names), 3, 3)), np.empty((len(times), len(names), 3))
        for k, row in enumerate(positions):
            full = self.body.configuration(row)
            middle = pin.centerOfMass(model, data, full)
            pin.updateFramePlacements(model, data)
            for i, frame in enumerate(frames):
                placement = data.oMf[frame]
                rotations[k, i], places[k, i] = placement.rotation, placement.translation
            places[k] -= middle
        rotations = np.einsum("nab,nlbc->nlac", attitudes, rotations)
        places = path[:, None] + np.einsum("nab,nlb->nla", attitudes, places)
        each = [names.index(link) for link in links]
        return rotations[:, each], places[:, each]

    def segments(self, times, links=None):
        """Ends (N, S, 3) and radii (S,) of the capsules of some links, or of all."""
        chosen = [shape for shape in self.capsules if links is None or shape[0] in links]
        rotations, places = self.poses(times, [shape[0] for shape in chosen])
        first, last = (np.array([shape[k] for shape in chosen], dtype=float) for k in (1, 2))
        starts, ends = (places + np.einsum("nsab,sb->nsa", rotations, each) for each in (first, last))
        return starts, ends, np.array([shape[3] for shape in chosen])

    def to_obstacle(self, obstacle, times):
        """Distances (N, S) from the links' capsules."""
        starts, ends, radii = self.segments(times)
        shift = np.outer(times, obstacle.get("velocity") or (0.0, 0.0, 0.0))[:, None]
        kind = obstacle["kind"]
        if kind == "half-space":
            normal = np.array(obstacle["normal"]) / np.linalg.norm(obstacle["normal"])
            point = np.array(obstacle["point"]) + shift
            return np.minimum((starts - point) @ normal, (ends - point) @ normal) - radii
        if kind == "box":
            center = np.array(obstacle["center"]) + shift
            one, other = starts - center, ends - center
            over = np.maximum(np.minimum(one, other), -np.maximum(one, other)) - np.array(obstacle["size"]) / 2
            return over.max(axis=2) - radii
        first = obstacle["center" if kind == "sphere" else "start"]
        last = obstacle["center" if kind == "sphere" else "end"]
        return between(starts, ends, np.array(first) + shift, np.array(last) + shift) - radii - obstacle["radius"]

    def of_pair(self, links, times):
        """Distances (N, pairs) between the capsules of two links."""
        (a, b, r), (c, d, s) = (self.segments(times, [link]) for link in links)
        one, other = (grid.ravel() for grid in np.indices((len(r), len(s))))
        return between(a[:, one], b[:, one], c[:, other], d[:, other]) - r[one] - s[other]

    def over_ground(self, times):
        """Heights (N, solids) over the lowest point at t = 0 of the link that takes off."""
        frame = self.record.problem["flight"]["takeoff"]["frame"]
        joint = self.robot.joint_tree.joint.get(frame)
        standing = self.robot.contact_link(frame if joint is None else joint.child)
        level = self.record.problem["flight"]["takeoff"]["position"][2]
        at_start = self._lowest(np.zeros(1))[0]
        feet = [height for height, solid in zip(at_start, self.solids, strict=True) if solid[0] == standing]
        return self._lowest(times) - min(feet, default=level)

    def _lowest(self, times):
        rotations, places = self.poses(times, [solid[0] for solid in self.solids])
        heights = np.empty(places.shape[:2])
        for i, (_, points, axes) in enumerate(self.solids):
            up = rotations[:, i, 2]
            heights[:, i] = places[:, i, 2] + (up @ np.array(points).T).min(axis=1)
            heights[:, i] -= np.linalg.norm(up @ np.array(axes), axis=1)
        return heights

    def least(self, distances, low=0.0, high=None):
        """The least of distances (N, members) as a function of times, sharpened around the lowest of a first look."""
        high = self.record.duration if high is None else min(high, self.record.duration)
        low = max(low, 0.0)
        if low > high:
            return np.inf
        nodes = self.dense.times
        times = np.unique([low, *nodes[(nodes > low) & (nodes < high)], high])
        seen = distances(times)
        least = float(seen.min())
        step = float(np.diff(times).max(initial=0.0))
        lowest = seen.min(axis=0)
        for member in np.argsort(lowest)[:MOST]:
            if lowest[member] > least + NEAR:
                break
            middle, width = times[seen[:, member].argmin()], step
            for _ in range(ZOOMS):
                closer = np.clip(np.linspace(middle - width, middle + width, POINTS), low, high)
                there = distances(closer)
                least = min(least, float(there.min()))
                middle, width = closer[there[:, member].argmin()], 2 * width / (POINTS - 1)
        return least


def between(a, b, c, d):
    """Distances (...) between segments from a to b and from c to d, (..., 3).

    They are nearest at an end of one of them, or where the common normal of their lines meets both.
    """
    one, other = b - a, d - c
    normal = np.cross(one, other)
    square = (normal * normal).sum(axis=-1)
    share = (np.cross(c - a, other) * normal).sum(axis=-1) / np.where(square > 0, square, 1.0)
    facing = a + np.clip(share, 0.0, 1.0)[..., None] * one
    to_other = (_to_segment(point, c, other) for point in (facing, a, b))
    return np.minimum.reduce([*to_other, _to_segment(c, a, one), _to_segment(d, a, one)])


def _to_segment(point, start, along):
    square = (along * along).sum(axis=-1)
    share = ((point - start) * along).sum(axis=-1) / np.where(square > 0, square, 1.0)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(point - nearest, axis=-1)


def _quaternions(attitudes):
    """Quaternions (N, 4) without jumps."""
    q = Rotation.from_matrix(attitudes).as_quat()
    flips = np.cumprod(np.sign(np.concatenate([[1.0], (q[1:] * q[:-1]).sum(axis=1)])))
    return q * flips[:, None]


def _matrices(q):
    return Rotation.from_quat(q).as_matrix()
