"""Solids and shells of MJCF in Arb: volume and moments of each; rotations from vectors, and principal axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import flint
import numpy as np

from floatplan.errors import InputError

EXPANDED = 1e-6  # [m] how thick MuJoCo makes the shell of an ellipsoid
THOMSEN = 1.6075  # [-] exponent of the area of an ellipsoid, as MuJoCo takes it
IDENTITY = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def _sphere(radius: Any, _: Any, __: Any, shell: bool) -> tuple[Any, list[Any]]:
    area, square = 4 * flint.arb.pi() * radius * radius, radius * radius
    return (area, [square / 3] * 3) if shell else (area * radius / 3, [square / 5] * 3)


def _capsule(radius: Any, half: Any, _: Any, shell: bool) -> tuple[Any, list[Any]]:
    # share: of the two hemispheres in the volume; height: of their centres over the cylinder
    square, pi = radius * radius, flint.arb.pi()
    if shell:
        volume, share, height, of_sphere = 4 * pi * radius * (radius + half), radius / (radius + half), radius / 2, 3
    else:
        volume, share = 2 * pi * square * (half + 2 * radius / 3), 2 * radius / (2 * radius + 3 * half)
        height, of_sphere = 3 * radius / 8, 5
    across = (1 - share) * square / (2 if shell else 4) + share * square / of_sphere
    along = (1 - share) * half * half / 3 + share * (square / of_sphere + 2 * half * height + half * half)
    return volume, [across, across, along]


def _cylinder(radius: Any, half: Any, _: Any, shell: bool) -> tuple[Any, list[Any]]:
    square, pi = radius * radius, flint.arb.pi()
    if not shell:
        return 2 * pi * square * half, [square / 4, square / 4, half * half / 3]
    discs = radius / (radius + 2 * half)
    across = (2 - discs) * square / 4
    return 2 * pi * radius * (radius + 2 * half), [across, across, (1 + 2 * discs) * half * half / 3]


def _box(x: Any, y: Any, z: Any, shell: bool) -> tuple[Any, list[Any]]:
    sides, faces = (x, y, z), (y * z, z * x, x * y)
    if not shell:
        return 8 * x * y * z, [side * side / 3 for side in sides]
    area = sum(faces, start=flint.arb(0))
    return 8 * area, [side * side * (1 + 2 * face / area) / 3 for side, face in zip(sides, faces, strict=True)]


def _ellipsoid(x: Any, y: Any, z: Any, shell: bool) -> tuple[Any, list[Any]]:
    axes, pi = (x, y, z), flint.arb.pi()
    if not shell:
        return 4 * pi * x * y * z / 3, [axis * axis / 5 for axis in axes]
    power = flint.arb(THOMSEN)
    area = 4 * pi * (((x * y) ** power + (y * z) ** power + (z * x) ** power) / 3) ** (1 / power)
    wider = [axis + flint.arb(EXPANDED) for axis in axes]
    inner, outer = x * y * z, wider[0] * wider[1] * wider[2]
    pairs = zip(axes, wider, strict=True)
    return area, [(outer * b * b - inner * a * a) / (5 * (outer - inner)) for a, b in pairs]


# From MuJoCo's three sizes, and whether it is a shell: volume (of a shell: area), and mean squares of x, y and z.
SOLIDS = {"sphere": _sphere, "capsule": _capsule, "cylinder": _cylinder, "box": _box, "ellipsoid": _ellipsoid}


def diagonal(entries: Sequence[Any]) -> Any:
    """Matrix (3, 3) of these on its diagonal."""
    return flint.arb_mat([[entries[i] * IDENTITY[i][j] for j in range(3)] for i in range(3)])


def dot(a: Any, b: Any) -> Any:
    """Scalar product of columns (3, 1)."""
    return (a.transpose() * b)[0, 0]


def cross(a: Any, b: Any) -> Any:
    """Vector product of columns (3, 1)."""
    (ax, ay, az), (bx, by, bz) = a.entries(), b.entries()
    return flint.arb_mat(3, 1, [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def unit(column: Any) -> Any:
    """A column (3, 1) made of length 1."""
    length = dot(column, column).sqrt()
    if not length > 0:
        raise InputError("an axis has no length")
    return column * (1 / length)


def of_axes(x: Any, y: Any) -> Any:
    """Rotation (3, 3) whose x is along the first, and whose y is in the plane of both."""
    x = unit(x)
    y = unit(y - x * dot(x, y))
    return flint.arb_mat([x.entries(), y.entries(), cross(x, y).entries()]).transpose()


def of_quaternion(w: Any, x: Any, y: Any, z: Any) -> Any:
    """Rotation (3, 3) of a quaternion of any length."""
    square = w * w + x * x + y * y + z * z
    if not square > 0:
        raise InputError("a quaternion has no length")
    vector = flint.arb_mat([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return flint.arb_mat(IDENTITY) + (vector * w + vector * vector) * (2 / square)


def of_z(column: Any) -> Any:
    """The smallest rotation (3, 3) that takes z to a direction; about x where that is down."""
    x, y, z = unit(column).entries()
    return (
        of_quaternion(flint.arb(0), 1, 0, 0)
        if x.is_zero() and y.is_zero() and z < 0
        else of_quaternion(1 + z, -y, x, 0)
    )


def principal(inertia: Any) -> tuple[Any, list[Any]]:
    """Axes (3, 3) of length 1, and moments: an inertia is ``axes diag(moments) axes^T`` for some within the balls.

    Moments raised to a least one stay within: in Frobenius' norm matrices come no farther apart by that.
    """
    rough = np.linalg.eigh(np.array([[float(each.mid()) for each in row] for row in inertia.tolist()]))[1].T
    axes = of_axes(*(flint.arb_mat(3, 1, row.tolist()) for row in rough[:2]))
    seen = axes.transpose() * inertia * axes
    off = sum((abs(seen[i, j]) for i in range(3) for j in range(3) if i != j), start=flint.arb(0))
    return axes, [seen[k, k] + flint.arb(0, off.upper()) for k in range(3)]
