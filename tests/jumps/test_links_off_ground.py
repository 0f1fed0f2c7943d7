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
from floatplan.jumps.spatial import planner
from floatplan.jumps.spatial.flight import merged_levels
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.standing import feet_links, shank_points

HEIGHT = 2e-3  # [m] that links should have
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


def test_points_are_as_low_as_the_shank_in_every_tilt(solo):
    robot = solo.problem.robot
    points = shank_points(robot, solo.feet, HEIGHT)
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
        low = true_heights < HEIGHT - ROOM
        assert low.sum() > 20
        assert (true_heights[low] > 1e-3).all()  # whatever the tilt: the foot carries it
        assert (of_points[low] < HEIGHT).all()
        assert (of_points[low] - true_heights[low] < ROOM).all()
        assert (of_points >= true_heights - 1e-9).all()


def test_shanks_that_are_thinner_than_their_feet_have_no_points(root):
    problem = fp.load_problem(root / "problems" / "jumps" / "space" / "a1_roll.toml")
    setup = spatial_setup(problem, problem.jump)
    assert shank_points(problem.robot, setup.feet, HEIGHT) == []


def test_rows_of_a_shank_above_a_foot_that_stands_do_not_change_with_what_it_is_off_its_place(solo):
    """At nodes feet are off by up to millimetres: rows are about what is left of it in the exact stance, the tilt."""
    margins = replace(planner.MARGINS, refinement=0.3, shank_height=HEIGHT)
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
    of_shanks = np.array([use == "shank" for use in uses])
    assert of_shanks.any()
    assert np.abs(raised - level)[of_shanks].max() < 1e-12
    assert raised[~of_shanks] - level[~of_shanks] == pytest.approx(0.002)
    assert program._least_heights(kind, 2)[of_shanks] * program.height == pytest.approx(HEIGHT)


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
    programs = [SimpleNamespace(shank_points=0.0)]
    anew = []

    def program_of(margins):
        def solve(raw):
            anew.append(raw)
            return SimpleNamespace(converged=True)

        programs.append(SimpleNamespace(shank_points=margins.shank_height, solve=solve))
        return programs[-1]

    setup = SimpleNamespace(problem=solo.problem, request=solo.request, feet=solo.feet, program=program_of)
    made = iter(rounds)
    monkeypatch.setattr(planner, "jump_of_solution", lambda *_: next(made))
    monkeypatch.setattr(planner, "guess", lambda program: program)
    monkeypatch.setattr(planner, "solved_again", lambda finer, *_: (finer, "solution"))
    start = planner.Start(setup, planner.MARGINS, programs[0], "solution")
    assert planner.checked_jump(start, 0) is rounds[returned]
    assert [program.shank_points for program in programs] == pytest.approx(heights)
    assert anew == programs[1:2]  # the first one with such rows; others begin with the solution before


def test_a_check_that_fails_asks_for_no_rows_of_shanks(solo, monkeypatch):
    """Nor does a request without clearance."""
    monkeypatch.setattr(planner, "solved_again", lambda finer, *_: (finer, "solution"))

    def heights(request, *made):
        programs = [SimpleNamespace(shank_points=0.0)]

        def program_of(margins):
            programs.append(SimpleNamespace(shank_points=margins.shank_height))
            return programs[-1]

        setup = SimpleNamespace(problem=solo.problem, request=request, feet=solo.feet, program=program_of)
        results = iter(made)
        monkeypatch.setattr(planner, "jump_of_solution", lambda *_: next(results))
        found = planner.checked_jump(planner.Start(setup, planner.MARGINS, programs[0], "solution"), 0)
        assert found is made[-1]
        return [program.shank_points for program in programs]

    assert heights(solo.request, Stub(False, 0.001), Stub(False, -0.1), Stub(True, 0.003)) == [0.0, 0.0, 0.0]
    assert heights(replace(solo.request, clearance=0.0), Stub(True, 0.0001)) == [0.0]


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
