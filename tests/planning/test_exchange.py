"""Exchange: minima between the nodes are found, solved motions hold there, nodes suffice for the orientation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from independent import Look
from sampled_flight import sample_also, sample_nodes, trajectory, values_of

import floatplan as fp
from floatplan.motion.planar.flight import gauss_grid
from floatplan.motion.quadrature import NODE_COUNTS
from floatplan.planning.search import Search

DENSE = 1024
ERROR = 1e-9  # rad, that quadrature may leave of theta0(T)


def attempts(problem: fp.Problem) -> Search:
    return Search(problem)


@pytest.fixture(scope="module")
def obstructed(root) -> fp.Problem:
    return fp.load_problem(root / "problems" / "obstacle.toml")


class TestLocalMinima:
    def test_without_constraints_nothing_is_near(self, root):
        ready = attempts(fp.load_problem(root / "problems" / "handstand.toml"))
        found = ready.judge(ready.plain_start, "feasible").worst
        assert found.least == np.inf
        assert len(found.s) == 0

    @pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
    def test_they_are_true_values_below_those_of_a_dense_look(self, root, share):
        """Of the plain motion, with a disc in the path of its centre of mass."""
        problem = fp.load_problem(root / "problems" / "handstand.toml")
        time = np.array([share * problem.flight.duration])
        center = problem.path.positions(time)[0]
        disc = fp.Circle(center=(float(center[0]), float(center[1])), radius=0.05)
        ready = attempts(replace(problem, obstacles=(disc,)))
        start = ready.plain_start
        found = ready.judge(start, "feasible").worst
        form = start.variables.polynomials.form
        dense = trajectory(ready.spec.flight, start.variables, sample_nodes(gauss_grid(DENSE), form), start.x)
        assert found.least <= min(values_of(block, dense).min() for block in ready.spec.constraints) < 0
        there = sample_also(sample_nodes(gauss_grid(96), form), found.s)
        motion = trajectory(ready.spec.flight, start.variables, there, start.x)
        true = [values_of(ready.spec.constraints[block], motion)[96:] for block in found.block]
        values = [rows[index, row] for index, (rows, row) in enumerate(zip(true, found.row, strict=True))]
        assert values == pytest.approx(found.value.tolist(), abs=1e-9)


class TestSolve:
    def test_constraints_hold_between_the_nodes(self, obstructed):
        ready = attempts(obstructed)
        result = ready.follow(ready.plain_start)
        assert result.status == "optimal"
        dense = sample_nodes(gauss_grid(DENSE), result.variables.polynomials.form)
        motion = trajectory(ready.spec.flight, result.variables, dense, result.x)
        for block in ready.spec.constraints:
            assert values_of(block, motion).min() >= -block.tolerance
        assert motion.residual.item() == pytest.approx(0.0, abs=1e-6)

    def test_stopped_at_once_it_takes_what_it_has(self, obstructed):
        ready = attempts(obstructed)
        result = ready.follow(ready.plain_start, lambda: True)
        assert result.status != "optimal"
        assert result.iterations == 0
        assert np.isfinite(result.x).all()


@pytest.mark.parametrize("name", ["new_configuration", "handstand", "somersault"])
def test_the_nodes_that_a_motion_is_judged_on_integrate_the_orientation(planned, name):
    ready = attempts(planned(name).problem)
    start = ready.plain_start
    judged = ready.judge(start, "feasible")
    form = start.variables.polynomials.form
    finest = trajectory(ready.spec.flight, start.variables, sample_nodes(gauss_grid(NODE_COUNTS[-1]), form), start.x)
    assert judged.level < len(NODE_COUNTS) - 1
    assert judged.missed.item() == pytest.approx(finest.residual.item(), abs=ERROR)


def test_the_plan_s_orientation_is_that_of_an_independent_integration(planned):
    plan = planned("obstacle")
    end = Look(plan, np.array([plan.duration])).orientation[0]
    assert end == pytest.approx(plan.final_orientation, abs=1e-9)
