"""How a recorded flight begins, in a plane or in space: as planned, or with what goes wrong at takeoff."""

from dataclasses import replace

import numpy as np

from floatplan.arrays import Array
from floatplan.plans.record import PlanRecord
from floatplan.simulation.in_space import RecordedInSpace
from floatplan.simulation.perturbation import Drawn
from floatplan.simulation.recorded_motion import RecordedMotion, ReducedModel


def recorded_motion(record: PlanRecord, reduced: ReducedModel) -> RecordedMotion:
    """Return the motion of a record, in a plane or in space."""
    return (RecordedInSpace if record.in_space else RecordedMotion)(record, reduced)


def perturbed_takeoff(record: PlanRecord, reduced: ReducedModel, drawn: Drawn) -> tuple[Array, Array]:
    """Where a plan takes off, with the velocities that give the real robot its momenta; (3 + m,) each."""
    positions, _ = recorded_motion(record, reduced).takeoff(record.angular_momentum)
    rise = np.array(record.com["velocity0"])
    rise[-1] *= drawn.rise
    real = replace(reduced, model=drawn.perturbed(reduced.model))
    motion = recorded_motion(replace(record, com={**record.com, "velocity0": rise}), real)
    _, velocities = motion.takeoff(record.angular_momentum * drawn.momentum)
    return positions, velocities
