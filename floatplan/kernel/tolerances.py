"""The numbers that decide what a search or a correction does: tolerances, limits of work, weights.

One dataclass for each struct of numbers in ``kernel.h``, with the fields of that struct; Python that uses the same
number reads it here. In brackets the unit; then what the number does, and why it has this value where that is known.
What depends on the problem, or is a number of another package, is 0 here and filled in where the struct is made. None
of them is compared or printed: methods for that, of so many fields, would take 3 ms of every start of the program.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache


@dataclass(frozen=True, eq=False, repr=False)
class Stage:
    """When one stage of a search ends; the last one where no other numbers stand."""

    feasibility: float = 1e-9  # [unit of the row] largest violation of a constraint
    optimality: float = 1e-9  # [-] relative change of the Lagrangian that a full step still promises
    # [rad] of the attitude at landing that the nodes may leave; else the next level is used: less is rounding.
    quadrature_error: float = 1e-13
    iterations: int = 80  # [-] of SQP at most


FINE = Stage()


@dataclass(frozen=True, eq=False, repr=False)
class Settings:
    """SQP and its stages, and the starts of programs without rows.

    Equations of Nocedal and Wright, Numerical Optimization, 2nd ed.
    """

    stages: tuple[Stage, Stage, Stage] = (
        Stage(feasibility=1e-2, optimality=1e-1, quadrature_error=1e-6, iterations=50),
        Stage(feasibility=1e-6, quadrature_error=1e-6),
        FINE,
    )
    longest_step: float = 0.5  # [-] of the whitened variables
    coarsely_resolved: float = 0.02  # [-] what the first nodes may miss of the motion, relative to its size
    too_wild: float = 0.3  # [-] the same of a random motion; a wilder one is no start
    hopeless: float = 0.1  # [unit of the row] violation after the coarse stage, above which a fine one is wasted
    tolerance: float = 0.0  # [rad] of the attitude at landing, as the plan is judged by: ORIENTATION of tables.py
    unresolved: float = 1e-6  # [-] what the nodes may miss of a plan, relative to its size: its square is lost
    smallest_tail: float = 1e-16  # [-] of Legendre coefficients, relative to the largest value: rounding
    largest_tail: float = 0.9  # [-] the same: no decay can be read from more

    armijo: float = 1e-4  # [-] sufficient decrease of the merit function, p. 540
    penalty_factor: float = 1.2  # [-] of the l1 merit function's penalty over the largest multiplier
    penalty_kept: float = 0.25  # [-] of a penalty's excess over what is required, in the next iteration
    shortest_step: float = 1e-6  # [-] step length relative to the first; below it the line search has failed
    shortening: tuple[float, float] = (0.1, 0.5)  # [-] least and largest factor from one step length to the next
    largest_multiplier: float = 1e12  # [-] relative to the slack penalty; beyond it derivatives are rounding
    damping: float = 0.2  # [-] of Powell's damped BFGS, (18.14)
    slack_penalty: float = 1e3  # [-] of an elastic QP, relative to the Hessian's largest diagonal entry
    largest_curvature: float = 1e10  # [-] of a BFGS update, relative to the slack penalty; beyond it, it is rejected
    polished: float = 1e-12  # [unit of the row] of an equality, at which it is not polished: hardly more than rounding

    hopeless_way: float = 30.0  # [rad] root mean square of p: a start from which (14), if linear, is farther is left
    changed_branches: float = 0.8  # [-] share of joints of a candidate on another branch, where not all are tried
    step_to_rank: float = 1.0  # [rad] root mean square of p, longest step while candidates are ranked
    agreement: float = 0.003  # [-] relative difference of what is left of (14), below which starts ended equally near

    slow_evaluations: int = 5  # [-] of one line search: with more than these it is slow
    slow_steps: int = 5  # [-] in a row, after which the Hessian is reset, and the second time the solver stops
    polishing_steps: int = 2  # [-] on to the equalities alone, at the end
    most_rounds: int = 24  # [-] of SQP, each with other nodes or instants
    most_iterations: int = 240  # [-] in all rounds together
    first_level: int = 2  # of grids: with fewer nodes a search is hardly faster, and ends elsewhere more often
    levels: int = 0  # [-] of grids that there are: as many as NODE_COUNTS has
    finer: int = 2  # [-] levels of grids, from one to the next with twice the nodes

    level_of_starts: int = 1  # of grids, where candidates for starts are ranked
    candidates: int = 12  # [-] for starts, from which those are followed that promise most
    followed: int = 6  # [-] of these
    ranked_rounds: int = 2  # [-] of candidates; where all of these fail, what promises little is followed too
    steps_to_rank: int = 3  # [-] taken with each candidate, before they are compared
    easy_iterations: int = 40  # [-] of the plain start: with fewer of them other starts promise little
    wanted_after_failure: int = 4  # [-] solutions to choose from where the plain start did not converge quickly
    starts_to_agree: int = 16  # [-] after so many a problem is given up, where
    agreeing: int = 4  # [-] of them ended equally near to (14), and none nearer
    # [rad] standard deviations of random motions, in turn; beyond, few of them lead anywhere
    spreads_of_starts: tuple[float, ...] = (0.2, 0.4, 0.8, 1.6, 0.8, 1.6)


@dataclass(frozen=True, eq=False, repr=False)
class Exchange:
    """The search with inequalities: the exchange of instants, restoration, and the measure of work.

    Work is counted in instants of one body, 20 ns or so, so that it is the same on every machine.
    """

    back_off: float = 2e-7  # [-] of a row's scale: the search keeps so far inside, to hold between instants too
    reach: float = 1.1  # [-] of a row's scale: rows above have no derivatives, unless a step reaches them
    near_end: float = 1e-9  # [-] of the flight: nearer to its ends than that, a row cannot change
    inside_enough: float = 0.5  # [-] of back_off: no row may be nearer to its limit between the nodes
    tight: float = 2e-6  # [-] violation, ten times back_off: below it there may be no room to be inside
    watched: float = 0.005  # [-] of a row's scale: local minima below this become instants of the next round
    same_instant: float = 1e-6  # [-] of the flight: rows at one instant twice say nothing more
    beside: float = 0.02  # [-] of the flight: how far a local minimum may move from one round to the next
    promising: float = 1e-3  # [-] sum of squared violations, below which a motion is followed to the objective
    least_curvature: float = 1e-3  # [-] of a Gauss-Newton approximation, relative to its largest
    nearly_promising: float = 0.1  # [-] squared violations, below which restoration watches the motion more closely
    elastic_stalled: float = 0.95  # [-] of the violation stall_iterations elastic steps before: above, it is hopeless
    longest_free_step: float = 0.5  # [-] of the whitened variables, where there are no rows
    momentum_curvature: float = 1.0  # [-] of the objective by h, of which there is none, in the first Hessian
    between_left: float = 0.0  # [-] of the violation between the instants, to which rows are met in the next round

    feasible: float = 1e-11  # [unit of the row] root of the squared violations, at which restoration ends
    stalled: float = 0.8  # [-] of the squared violation stall_iterations before: above it restoration has stalled
    least_gain: float = 0.03  # [-] of the squared violation: a lightly damped step that gains less is stuck
    far: float = 1e-4  # [-] squared violation, below which restoration goes on all the same: it may still hold
    initial_damping: float = 1e-2  # [-] weight of the squared step, of Levenberg and Marquardt
    smallest_damping: float = 1e-8  # [-]
    largest_damping: float = 1e8  # [-] beyond it restoration ends
    regularisation: float = 1e-12  # [-] of the elastic system, relative to the slack penalty
    qp_tolerance: float = 1e-10  # [unit of the row] by which a row may be violated by what the dual method finds

    evaluation: float = 1000.0  # [instants of one body] work of a motion, whatever its size
    differentiation: float = 1500.0  # [instants of one body] work of a block of constraints, whatever its size
    entry: float = 0.5  # [instants of one body] work of an entry of a Jacobian
    solving: float = 0.0  # [instants of one body] work of an operation of a QP: in a plane they are small
    near_miss: float = 1e-3  # [-] violation, below which a motion that is not optimal is followed once more
    same: float = 1e-6  # [-] relative difference of objectives, below which two attempts ended at the same motion
    enough_work: float = 1e6  # [instants of one body] of starts that are followed in one call: about 0.02 s
    long_work: float = 3e5  # [instants of one body] of the first start, after which optima without rows are compared
    # [-] of that work, for these optima: a tenth of its time or less, for what needs no rows is counted too high.
    share_unconstrained: float = 0.2
    smallest_step: float = 0.02  # [m] that a link may travel between two nodes even beside a smaller obstacle
    least_scale: float = 1e-6  # [-] of an objective

    stall_iterations: int = 6  # [-] within which the squared violation must fall below stalled
    iterations: int = 60  # [-] of restoration
    passes: int = 4  # [-] of one step, each with the rows that the step before would violate
    elastic_iterations: int = 80  # [-] of Newton's method
    qp_changes: int = 400  # [-] of active rows, by the dual method
    most_instants: int = 256  # [-] beside the nodes
    cheap_level: int = 0  # of grids, up to which fewer nodes would hardly be faster: by the robot's number of bodies
    compiled_level: int = 3  # of the grid that a solution is evaluated on; a finer one judges it where that is needed
    constrained_level: int = 2  # of grids, at least, where constraints are watched
    closer: int = 2  # [-] levels of grids, by which constraints are watched more closely after the plain start
    watched_at_most: int = 6  # level of grids
    looked_ahead: float = 0.2  # [-] of a row's scale: a look along a step tells which of the rows above it reaches
    value_kept: float = 0.5  # [-] of a row's value: where a whole step leaves so much, it does not reach the row
    begins_with_active: int = 0  # whether a step's quadratic program begins with the rows of the step before


@dataclass(frozen=True, eq=False, repr=False)
class CorrectionOptions:
    """Corrections in flight, and the filter that estimates the robot's state."""

    gap_nodes: int = 5  # [-] of the quadrature between measurements
    memory: int = 64  # [-] motions that are remembered, for measurements that come late
    most_rows: int = 24  # [-] of a block that are looked at in a step
    evaluations_near: int = 1  # [-] of changed motions at most
    evaluations_far: int = 6  # [-] the same where the landing is far from the goal
    most_surprises: int = 5  # [-] to the same side, one after the other, that tell of a kick
    far: float = 0.06  # [rad] of the attitude at landing from the goal
    weighed: float = 10.0  # [-] sigmas of the landing at most, against limits: one farther off is approached in part
    settled: float = 0.1  # [-] of sigma, and of the cost: less is not worth a step
    shorter: float = 0.3  # [-] factor of a step that is no better
    kept: float = 1e-3  # [-] of a row's scale: one that is less below zero counts as kept
    taken_back: float = 0.1  # [-] of what earlier corrections changed and the landing does not need, by each
    scales: tuple[float, float] = (0.5, 0.25)  # [-] shares of a correction, tried where the whole breaks a limit
    angle_noise: float = 0.002  # [rad] of measured angles
    rate_noise: float = 0.04  # [rad/s] of measured rates, also by when they are measured: up to half a step later
    largest_error: float = 0.3  # [-] of masses and inertias that is believed
    surprising: float = 3.0  # [-] deviations of a momentum from what is expected
    believable: float = 5.0  # [-] deviations of an orientation from what is expected, at most
    outlier_noise: float = math.radians(1.0)  # [rad] of angles that are no outliers yet


