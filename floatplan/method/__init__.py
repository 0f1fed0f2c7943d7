"""The paper's planner, to be read beside the paper: for any tree of links in a plane.

Pinocchio gives momentum and torques with their derivatives, ProxQP solves the quadratic programs; nothing is the
kernel's, which tests hold to this. Numbers in parentheses are the paper's equations, as ``docs/theory/paper.md``
corrects them. SI units and rad throughout; ``x_by_y`` are derivatives.

q, theta_0, h   angles of the n joints, orientation of the base, angular momentum about the centre of mass
D_0, ..., D_n   the momentum that a unit rate of theta_0, q_1, ..., q_n makes, (4)
p, b, z         polynomials of (12), their coefficients, and what (13) leave free of them
s               the time as a share of the flight, [0, 1]
u               the state ``(q, q', q'', h, theta_0)`` at an instant, 3n + 2 numbers
x               variables (m,) of the search: z and, where h is free, its share of the way to an end of (9)
"""

from floatplan.method.planner import plan

__all__ = ["plan"]
