"""Pieces of a program: functions of a few variables with sparse derivatives, mapped over nodes and intervals.

All nodes of a kind share one expression, its Jacobian and its Hessian, evaluated for all of them at once. What they
give is put into the program's own sparse matrices by constant ones: so a program of thousands of variables is built in
the time of its few kinds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from floatplan.arrays import Array, IntArray
from floatplan.jumps.model import casadi


@dataclass(frozen=True, eq=False)
class Derivative:
    """Entries of a sparse derivative of an expression.

    Attributes
    ----------
    function : of the variables and parameters, those of second order of the multipliers too, to the entries (k,)
    row, column : (k,) of the entries
    """

    function: Any
    row: IntArray
    column: IntArray


@dataclass(frozen=True, eq=False)
class Expression:
    """Rows and a cost of a few variables; their derivatives are made on first use, and serve every program that asks.

    Attributes
    ----------
    variables, parameters : symbols (w,) and (p,)
    rows : (m,) expressions
    cost : expression
    """

    variables: Any
    parameters: Any
    rows: Any
    cost: Any

    @cached_property
    def values(self) -> Any:
        """Function of variables and parameters to rows and cost."""
        return casadi().Function("values", [self.variables, self.parameters], [self.rows, self.cost])

    @cached_property
    def gradient(self) -> Any:
        """Function of variables and parameters to the cost's gradient (w,)."""
        ca = casadi()
        gradient = ca.gradient(self.cost, self.variables)
        return ca.Function("gradient", [self.variables, self.parameters], [gradient])

    @cached_property
    def jacobian(self) -> Derivative:
        """Of the rows (m, w)."""
        ca = casadi()
        jacobian = ca.jacobian(self.rows, self.variables)
        function = ca.Function("first", [self.variables, self.parameters], [jacobian.nz[:]])
        row, column = map(np.array, jacobian.sparsity().get_triplet())
        return Derivative(function, row, column)

    @cached_property
    def curvature(self) -> Derivative:
        """Upper triangle of the Hessian (w, w) of the Lagrangian, with multipliers of the cost and of the rows."""
        ca = casadi()
        sigma = ca.SX.sym("sigma")
        multipliers = ca.SX.sym("multipliers", self.rows.shape[0])
        lagrangian = sigma * self.cost + ca.dot(multipliers, self.rows)
        hessian = ca.triu(ca.hessian(lagrangian, self.variables)[0])
        symbols = [self.variables, self.parameters, sigma, multipliers]
        function = ca.Function("second", symbols, [hessian.nz[:]])
        row, column = map(np.array, hessian.sparsity().get_triplet())
        return Derivative(function, row, column)


@dataclass(frozen=True, eq=False)
class Piece:
    """One expression at many instants.

    Attributes
    ----------
    expression : Expression, its rows bounded
    indices : (w, N) of the program's variables
    values : (p, N) of the parameters
    low, high : (m, N) bounds
    labels : (m,) for a person
    """

    expression: Expression
    indices: IntArray
    values: Array
    low: Array
    high: Array
    labels: tuple[str, ...]