WORK_IN_SPACE = 0.25  # [-] of an instant in the kernel, relative to one of a lifted motion, by which work is counted
MOST_STARTS = 65  # [-] of a problem without inequalities, the plain one and random ones, until one is solved
SETTINGS = Settings(slow_evaluations=4)  # without rows, lines of five evaluations lead into valleys rather than out
CONSTRAINED_SETTINGS = Settings(
    stages=(Stage(feasibility=1e-6, optimality=1e-5, iterations=50), FINE, FINE),
    longest_step=0.2,  # beyond an obstacle a long step lands
)
EXCHANGE = Exchange()
EXCHANGE_IN_SPACE = Exchange(
    entry=WORK_IN_SPACE * EXCHANGE.entry,
    solving=0.005,  # [instants of one body] variables may be a hundred and more
    closer=0,  # every start is a lifted motion, followed at once like the plain one
)


@cache
def near_recorded(exchange: Exchange) -> Exchange:
    """Return the same for the motion that is nearest to a recorded one.

    There the variables are differences in radians, hundredths mostly, and the multipliers of the rows as small: with a
    curvature of 1 by h, steps creep along h, each twice as long as the one before, 30 iterations rather than 10. The
    torques of a tree of 30 joints are costly: no round is solved further than the next one will move, and quadratic
    programs of 200 variables begin with the rows that were active.
    """
    return replace(exchange, momentum_curvature=1e-4, between_left=0.1, begins_with_active=1)


CORRECTION_OPTIONS = CorrectionOptions()
CORRECTION_OPTIONS_IN_SPACE = CorrectionOptions(
    evaluations_far=12,  # some of three numbers are hard to change: with 6 a Go2's half twist landed 0.9 deg off
)
