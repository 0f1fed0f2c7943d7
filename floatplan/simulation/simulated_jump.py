"""The motion that a simulated robot made of a jump: pictures, pages and exports read it as they read a plan's."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from floatplan.arrays import read_only
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.jump_motion import JOINTS, SpatialJumpMotion

STANDING = 1.0  # [s] that a jump is to stand at the end


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedJump(JumpMotion):
    """What a robot made of a jump in a plane: its motion between recorded instants; it goes on for ``STANDING``."""

    recorded: JumpState | None = None

    @property
    def duration(self) -> float:
        """From standing until it should stand again for ``STANDING``, s."""
        return super().duration + STANDING

    def at(self, times: npt.ArrayLike) -> JumpState:
        """State at times (N,) s from the jump's start; errors as of a jump's."""
        assert self.recorded is not None
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64)).ravel()
        recorded = self.recorded.times

        def between(values: Any) -> Any:
            if isinstance(values, dict):
                return {name: between(own) for name, own in values.items()}
            return read_only(np.stack([np.interp(instants, recorded, column) for column in values.T], axis=1))

        values = [between(getattr(self.recorded, row.name)) for row in fields(self.recorded)[1:]]
        return JumpState(read_only(instants), *values)


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedSpatialJump(SimulatedJump, SpatialJumpMotion):
    """The same of a jump in space."""

    def at(self, times: npt.ArrayLike) -> JumpState:
        """State at times (N,) s from the jump's start; errors as of a jump's."""
        state = super().at(times)
        positions = state.positions.copy()
        positions[:, 3:JOINTS] /= np.linalg.norm(positions[:, 3:JOINTS], axis=1, keepdims=True)
        return replace(state, positions=read_only(positions))
