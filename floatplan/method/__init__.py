"""The paper's planner, written to be read beside the paper: for any tree of links in a plane.

Pinocchio gives the momentum and the torques with their derivatives, ProxQP solves the quadratic programs, and nothing
here is the kernel's, which tests hold to this package. Numbers in parentheses are the paper's equations, as corrected
in ``docs/theory/paper.md``; the pages of the theory quote these modules.

==============  ====================================================================================================
dynamics        (4), (11), (14), (15): rates of the base; (A.1): torques; (20)-(22): places of the links
motion          (12), (13), (17): sine polynomials between given ends, in variables whose length is that of b
clearance       (19), (23): distances of links to obstacles
program         (14), (17), (18), (23): the nonlinear program at some instants
sqp             its solution
planner         (10), and the search: starts, instants that are added, the verdict
==============  ====================================================================================================

The state u of the robot at an instant is ``(q, q', q'', h, theta_0)``, 3n + 2 numbers in SI units and radians; every
quantity of an instant comes with its derivatives by u.
"""

from floatplan.method.planner import plan

__all__ = ["plan"]
