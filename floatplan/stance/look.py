"""A look at the first motion on IPOPT's way that holds: whether joints that are held bear too much in it.

Their torques are no rows at first, since most bear little. Where some bear too much, they mostly do so from the first
motion that holds to the best one: the search then stops there, and goes on with rows for them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from floatplan.stance.model import casadi
from floatplan.stance.rows import Rows

if TYPE_CHECKING:
    from floatplan.stance.program import JumpProgram

HOLDS = 1e-3  # [-] what rows may be off in a motion that is looked at


def first_look(program: JumpProgram, size: int, rows: Rows) -> Any:
    """Return a callback for IPOPT that stops it where held joints bear too much in the first motion that holds.

    Its ``strained`` is None before that motion; then names of these joints.

    Parameters
    ----------
    program : JumpProgram
    size : of its variables with directions
    rows : of the program
    """
    ca = casadi()
    low, high = np.concatenate(rows.low), np.concatenate(rows.high)
    sizes = {"x": size, "f": 1, "g": len(low), "lam_x": size, "lam_g": len(low), "lam_p": 0}

    class Look(ca.Callback):  # type: ignore[misc, name-defined]
        """Called with what CasADi's solvers return, at each iterate."""

        def __init__(self) -> None:
            super().__init__()
            self.strained: tuple[str, ...] | None = None
            self.construct("look", {})

        def get_n_in(self) -> int:
            return int(ca.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, index: int) -> Any:
            return ca.Sparsity.dense(sizes[ca.nlpsol_out(index)])

        def eval(self, arguments: Any) -> list[int]:
            """Return whether to stop."""
            now = dict(zip(ca.nlpsol_out(), arguments, strict=True))
            values = np.asarray(now["g"]).ravel()
            if self.strained is None and max((low - values).max(), (values - high).max()) < HOLDS:
                self.strained = program.overloaded(np.asarray(now["x"]).ravel())
            return [int(bool(self.strained))]

    return Look()
