"""Feet that come to the ground with speed: an impact, which takes it from them at once.

Places are the same before and after it. Feet that land neither bounce nor slip: impulses I on them change the rates of
all coordinates, ``M (v+ - v-) = J^T I``, so that ``J v+ = 0`` (Featherstone, Rigid Body Dynamics Algorithms, 2008,
section 11.7). Motors have no time to act, locked joints hold. So an impact is the balance of forces without rates and
gravity, changes of rates being accelerations, and impulses forces; like these they keep inside the friction cones.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import nnls

from floatplan.arrays import Array, IntArray
from floatplan.jumps.model import casadi
from floatplan.jumps.spatial.coordinates import Mechanics, of_contact
from floatplan.jumps.spatial.model import BASE, SpatialModel
from floatplan.jumps.spatial.nodes import NodeParameters, Row, SpatialBounds, force_rows, torque_rows
from floatplan.jumps.spatial.pieces import Expression, Piece
from floatplan.jumps.spatial.standing import Foot


class Arrival:
    """The end of a flight whose feet come to the ground with speed: its variables in a program, and their rows.

    Without such feet there are none.

    Attributes
    ----------
    feet : that come to the ground with speed
    variables : (w,) indices of all in the program
    derivatives : (2 (6+n),) of rates and accelerations, the centre of mass's first
    rates, accelerations : (6+n,) each
    impulses : (3 F,) of the feet, scaled: over that of the robot's weight in sqrt(height / g)
    """

    def __init__(self, model: SpatialModel, bounds: SpatialBounds, feet: Sequence[Foot], first: int) -> None:
        self.model = model
        self.bounds = bounds
        self.feet = feet
        n = model.size
        width = 2 * n + 3 * len(feet) if feet else 0
        self.variables: IntArray = np.arange(first, first + width)
        self.derivatives = self.variables[: 2 * n]
        self.rates = self.derivatives[:n]
        self.accelerations = self.derivatives[n:]
        self.impulses = self.variables[2 * n :]

    def piece(self, after: IntArray, height: float, expressions: dict[Any, Expression]) -> Piece:
        """Rows of the impact: balances of forces before it, and of impulses; how fast feet come; cones and torques.

        The model's symbols of rates and accelerations are those of the arrival here.

        Parameters
        ----------
        after : (2 (6+n),) variables of coordinates and rates after it
        height : of the centre of mass where the robot stands, m
        expressions : of programs so far, by what they are of, which this one joins or is taken from
        """
        ca = casadi()
        model = self.model
        bounds = self.bounds
        weight = model.mass * model.gravity
        unit = math.sqrt(height / model.gravity)
        whole = weight * unit  # [N s] of a robot that falls for so long
        rates_after = ca.SX.sym("after", model.size)
        scaled_impulses = {foot.name: ca.SX.sym(f"I_{foot.name}", 3) for foot in self.feet}
        parameters = NodeParameters.of_sizes(len(bounds.scales), 0, 0)
        scales = np.full(model.size, whole * height)
        scales[:3] = whole
        impulses = {name: whole * scaled for name, scaled in scaled_impulses.items()}
        of_impulses = self._balance(impulses, rates_after) / scales
        of_forces = model.balance({}) / weight / np.repeat([1.0, height], 3)
        rows: list[Row] = [(row, 0.0, 0.0, "balance of impulses") for row in ca.vertsplit(of_impulses)]
        rows += [(row, 0.0, 0.0, "balance of forces and moments") for row in ca.vertsplit(of_forces)]
        margin = 0.95  # [-] since the flight between exact stances is not quite the program's
        fastest = margin * bounds.impact * unit / height
        for foot in self.feet:
            velocity = model.foot(foot.name)[1][1] * unit / height
            rows.append((ca.sumsqr(velocity), -math.inf, fastest**2, f"impact of {foot.name}"))
            rows.append((velocity[2], -math.inf, 0.0, f"fall of {foot.name}"))
        rows += force_rows(self.feet, scaled_impulses, parameters.friction, parameters.inside)
        motor_rows, cost = torque_rows(model, bounds, {}, parameters.scales)
        rows += motor_rows
        evenness = 1e-2  # [-] as of forces: an impulse of the whole robot's costs as much as a motor with a tenth
        expression = Expression(
            variables=ca.vertcat(model.y, rates_after, model.v, model.a, *scaled_impulses.values()),
            parameters=parameters.vector,
            rows=ca.vertcat(*(row[0] for row in rows)),
            cost=cost + evenness * sum(map(ca.sumsqr, scaled_impulses.values()), ca.SX(0)),
        )
        return Piece(
            expression=expressions.setdefault(("impact", tuple(self.feet)), expression),
            indices=np.concatenate((after, self.variables))[:, None],
            parameter_values=np.concatenate(([bounds.friction, bounds.inside], bounds.scales))[:, None],
            low=np.array([row[1] for row in rows])[:, None],
            high=np.array([row[2] for row in rows])[:, None],
            labels=tuple(f"{row[3]} (touchdown)" for row in rows),
        )

    def _balance(self, impulses: Mapping[str, Any], after: Any) -> Any:
        """Expressions (6+n,) that vanish where impulses, N s, change the model's rates into those after them.

        N s of the robot as a whole, then N m s about its centre of mass, then of the planned joints.
        """
        ca = casadi()
        model = self.model
        change = after - model.v
        change[2] -= model.gravity  # the balance of forces adds it
        own = ca.sparsify(ca.DM(model.robot.selection[BASE:].T))
        balance = ca.vertcat(model.balance(impulses), ca.mtimes(own, model.torques(impulses)))
        still = ca.SX.zeros(model.size)
        (balance,) = ca.substitute([balance], [model.v, model.a], [still, change])
        return balance


def after_impact(mechanics: Mechanics, motion: Array, names: list[str]) -> Array:
    """Return a motion (3, 6+n, 1) with the rates that it has when its feet of some names have come to the ground.

    Its first rows are the base's origin.
    """
    q, v, a = mechanics.coordinates(motion)
    model = mechanics.model
    data = mechanics.data
    planned = np.hstack((np.eye(model.nv)[:, :BASE], mechanics.robot.selection))
    upper = np.triu(pin.crba(model, data, q[0]))
    mass = planned.T @ (upper + np.triu(upper, 1).T) @ planned
    pin.computeJointJacobians(model, data, q[0])
    pin.updateFramePlacements(model, data)
    rows = []
    for name in names:
        jacobian = pin.getFrameJacobian(model, data, mechanics.frame_numbers[name], pin.LOCAL_WORLD_ALIGNED)
        rows.append(of_contact(jacobian, mechanics.radii[name]) @ planned)
    slips = np.vstack(rows)
    # In rates whose squares are the kinetic energy an impact is the orthogonal projection on those without slip.
    factor = np.linalg.cholesky(mass)
    weighted = np.linalg.solve(factor, slips.T).T
    energetic = factor.T @ np.linalg.lstsq(planned, v[0], rcond=None)[0]
    # Three points of a sole are nine rows of a pose's six: what is left of the others is rounding.
    energetic -= np.linalg.pinv(weighted, rcond=1e-9) @ (weighted @ energetic)
    rates = planned @ np.linalg.solve(factor.T, energetic)
    return mechanics.from_coordinates(q, rates[None], a, motion[0, 3:BASE])


def unexplained(change: Array, mass: Array, effects: Array, friction: float) -> Array:
    """Return what of a change of rates (k,) no impulses inside the friction cones make, of least kinetic energy.

    Parameters
    ----------
    change : (k,) of rates
    mass : (k, k) matrix of these
    effects : (k, F, 3) momenta that impulses of 1 N s at F feet along the world's axes make
    friction : coefficient
    """
    sides = 32  # [-] of a pyramid inside the friction cone, which has 0.995 of its width
    angles = 2 * np.pi * np.arange(sides) / sides
    edges = np.stack((friction * np.cos(angles), friction * np.sin(angles), np.ones(sides)))
    factor = np.linalg.cholesky(mass)
    generators = np.linalg.solve(factor, (effects @ edges).reshape(len(change), -1))
    energetic = factor.T @ change
    factors, _ = nnls(generators, energetic)
    return np.linalg.solve(factor.T, energetic - generators @ factors)
