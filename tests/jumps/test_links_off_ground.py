"""Links beside the feet of jumps in space, and the ground of their flights: points, rows, the jump that is returned."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import capsule_world
import jumps
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import floatplan as fp
from floatplan.jumps.model import casadi
from floatplan.jumps.rounds import LINK_HEIGHT, NodeMargins, are_links_low
from floatplan.jumps.spatial import planner
from floatplan.jumps.spatial.flight import merged_levels
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.standing import feet_links, points_beside_feet

ROOM = 6e-4  # [m] by which a rim is lower than the points of it


@pytest.fixture(scope="module")
def solo(root):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / "solo12_roll.toml")
    return spatial_setup(problem, problem.jump)


def heights_where_it_tilts(reach_of, foot, upright):
    """Least heights of a leg's shape over the ground, m, its foot's point as high as it stands, of vertical directions.

    ``reach_of`` returns how far the shape reaches along directions (N, 3) in the frame of the foot's body.
    """
    return foot.depth - reach_of(-upright) - upright @ np.array(foot.local)


def test_points_beside_feet_are_as_low_as_the_shank_in_every_tilt(solo):
    robot = solo.problem.robot
    points = points_beside_feet(robot, solo.feet, LINK_HEIGHT)
    rng = np.random.default_rng(0)
    for foot in solo.feet:
        upright = rng.normal(size=(1200, 3))
        upright /= np.linalg.norm(upright, axis=1)[:, None]
        # Of legs that lean forwards or backwards by 45 degrees at most, and to the side by 80.
        upright = upright[(np.abs(upright[:, 0]) < 0.7) & (upright[:, 2] > 0.17)]
        shank = [
            solid for solid in robot.solids if solid.body == foot.body and solid.link not in feet_links(robot, [foot])
        ]
        true_heights = heights_where_it_tilts(
            lambda down, shank=shank: np.max([solid.reach(down) for solid in shank], axis=0), foot, upright
        )
        own = [point for point in points if point.body == foot.body]
        places = np.array([point.local for point in own])
        radii = np.array([point.radius for point in own])
        of_points = heights_where_it_tilts(
            lambda down, places=places, radii=radii: (down @ places.T + radii).max(axis=1), foot, upright
        )
        low = true_heights < LINK_HEIGHT - ROOM
        assert low.sum() > 20
        assert (true_heights[low] > 1e-3).all()  # whatever the tilt: the foot carries it
        assert (of_points[low] < LINK_HEIGHT).all()
        assert (of_points[low] - true_heights[low] < ROOM).all()
        assert (of_points >= true_heights - 1e-9).all()


def test_shanks_that_are_thinner_than_their_feet_have_no_points(root):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / "a1_roll.toml")
    setup = spatial_setup(problem, problem.jump)
    assert points_beside_feet(problem.robot, setup.feet, LINK_HEIGHT) == []


def test_rows_beside_a_foot_that_stands_do_not_change_with_what_it_is_off_its_place(solo):
    """At nodes feet are off by up to millimetres: rows are about what is left of it in the exact stance, the tilt."""
    margins = replace(planner.MARGINS, refinement=0.3, beside_feet=LINK_HEIGHT)
    program = solo.program(margins)
    kind = program.kinds[2]
    assert {foot.name for foot in kind.tracking} == {foot.name for foot in solo.feet}
    ca = casadi()
    uses = [use for _, use in program._heights(kind)]
    rows = ca.vertcat(*(row[0] for row in program._height_rows(kind)))
    heights_at = ca.Function("heights", [program.model.y], [rows * program.height])
    y = program.ends.y[0].copy()
    level = np.array(heights_at(y)).ravel()
    y[2] += 0.002
    raised = np.array(heights_at(y)).ravel()
    beside = np.array([use == "beside" for use in uses])
    assert beside.any()
    assert np.abs(raised - level)[beside].max() < 1e-12
    assert raised[~beside] - level[~beside] == pytest.approx(0.002)
    assert program._least_heights(kind, 2)[beside] * program.height == pytest.approx(LINK_HEIGHT)


@dataclass(eq=False)
class Stub:
    """What a round makes of a solution: whether the check holds, and the lowest link, m."""

    ok: bool
    ground: float

    @property
    def check(self):
        return SimpleNamespace(figures={"ground": self.ground})


@pytest.mark.parametrize(
    ("rounds", "returned", "heights"),
    [
        ([Stub(True, 0.0012), Stub(True, 0.0016)], 1, [0.0, 0.002]),
        ([Stub(True, 0.0012), Stub(True, 0.0014), Stub(False, -0.1)], 1, [0.0, 0.002, 0.002 + 1.5 * 0.0006]),
        ([Stub(True, 0.0012), Stub(False, 0.003)], 0, [0.0, 0.002]),
        ([Stub(True, 0.0012), Stub(True, 0.0011), Stub(True, 0.0010)], 0, [0.0, 0.002, 0.002 + 1.5 * 0.0009]),
        ([Stub(True, 0.0021)], 0, [0.0]),
    ],
)
def test_of_jumps_whose_check_holds_the_highest_is_returned(solo, monkeypatch, rounds, returned, heights):
    programs = [SimpleNamespace(beside_feet=0.0)]
    anew = []

    def program_of(margins):
        def solve(raw):
            anew.append(raw)
            return SimpleNamespace(converged=True)

        programs.append(SimpleNamespace(beside_feet=margins.beside_feet, solve=solve))
        return programs[-1]

    setup = SimpleNamespace(problem=solo.problem, request=solo.request, feet=solo.feet, program=program_of)
    made = iter(rounds)
    monkeypatch.setattr(planner, "jump_of_solution", lambda *_: next(made))
    monkeypatch.setattr(planner, "guess", lambda program: program)
    monkeypatch.setattr(planner, "solved_again", lambda finer, *_: (finer, "solution"))
    start = planner.Start(setup, planner.MARGINS, programs[0], "solution")
    assert planner.checked_jump(start, 0) is rounds[returned]
    assert [program.beside_feet for program in programs] == pytest.approx(heights)
    assert anew == programs[1:2]  # the first one with such rows; others begin with the solution before


def test_links_are_low_below_what_is_requested(solo):
    request = solo.request
    assert are_links_low(request, {"ground": 0.0012})
    assert not are_links_low(request, {"ground": LINK_HEIGHT})
    assert not are_links_low(request, {})
    assert not are_links_low(replace(request, clearance=0.0), {"ground": 0.0001})
    assert NodeMargins(1.0, 1.0, 1.0).tightened(request, {"ground": 0.01}).beside_feet == 0.0


def test_neighbouring_levels_become_one_at_the_lower_of_both():
    runs = [(0.0, 0.1, 0.0), (0.1, 0.2, 0.5), (0.2, 0.3, 0.7), (0.3, 0.4, 0.0)]
    assert merged_levels(runs, 4) == runs
    assert merged_levels(runs, 3) == [(0.0, 0.1, 0.0), (0.1, 0.3, 0.5), (0.3, 0.4, 0.0)]
    assert merged_levels(runs, 1) == [(0.0, 0.4, 0.0)]


def test_the_world_of_capsules_keeps_momenta_in_the_air():
    """Masses are 5 % off: the centre of mass is measured where it falls as a parabola, and momenta do not change."""
    roll = jumps.roll()
    world = capsule_world.World(roll, np.random.default_rng(1), 0.005)
    data = world.data
    in_flight = roll.takeoff_time + 0.1 * roll.flight.duration
    q, v = roll.q(np.array([in_flight]))[0], roll.v(np.array([in_flight]))[0]
    data.qpos[:7] = q[[0, 1, 2, 6, 3, 4, 5]]
    data.qpos[2] += 1.0  # far from the ground
    data.qpos[world.rows] = q[7:]
    data.qvel[:3] = pin.Quaternion(*q[[6, 3, 4, 5]]).matrix() @ v[:3]
    data.qvel[3:6] = v[3:6]
    data.qvel[world.columns] = v[6:]
    momenta = []
    rng = np.random.default_rng(2)
    for tick in range(100):
        world.measure(rng)
        momenta.append(data.subtree_angmom[0].copy())
        world.move(5.0 * np.sin(0.1 * tick + np.arange(len(world.names))))
    assert not world.touching()
    times = 2e-3 * np.arange(100)
    places, velocities = (np.array(column) for column in zip(*world.com, strict=True))
    fall = np.outer(times**2 / 2, mujoco.MjOption().gravity)
    assert places == pytest.approx(places[0] + np.outer(times, velocities[0]) + fall, abs=1e-4)
    assert np.abs(np.array(momenta) - momenta[0]).max() < 2e-3 * np.linalg.norm(momenta[0])
