"""The result of a search in space: a jump from standing to standing, with its check, and its file, ``jump.json``.

JSON, format ``floatplan.jump/2``: as ``floatplan.jump/1``, but for ``flight``, a file ``floatplan.plan/2``, and
``stances``, each with ``side``, ``contacts`` (``frame`` and ``depth``, m; ``rolls`` where that is a rolling ball's
radius; of a sole's points ``suffix`` and ``point``, m, in the frame of the joint that carries it), the ``axes`` of the
base's angles,
``friction``, and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (position of the
base, its angles and joints, with their derivatives), and ``shares``: the planned forces, N, near to which the feet's
forces are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from floatplan.jumps.jump import Jump
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.jumps.spatial.standing import Foot

FORMAT_IN_SPACE = "floatplan.jump/2"
ARRAYS_IN_SPACE = {"times": "times", "y": "y", "v": "v", "a": "a", "shares": "planned_forces"}  # key -> of the grid


@dataclass(frozen=True, eq=False, repr=False)
class SpatialJump(SpatialJumpMotion, Jump):
    """A jump in space from standing to standing; see :class:`~floatplan.jumps.jump.Jump`."""

    _format: ClassVar[str] = FORMAT_IN_SPACE

    def stance_table(self, stance: Any) -> dict[str, Any]:
        """What the file holds of a stance."""
        return {
            "contacts": [contact_table(foot) for foot in stance.contacts],
            "axes": stance.axes,
            "friction": stance.friction,
            **{key: getattr(stance.grid, name) for key, name in ARRAYS_IN_SPACE.items()},
        }


def contact_table(foot: Foot) -> dict[str, Any]:
    """What the file holds of a foot's point."""
    table: dict[str, Any] = {"frame": foot.frame, "depth": foot.depth}
    if foot.suffix:
        table |= {"suffix": foot.suffix, "point": list(foot.local)}
    if foot.radius:
        table["rolls"] = True
    return table
