"""Exchange: minima between the nodes are found, solved motions hold there, nodes suffice for the orientation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from general_flight import general_flight
from independent import Look

import floatplan as fp
from floatplan.motion.planar.closed_form import ballistics
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.attempt import Attempts
from floatplan.planning.transcription.exchange import local_minima, solve
from floatplan.planning.transcription.program import objective
from floatplan.planning.transcription.trajectory import FlightModel, sample_also, sample_nodes, trajectory
from floatplan.tolerances import QUADRATURE_ERROR

DENSE = 1024
ERROR = 1e-9  # rad, that quadrature may leave of theta0(T)


def attempts(problem: fp.Problem) -> Attempts:
    return Attempts(problem, 0)


@pytest.fixture(scope="module")
def obstructed(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "obstacle.toml")


class TestLocalMinima:
    def test_without_constraints_nothing_is_near(self, root):
        ready = attempts(fp.load_problem(root / "problems" / "handstand.toml"))
        start = ready.plain_start
        found = local_minima(ready.model, start.variables, ready.constraints, NODE_COUNTS.index(64), start.x)
        assert found.least == np.inf
        assert len(found.s) == 0

    @pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
    def test_they_are_true_values_below_those_of_a_dense_look(self, root, share):
        """Of the plain motion, with a disc in the path of its centre of mass."""
        problem = fp.load_problem(root / "problems" / "handstand.toml")
        time = np.array([share * problem.flight.duration])
        center = ballistics(problem).positions(time)[0]
        disc = fp.Circle(center=(float(center[0]), float(center[1])), radius=0.05)
        ready = attempts(replace(problem, obstacles=(disc,)))
        start = ready.plain_start
        found = local_minima(ready.model, start.variables, ready.constraints, NODE_COUNTS.index(96), start.x)
        form = start.variables.polynomials.form
        nodes = sample_nodes(gauss_grid(DENSE), form)
        dense = trajectory(ready.model, start.variables, nodes, start.x)
        assert found.least <= min(block.values(dense).min() for block in ready.constraints) < 0
        there = sample_also(sample_nodes(gauss_grid(96), form), found.s)
        motion = trajectory(ready.model, start.variables, there, start.x)
        true = [ready.constraints[block].values(motion)[96:] for block in found.block]
        values = [rows[index, row] for index, (rows, row) in enumerate(zip(true, found.row, strict=True))]
        assert values == pytest.approx(found.value.tolist(), abs=1e-9)


class TestSolve:
    def solved(self, problem):
        ready = attempts(problem)
        ready.model = FlightModel(general_flight(problem))
        start = ready.plain_start

        def make_objective(nodes):
            return objective(problem, ready.model, start.variables, nodes)

        return ready, start, solve(ready.model, start.variables, make_objective, ready.constraints, start.x)

    def test_constraints_hold_between_the_nodes(self, obstructed):
        ready, start, solution = self.solved(obstructed)
        assert solution.status == "optimal"
        dense = sample_nodes(gauss_grid(DENSE), start.variables.polynomials.form)
        motion = trajectory(ready.model, start.variables, dense, solution.x)
        for block in ready.constraints:
            assert block.values(motion).min() >= -block.tolerance
        assert motion.residual.item() == pytest.approx(0.0, abs=1e-6)

    def test_stopped_at_once_it_takes_what_it_has(self, obstructed):
        ready = attempts(obstructed)
        start = ready.plain_start
        solution = solve(
            FlightModel(general_flight(obstructed)),
            start.variables,
            lambda nodes: objective(obstructed, ready.model, start.variables, nodes),
            ready.constraints,
            start.x,
            stop=lambda: True,
        )
        assert solution.status != "optimal"
        assert solution.iterations <= 1 + len(NODE_COUNTS)
        assert np.isfinite(solution.x).all()


class TestNodesNeeded:
    @pytest.mark.parametrize("name", ["new_configuration", "handstand", "somersault"])
    def test_they_integrate_the_orientation(self, planned, name):
        plan = planned(name)
        ready = attempts(plan.problem)
        form = ready.plain_start.variables.polynomials.form
        start = ready.plain_start
        rough = trajectory(ready.model, start.variables, sample_nodes(gauss_grid(NODE_COUNTS[-1]), form), start.x)
        enough = NODE_COUNTS[rough.flown.level_needed(QUADRATURE_ERROR)]
        motion = trajectory(ready.model, start.variables, sample_nodes(gauss_grid(enough), form), start.x)
        assert motion.residual.item() == pytest.approx(rough.residual.item(), abs=ERROR)

    def test_a_smaller_error_never_needs_fewer(self, obstructed):
        ready = attempts(obstructed)
        variables = ready.plain_start.variables
        wild = 3 * np.random.default_rng(6).normal(size=variables.size)
        motion = trajectory(ready.model, variables, sample_nodes(gauss_grid(32), variables.polynomials.form), wild)
        levels = [motion.flown.level_needed(error) for error in (1e-2, 1e-5, 1e-8, 1e-11)]
        assert levels == sorted(levels)
        assert levels[0] < levels[-1]


def test_the_plan_s_orientation_is_that_of_an_independent_integration(planned):
    plan = planned("obstacle")
    end = Look(plan, np.array([plan.duration])).orientation[0]
    assert end == pytest.approx(plan.final_orientation, abs=1e-9)
