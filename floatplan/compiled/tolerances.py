"""What the kernel's sequential quadratic programming keeps to: the constants of ``Settings`` and ``Exchange``."""

from __future__ import annotations

from dataclasses import dataclass

# Of the line search and of the approximation of the Hessian.
ARMIJO = 1e-4  # [-] sufficient decrease of the merit function, Nocedal and Wright p. 540
PENALTY_FACTOR = 1.2  # [-] of the l1 merit function's penalty over the largest multiplier
PENALTY_KEPT = 0.25  # [-] of a penalty's excess over what is required, in the next iteration
SHORTEST_STEP = 1e-6  # [-] step length relative to the first; below it the line search has failed
SHORTENING = (0.1, 0.5)  # [-] least and largest factor from one step length to the next
LARGEST_MULTIPLIER = 1e12  # [-] relative to the slack penalty; beyond it the constraints' derivatives are rounding
SLOW_EVALUATIONS = 5  # of one line search: with more than these it is slow
SLOW_STEPS = 5  # in a row, after which the Hessian approximation is reset, and the second time the solver stops
DAMPING = 0.2  # [-] of Powell's damped BFGS, Nocedal and Wright (18.14)
SLACK_PENALTY = 1e3  # [-] of an elastic QP, relative to the Hessian's largest diagonal entry
LARGEST_CURVATURE = 1e10  # [-] of a BFGS update, relative to the slack penalty; beyond it an approximation is rejected
POLISHING_STEPS = 2
POLISHED = 1e-12  # in its own unit, of an equality: hardly more than rounding
# Of quadratic programs and elastic steps.
QP_CHANGES = 400  # of active rows, by the dual method
QP_TOLERANCE = 1e-10  # in its own unit, by which a row may be violated by what the dual method finds
ELASTIC_ITERATIONS = 80  # of Newton's method
REGULARISATION = 1e-12  # [-] of the elastic system, relative to the slack penalty
# Of the restoration, which reduces violations.
ITERATIONS = 60
FEASIBLE = 1e-11  # in the units of the rows: root of the sum of squared violations, at which the iteration ends
STALL_ITERATIONS = 6  # within which the squared violation must fall below STALLED
STALLED = 0.8  # [-] of the squared violation before
LEAST_GAIN = 0.03  # [-] of the squared violation: a step damped no more than the first that is to gain less is stuck
FAR = 1e-4  # of the squared violation, below which the iteration goes on all the same: what is so near may still hold
INITIAL_DAMPING = 1e-2  # [-] weight of the squared step
SMALLEST_DAMPING = 1e-8  # [-]
LARGEST_DAMPING = 1e8  # [-] beyond it the iteration ends
PASSES = 4  # of one step, each with the rows that the step before would violate
# Of the program and the exchange of instants.
LEAST_CURVATURE = 1e-3  # of a Gauss-Newton approximation, relative to its largest
BACK_OFF = 2e-7  # of each row's scale: the search keeps this far inside, so that its plan holds between instants too
LEAST_SCALE = 1e-6  # [-] of an objective
GIVEN = 1e-9  # of the flight: nearer to its ends than that, nothing moves that is not given
NEAR = 0.05  # of a row's scale: local minima above this are left alone
INSIDE_ENOUGH = 0.5  # of what the search aims inside: nothing is nearer to its limit between the nodes
TIGHT = 10 * BACK_OFF  # of violation: below it there may be no room to be inside
WATCHED = 0.005  # of a row's scale: local minima below this become instants of the next round
SAME_INSTANT = 1e-6  # of the duration
BESIDE = 0.02  # of the duration: how far a local minimum is taken to move from one round to the next
CHEAP = 192  # bodies times nodes, below which the time of an evaluation hardly depends on them


@dataclass(frozen=True)
class Settings:
    """When to stop, and how far to trust a step.

    Parameters
    ----------
    feasibility : largest violation of a constraint at a solution
    optimality : relative change of the Lagrangian that a full step still promises at a solution
    iterations : most QPs
    longest_step : of ``|metric @ step|``
    """

    feasibility: float = 1e-9
    optimality: float = 1e-9
    iterations: int = 100
    longest_step: float = 0.5
