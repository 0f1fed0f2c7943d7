"""The method, step by step: the paper's planner, `floatplan.method`, on the paper's two examples.

A chain of links has left the ground. Motors turn its joints; no motor turns its base, which answers to the joints
because the angular momentum h about the centre of mass stays what it was. So n motors are to bring n + 1 angles to a
goal. E. Papadopoulos, I. Fragkos and I. Tortopidis, "On Robot Gymnastics Planning with Non-zero Angular Momentum"
(ICRA 2007) say how. Numbers in brackets are their equations.
"""

from pathlib import Path

import numpy as np

import floatplan as fp
from floatplan.method.dynamics import Dynamics
from floatplan.method.program import Program
from floatplan.method.sqp import minimise

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"


def show(title: str, plan: fp.Plan) -> None:
    """Print what a plan came to."""
    torques = ", ".join(f"{peak:.3f}" for peak in plan.peaks.torque)
    print(f"{title}: {plan.status}, |b| = {plan.objective_value:.4f}, torques reach {torques} N m")


# Example A: into a new configuration. First the momentum that rates of base and joints make, (4).
problem = fp.load_problem(PROBLEMS / "new_configuration.toml")
joints = len(problem.robot.joints)
(D,) = Dynamics(problem.robot).momentum_map(problem.initial.positions[None, :, None])
print(f"(4)    at the start, D = {D.round(4)} kg m^2")

# The h of (10) is the middle of (9). The paper says 0.13 kg m^2/s, and so does the file.
midpoint = fp.load_problem(PROBLEMS / "new_configuration_midpoint.toml")
low, high = fp.method.plan(midpoint).angular_momentum_bounds or (0.0, 0.0)
h = problem.flight.momentum_in_plane
assert not isinstance(h, str), "the file has a number"
print(f"(9)    h between {low:.4f} and {high:.4f}, middle (10) {(low + high) / 2:.4f}; here {h:.4f} kg m^2/s")

# The joints' motions: sine functions of polynomials (12) that meet both ends (13), whatever the variables z are.
program = Program(problem, np.array(problem.degrees), np.zeros(joints, dtype=np.int64))
print(f"(16)   degrees {problem.degrees}: {program.size} variables are left for the one equation (14)")

# With quintics alone, z = 0, the base ends elsewhere, (14); b of least length (17) bring it there.
nowhere = np.zeros(0)  # inequalities hold at no instant
quintics = np.zeros(program.size)
plain = program.evaluate(quintics, nowhere)
print(f"(14)   quintics miss the orientation by {plain.rows[0]:+.4f} rad")
x, solution, steps = minimise(program, quintics, nowhere)
b = program.b(x[:, None])[..., 0]
assert abs(solution.rows[0]) < 1e-9
print(f"(17)   {steps} steps take the base there to less than 1e-9 rad, with |b| = {np.linalg.norm(b):.4f}")

# All of that in one call, with the torques (A.1) that it takes.
show("example A", fp.method.plan(problem))

# Example B: a handstand, without the pole and past it, (23).
show("example B without the pole", fp.method.plan(PROBLEMS / "handstand.toml"))
past = fp.method.plan(PROBLEMS / "obstacle.toml")
show("example B", past)
print(f"(23)   {1000 * (past.peaks.clearance or 0.0):.1f} mm from the pole; {fp.certify(past).verdict}")
