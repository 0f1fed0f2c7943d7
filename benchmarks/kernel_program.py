"""A flight's program as the kernel computes it: for other solvers, and for tests of its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import floatplan as fp
from floatplan.kernel.structs import Struct
from floatplan.optimization.programs import Derivatives, Evaluation
from floatplan.planning.attempt import Attempts
from floatplan.planning.transcription.variables import DecisionVariables


@dataclass(frozen=True, eq=False)
class KernelProgram:
    """The program of a problem at the nodes of a level and at ``others``, rising; the plain motion's class, or another.

    Rows are in the order of the kernel: row by row, instant by instant, those left out that do not apply.
    """

    problem: fp.Problem
    level: int
    others: tuple[float, ...] = ()
    variables: DecisionVariables | None = None
    back_off: float = 0.0

    @cached_property
    def _ready(self) -> Attempts:
        return Attempts(self.problem, 0)

    @cached_property
    def of(self) -> DecisionVariables:
        """How x make a motion."""
        return self.variables or self._ready.plain_start.variables

    def whole(self, x: np.ndarray, penalty: float = 0.0) -> dict[str, np.ndarray]:
        """Everything at x, by the kernel's names; values (rows, instants), slopes (rows, instants, size)."""
        compiled, size = self._ready.compiled, len(x)
        assert compiled, "the flight is in a plane"
        x = np.ascontiguousarray(x)
        attempt = compiled.attempt_struct(self.of, x.copy(), True)
        inputs, motions = compiled.inputs(self.of)
        count = self._ready.model.flight.node_counts[self.level] + len(self.others)
        rows, stride = attempt.pointer.rows, -(-count // 8) * 8
        shapes = {"equality": (1,), "gradient": (size,), "row": (1, size), "hessian": (size, size), "step": (size,)}
        shapes |= {"values": (rows, stride), "slopes": (rows, stride, size)}
        arrays = {name: np.zeros(shape) for name, shape in shapes.items()}
        at = Struct(
            "Evaluation",
            level=self.level,
            extra=len(self.others),
            others=np.array(self.others, np.float64),
            x=x,
            back_off=self.back_off,
            penalty=penalty,
            **arrays,
        )
        kernel = compiled.watch.kernel
        no_memory = kernel.evaluate(
            inputs.robot,
            inputs.constraints,
            inputs.motions,
            inputs.levels,
            inputs.settings,
            inputs.rules,
            attempt.pointer,
            at.pointer,
            kernel.instructions,
        )
        assert not no_memory
        assert motions, "until here"
        arrays |= {"values": arrays["values"][:, :count], "slopes": arrays["slopes"][:, :count]}
        return arrays | {"objective": np.array(at.pointer.objective)}

    def evaluate(self, x: np.ndarray) -> Evaluation[None]:
        """Values and derivatives at x."""
        it = self.whole(x)
        applies = np.isfinite(it["values"])
        derivatives = Derivatives(it["gradient"], it["row"], it["slopes"][applies])
        equality, inequality = it["equality"], it["values"][applies]
        return Evaluation(float(it["objective"]), equality, inequality, lambda: derivatives, None)
