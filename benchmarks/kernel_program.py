"""A flight's program as the kernel computes it: for other solvers, and for tests of its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from reduced_program import Derivatives, Evaluation

import floatplan as fp
from floatplan.kernel.library import kernel
from floatplan.kernel.structs import Struct
from floatplan.planning.kernel_problem import KernelProblem
from floatplan.planning.spec import FlightSpec, nominal_start
from floatplan.planning.variables import DecisionVariables, Start


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
    def _spec(self) -> FlightSpec:
        return FlightSpec(self.problem)

    @cached_property
    def of(self) -> DecisionVariables:
        """How x make a motion."""
        return self.variables or nominal_start(self._spec, self.problem.degrees).variables

    def whole(self, x: np.ndarray, penalty: float = 0.0) -> dict[str, np.ndarray]:
        """Everything at x, by the kernel's names; values (rows, instants), slopes (rows, instants, size)."""
        size = len(x)
        flight = self._spec.flight
        equalities = flight.tangent
        x = np.ascontiguousarray(x)
        of = KernelProblem.of(self._spec, Start(self.of, x, at_once=True))
        count = flight.node_counts[self.level] + len(self.others)
        rows, stride = of.rows.rows, -(-count // 8) * 8
        shapes = {
            "equality": (equalities,),
            "gradient": (size,),
            "row": (equalities, size),
            "hessian": (size, size),
            "step": (size,),
        }
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
        no_memory = of.rows.evaluate(
            *of.rows.flying(self.of.momentum),
            of.constraints.pointer,
            of.motions.pointer,
            of.levels.pointer,
            of.settings.pointer,
            of.rules.pointer,
            of.search.pointer,
            at.pointer,
            kernel().instructions,
        )
        assert not no_memory
        arrays |= {"values": arrays["values"][:, :count], "slopes": arrays["slopes"][:, :count]}
        return arrays | {"objective": np.array(at.pointer.objective)}

    def evaluate(self, x: np.ndarray) -> Evaluation[None]:
        """Values and derivatives at x."""
        it = self.whole(x)
        applies = np.isfinite(it["values"])
        derivatives = Derivatives(it["gradient"], it["row"], it["slopes"][applies])
        equality, inequality = it["equality"], it["values"][applies]
        return Evaluation(float(it["objective"]), equality, inequality, lambda: derivatives, None)
