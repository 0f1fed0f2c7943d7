"""How much a search has done, measured without a clock: the same on every machine, busy or quiet.

Where answers are compared or repeated, a search must end at the same place each time. Processor time is no such
measure; the instants evaluated are, and they cost nearly all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

EVALUATION = 1000.0  # [instants of one body] of a motion, whatever its size
DIFFERENTIATION = 1500.0  # [instants of one body] of a block of constraints, whatever its size
ENTRY = 0.5  # [instants of one body] of a Jacobian
DEFAULT_WORK = 6e7  # [instants of one body] of a search whose budget is left out: about 7 s at 2 to 3 GHz


@dataclass(eq=False)
class Work:
    """Work done so far; its unit is the evaluation of one body at one instant."""

    done: float = 0.0

    def evaluated(self, instants: int, bodies: int, motions: int = 1) -> None:
        """Count the evaluation of a motion, or of several at so many instants in all."""
        self.done += motions * EVALUATION + instants * bodies

    def differentiated(self, entries: int) -> None:
        """Count a Jacobian."""
        self.done += DIFFERENTIATION + ENTRY * entries
