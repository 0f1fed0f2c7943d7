"""Pieces of a program: functions of a few variables with sparse derivatives, mapped over nodes and intervals.

All nodes of a kind share one expression, its Jacobian and its Hessian, evaluated for all of them at once. What they
give is put into the program's own sparse matrices by constant ones: so a program of thousands of variables is built in
the time of its few kinds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
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
    def rows_and_cost(self) -> Any:
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
    parameter_values : (p, N)
    low, high : (m, N) bounds
    labels : (m,) for a person
    """

    expression: Expression
    indices: IntArray
    parameter_values: Array
    low: Array
    high: Array
    labels: tuple[str, ...]

    def variables_in(self, x: Any) -> Any:
        """Its expression's variables (w, N) at all N instants, among the program's x."""
        width, count = self.indices.shape
        return casadi().reshape(x[self.indices.ravel(order="F").tolist()], width, count)

    def mapped(self, function: Any, x: Any) -> Any:
        """Values, at all N instants, of a function of an instant's variables and parameters."""
        return function.map(self.indices.shape[1])(self.variables_in(x), casadi().DM(self.parameter_values))


class Assembly:
    """Rows and cost of all pieces, with derivatives, as functions of the program's variables x (size,).

    The cost has a proximal term, ``rho / 2 sum_k weights_k (x_k - near_k)^2``, whose ``near`` and ``rho`` are the
    program's parameters.

    Attributes
    ----------
    low, high : bounds (rows,)
    labels : (rows,) for a person
    weights : (size,) of the proximal term
    problem : symbols of IPOPT's problem, by CasADi's names
    evaluate : function of x and the parameters to the rows
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
        cost = 0.0
        of_pieces = []
        for piece in pieces:
            rows, costs = piece.mapped(piece.expression.rows_and_cost, x)
            of_pieces.append(ca.vec(rows))
            cost += ca.sum2(costs)
        rho = parameters[size]
        offset = x - parameters[:size]
        cost += rho / 2 * ca.dot(offset, ca.DM(weights) * offset)
        rows = ca.vertcat(*of_pieces)
        self.problem = {"x": x, "p": parameters, "f": cost, "g": rows}
        self.evaluate = ca.Function("rows", [x, parameters], [rows])

    @cached_property
    def first_derivatives(self) -> dict[str, Any]:
        """Functions of IPOPT's problem, by CasADi's option names; made where a search needs them."""
        ca = casadi()
        x = self.problem["x"]
        parameters = self.problem["p"]
        offset = x - parameters[: self.size]
        gradient = self._gradient_of_pieces() + parameters[self.size] * (ca.DM(self.weights) * offset)
        values = []
        positions = []
        begin = 0
        for piece in self.pieces:
            row_count, count = piece.low.shape
            jacobian = piece.expression.jacobian
            places = np.arange(count)[:, None] * row_count + jacobian.row + begin
            values.append(ca.vec(piece.mapped(jacobian.function, x)))
            positions.append((places.ravel(), piece.indices[jacobian.column].T.ravel()))
            begin += piece.low.size
        jacobian_of_rows = _assembled(values, positions, (begin, self.size))
        names = ["x", "p"]
        symbols = [x, parameters]
        of_cost = [self.problem["f"], gradient]
        of_rows = [self.problem["g"], jacobian_of_rows]
        return {
            "grad_f": ca.Function("nlp_grad_f", symbols, of_cost, names, ["f", "grad_f_x"]),
            "jac_g": ca.Function("nlp_jac_g", symbols, of_rows, names, ["g", "jac_g_x"]),
        }

    def _gradient_of_pieces(self) -> Any:
        """Gradient (size,) of what all pieces cost."""
        ca = casadi()
        x = self.problem["x"]
        gradients = [ca.vec(piece.mapped(piece.expression.gradient, x)) for piece in self.pieces]
        indices = np.concatenate([piece.indices.ravel(order="F") for piece in self.pieces])
        shape = (self.size, len(indices))
        gather = sp.csc_matrix((np.ones(len(indices)), (indices, np.arange(len(indices)))), shape)
        return ca.densify(ca.mtimes(ca.DM(gather), ca.vertcat(*gradients)))

    @cached_property
    def functions(self) -> dict[str, Any]:
        """First and second derivatives; the latter take most of the time."""
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


def _curvature(piece: Piece, x: Any, of_cost: Any, of_rows: Any) -> tuple[Any, tuple[IntArray, IntArray]]:
    """Entries of the Lagrangian's Hessian from a piece, and their positions in the upper triangle."""
    ca = casadi()
    count = piece.indices.shape[1]
    row_count = piece.low.shape[0]
    curvature = piece.expression.curvature
    entries = curvature.function.map(count)(
        piece.variables_in(x),
        ca.DM(piece.parameter_values),
        ca.repmat(of_cost, 1, count),
        ca.reshape(of_rows, row_count, count),
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
