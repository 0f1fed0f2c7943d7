"""The paper's planner, to be read beside the paper: for any tree of links in a plane.

Pinocchio gives momentum and torques with their derivatives, ProxQP solves the quadratic programs; nothing is the
kernel's, which tests hold to this. Numbers in parentheses are the paper's equations, as ``docs/theory/paper.md``
corrects them. The state u of the robot at an instant is ``(q, q', q'', h, theta_0)``, 3n + 2 numbers in SI units and
rad. A quantity of an instant comes with its derivatives by u; Q is what a quantity has of values, m the variables.
"""

from floatplan.method.planner import plan

__all__ = ["plan"]