class Assembly:
    """Rows and cost of all pieces, with derivatives, as functions of the program's variables x (size,).

    The cost has a proximal term, ``rho / 2 sum_k weights_k (x_k - near_k)^2``, whose ``near`` and ``rho`` are the
    program's parameters.

    Attributes
    ----------
    low, high : bounds (rows,)
    labels : (rows,) for a person
    weights : (size,) of the proximal term
    first_derivatives : functions of IPOPT's problem, by CasADi's option names
    """

    def __init__(self, pieces: Sequence[Piece], weights: Array) -> None:
        ca = casadi()
        size = len(weights)
        self.pieces = pieces
        self.size = size
        self.weights = weights
        self.low = np.concatenate([piece.low.ravel(order="F") for piece in pieces])
        self.high = np.concatenate([piece.high.ravel(order="F") for piece in pieces])
        self.labels = [label for piece in pieces for label in piece.labels * piece.indices.shape[1]]
        x = ca.MX.sym("x", size)
        parameters = ca.MX.sym("p", size + 1)
        parts = _Parts()
        begin = 0
        for piece in pieces:
            parts.add(piece, x, begin)
            begin += piece.low.size
        rho = parameters[size]
        offset = x - parameters[:size]
        scaled = ca.DM(weights) * offset
        cost = parts.cost + rho / 2 * ca.dot(offset, scaled)
        gradient = parts.gradient(size) + rho * scaled
        rows = ca.vertcat(*parts.rows)
        jacobian = _assembled(parts.jacobian_values, parts.jacobian, (begin, size))
        names = ["x", "p"]
        symbols = [x, parameters]
        self.problem = {"x": x, "p": parameters, "f": cost, "g": rows}
        self.first_derivatives = {
            "grad_f": ca.Function("nlp_grad_f", symbols, [cost, gradient], names, ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", symbols, [rows, jacobian], names, ["g", "jac_g_x"]),
        }
        self.evaluate = ca.Function("rows", symbols, [rows])

    @cached_property
    def functions(self) -> dict[str, Any]:
        """First and second derivatives; the latter take most of the time, and are made where a search needs them."""
        ca = casadi()
        x = self.problem["x"]
        parameters = self.problem["p"]
        of_cost = ca.MX.sym("lam_f")
        of_rows = ca.MX.sym("lam_g", len(self.low))
        rho = parameters[self.size]
        values = []
        positions = []
        begin = 0
        for piece in self.pieces:
            end = begin + piece.low.size
            entries, places = _curvature(piece, x, of_cost, of_rows[begin:end])
            values.append(entries)
            positions.append(places)
            begin = end
        values.append(of_cost * rho * ca.DM(self.weights))
        positions.append((np.arange(self.size), np.arange(self.size)))
        hessian = ca.Function(
            "nlp_hess_l",
            [x, parameters, of_cost, of_rows],
            [_assembled(values, positions, (self.size, self.size))],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        )
        return {**self.first_derivatives, "hess_lag": hessian}


@dataclass
class _Parts:
    """What pieces give so far: rows, cost, and the non-zero entries of derivatives with their positions."""

    cost: Any = 0.0
    rows: list[Any] = field(default_factory=list)
    gradients: list[tuple[IntArray, Any]] = field(default_factory=list)
    jacobian_values: list[Any] = field(default_factory=list)
    jacobian: list[tuple[IntArray, IntArray]] = field(default_factory=list)

    def add(self, piece: Piece, x: Any, begin: int) -> None:
        """Add a piece whose first row is the program's row ``begin``."""
        ca = casadi()
        count = piece.indices.shape[1]
        height = piece.low.shape[0]
        expression = piece.expression
        columns = _columns(piece, x)
        numbers = ca.DM(piece.values)
        rows, costs = expression.values.map(count)(columns, numbers)
        gradients = expression.gradient.map(count)(columns, numbers)
        jacobian = expression.jacobian
        self.cost += ca.sum2(costs)
        self.rows.append(ca.vec(rows))
        self.gradients.append((piece.indices.ravel(order="F"), ca.vec(gradients)))
        places = np.arange(count)[:, None] * height + jacobian.row + begin
        self.jacobian.append((places.ravel(), piece.indices[jacobian.column].T.ravel()))
        self.jacobian_values.append(ca.vec(jacobian.function.map(count)(columns, numbers)))

    def gradient(self, size: int) -> Any:
        """Gradient (size,) of the cost."""
        ca = casadi()
        indices = np.concatenate([index for index, _ in self.gradients])
        values = ca.vertcat(*(value for _, value in self.gradients))
        gather = sp.csc_matrix((np.ones(len(indices)), (indices, np.arange(len(indices)))), (size, len(indices)))
        return ca.densify(ca.mtimes(ca.DM(gather), values))


def _columns(piece: Piece, x: Any) -> Any:
    """The piece's variables (w, N) among the program's."""
    width, count = piece.indices.shape
    return casadi().reshape(x[piece.indices.ravel(order="F").tolist()], width, count)


def _curvature(piece: Piece, x: Any, of_cost: Any, of_rows: Any) -> tuple[Any, tuple[IntArray, IntArray]]:
    """Entries of the Lagrangian's Hessian from a piece, and their positions in the upper triangle."""
    ca = casadi()
    count = piece.indices.shape[1]
    height = piece.low.shape[0]
    curvature = piece.expression.curvature
    entries = curvature.function.map(count)(
        _columns(piece, x), ca.DM(piece.values), ca.repmat(of_cost, 1, count), ca.reshape(of_rows, height, count)
    )
    first = piece.indices[curvature.row].T.ravel()
    other = piece.indices[curvature.column].T.ravel()
    return ca.vec(entries), (np.minimum(first, other), np.maximum(first, other))


def _assembled(values: Sequence[Any], positions: Sequence[tuple[IntArray, IntArray]], shape: tuple[int, int]) -> Any:
    """A sparse matrix whose entries are sums of values at the same position."""
    ca = casadi()
    rows = np.concatenate([row for row, _ in positions])
    columns = np.concatenate([column for _, column in positions])
    flat = columns.astype(np.int64) * shape[0] + rows
    distinct, entry = np.unique(flat, return_inverse=True)
    gather = sp.csc_matrix((np.ones(len(flat)), (entry, np.arange(len(flat)))), (len(distinct), len(flat)))
    sparsity = ca.Sparsity.triplet(*shape, (distinct % shape[0]).tolist(), (distinct // shape[0]).tolist())
    return ca.MX(sparsity, ca.densify(ca.mtimes(ca.DM(gather), ca.vertcat(*values))))
