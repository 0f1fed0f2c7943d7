"""Every constraint and objective of a flight in a plane: the kernel's derivatives against differences.

Values, and derivatives a second time, are held to a reference in NumPy and to Pinocchio in ``tests/kernel``.
"""

import numpy as np
import pytest
from kernel_program import KernelProgram
from robot_samples import URDF_FOLDER

import floatplan as fp
from floatplan import tables
from floatplan.motion.flight import flight_of
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.constraints import QUANTITIES
from floatplan.planning.kernel_input.rows import SumRows
from floatplan.planning.search import Search
from floatplan.planning.variables import decision_variables

AROUND = (
    fp.Circle(center=(0.3, 1.2), radius=0.2, margin=0.02, velocity=(0.4, -0.2)),
    fp.HalfPlane(point=(0.0, -0.3), normal=(0.1, 1.0), margin=0.01),
    fp.Bar(start=(0.2, 0.5), end=(0.4, 1.4), radius=0.03, velocity=(0.1, 0.3), window=(0.2, 0.8)),
)
LIMITS = {"velocity": 20.0, "acceleration": 300.0, "torque": 30.0, "orientation_rate": 4.0}
ENDS = {  # objective, what the accelerations are at takeoff and landing, and whether rates there follow from a free h
    "given": ("acceleration", [1.0, 0.0, -2.0], 0.0, False),
    "free at takeoff": ("coefficients", "free", 0.0, True),
    "free at landing": ("coefficients", 0.0, "free", True),
    "free": ("torque", "free", "free", True),
}
INSTANTS = np.array([0.0, 0.123, 0.5, 0.77, 1.0])  # besides the nodes; both ends among them


def test_every_limit_and_objective_of_the_tables_is_among_them():
    assert set(LIMITS) == set(tables.LIMIT_TABLE)
    assert {objective for objective, *_ in ENDS.values()} == set(tables.OBJECTIVES)


@pytest.fixture(params=ENDS)
def program(request):
    """A flight of four links with everything that can move: h free, unequal degrees, and as many rows as there are."""
    objective, at_takeoff, at_landing, following = ENDS[request.param]
    start = fp.Posture(1.4, [0.3, -0.2, -2.0], "takeoff" if following else [0.3, -0.5, 0.2], at_takeoff)
    goal = fp.Posture(3.4, [0.9, -1.0, -0.7], "landing" if following else [0.0, 0.4, -0.3], at_landing)
    problem = fp.Problem(
        fp.Robot.from_urdf(URDF_FOLDER / "high_jumper.urdf", armature=0.3),
        start,
        goal,
        fp.Flight(0.9, "free", fp.Takeoff("foot"), fp.Landing("hand", 0.8), horizontal_velocity=-2.0),
        fp.Motion([7, 9, 7], objective),
        fp.Limits(**LIMITS, motor={"q1": fp.Motor(50.0, 2.0)}),
        obstacles=AROUND,
        self_clearances=(fp.SelfClearance(("shank", "arms"), 0.05),),
    )
    branches = np.array([[0, 0, 0], [0, 1, -1]])
    variables = decision_variables(problem, problem.degrees, branches, flight_of(problem).momentum_set)
    assert (variables.momentum.axes.shape[1], bool(variables.following)) == (1, following)
    return KernelProgram(problem, NODE_COUNTS.index(24), tuple(INSTANTS), variables)


def assert_derivative(values, derivative, x, scale):
    """Fourth-order central differences of values (...) by x against a derivative (..., size).

    Steps are in units of ``scale``: a column of it is a sensible change of x.
    """
    step = 1e-3
    for column in scale.T:
        ahead, behind, far_ahead, far_behind = (values(x + n * step * column) for n in (1, -1, 2, -2))
        expected = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * step)
        size = max(1.0, float(np.abs(expected).max()))
        assert np.abs(derivative @ column - expected).max() < 1e-6 * size


def test_every_kind_of_constraint_is_among_its_rows(program):
    limited = set()
    kept_clear = set()
    for block in Search(program.problem).spec.constraints:
        if isinstance(block.rows, SumRows):
            limited |= block.rows.weights.keys()
        else:
            kept_clear.add(type(block.rows.between))
    assert limited == QUANTITIES.keys() - {"torques"}  # those of joints that have followers
    assert kept_clear == {tuple, *(type(obstacle) for obstacle in AROUND)}


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_are_those_of_differences(program, seed):
    """Of all rows, (14) and the objective by every variable, at a random motion with h anywhere within (9)."""
    variables, rng = program.of, np.random.default_rng(seed)
    z = rng.normal(scale=0.3, size=(3, variables.polynomials.width))
    x = variables.variables(z, variables.momentum.centre + variables.momentum.axes @ rng.uniform(-1, 1, 1))
    here, scale = program.evaluate(x), 0.01 * np.linalg.inv(variables.metric)
    assert len(here.inequality) > 500
    assert_derivative(lambda at: program.evaluate(at).equality, here.equality_jacobian, x, scale)
    assert_derivative(lambda at: program.evaluate(at).inequality, here.inequality_jacobian, x, scale)
    assert_derivative(lambda at: np.array(program.evaluate(at).objective), here.gradient, x, scale)
    eigenvalues = np.linalg.eigvalsh(program.whole(x)["hessian"])
    assert eigenvalues.min() > 1e-6 * eigenvalues.max()
