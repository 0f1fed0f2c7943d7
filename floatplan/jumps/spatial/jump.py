"""The result of a search in space: a jump from standing to standing, with its check, and its file, ``jump.json``.

JSON, format ``floatplan.jump/2``: as ``floatplan.jump/1``, but for ``flight``, a file ``floatplan.plan/2``, and
``stances``, each with ``side``, ``contacts`` (``frame`` and ``depth``, m), the ``axes`` of the base's angles,
``friction``, and arrays over its instants, between which quintics are: ``times``, ``y``, ``v``, ``a`` (position of the
base, its angles and joints, with their derivatives), and ``shares``, next to which the feet's forces are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from floatplan.jumps.check import JumpCheck
from floatplan.jumps.jump import Jump
from floatplan.jumps.spatial.check import check_jump_in_space
from floatplan.jumps.spatial.jump_motion import SpatialJumpMotion
from floatplan.pool import one_thread

FORMAT_IN_SPACE = "floatplan.jump/2"
ARRAYS_IN_SPACE = ("times", "y", "v", "a", "shares")


@dataclass(frozen=True, eq=False, repr=False)
class SpatialJump(SpatialJumpMotion, Jump):
    """A jump in space from standing to standing; see :class:`~floatplan.jumps.jump.Jump`."""

    _format: ClassVar[str] = FORMAT_IN_SPACE

    @cached_property
    @one_thread
    def check(self) -> JumpCheck:
        """The stances, judged at 2 kHz; see :func:`~floatplan.jumps.spatial.check.check_jump_in_space`."""
        if self.flight is None:
            return JumpCheck(False, {}, ("no jump was found",))
        return check_jump_in_space(self)

    def stance_table(self, stance: Any) -> dict[str, Any]:
        """What the file holds of a stance."""
        return {
            "contacts": [{"frame": foot.frame, "depth": foot.depth} for foot in stance.contacts],
            "axes": stance.axes,
            "friction": stance.friction,
            **{name: getattr(stance.grid, name) for name in ARRAYS_IN_SPACE},
        }
