"""Where a search begins: the plain motion. Others are drawn by the kernel, ``starts.hpp`` and ``ranked.hpp``."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floatplan.arrays import Array
from floatplan.motion.dynamics import MomentumSet
from floatplan.planning.transcription.variables import DecisionVariables, decision_variables
from floatplan.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class Start:
    """A class of motions (with its arcsine branches) and a point x in it.

    ``at_once`` says that it is followed to the objective at once, and only where that fails made feasible before, as
    promises most of plain motions and of ones that were solved already.
    """

    variables: DecisionVariables
    x: Array
    at_once: bool = False


@lru_cache(maxsize=8)
def plain_start(problem: Problem, degrees: tuple[int, ...], momentum: MomentumSet) -> Start:
    """Each search of a problem begins with it: with another seed, or for another best one."""
    variables = decision_variables(problem, degrees, np.zeros((2, len(problem.robot.joints)), np.int64), momentum)
    return Start(variables, variables.plain_motion, at_once=True)
