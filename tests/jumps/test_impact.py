"""Feet that come to the ground with speed: what an impact does to the rates of a robot, and what a check says of it."""

import math
from dataclasses import replace

import jumps
import numpy as np
import pinocchio as pin
import pytest
from places import PROBLEMS

import floatplan as fp
from floatplan.jumps.check import FIGURES
from floatplan.jumps.motion import JumpState
from floatplan.jumps.spatial.guess import guess_near
from floatplan.jumps.spatial.impact import after_impact
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.stance import SpatialGrid, SpatialStance

FRICTION = 0.6


KINDS = {  # feet -> robot, and [jump] feet
    "points": ("go2", "points"),
    "balls": ("go2", "rolling"),
    "soles": ("g1", "auto"),
}


@pytest.fixture(scope="module", params=KINDS)
def setup(request):
    """A robot that jumps by a quarter turn, and may land with 0.5 m/s."""
    robot, feet = KINDS[request.param]
    problem = fp.load_problem(PROBLEMS / "jumps" / "space" / f"{robot}_quarter_turn.toml")
    landing = replace(problem.jump.landing, impact=0.5)
    asked = replace(problem.jump, feet=feet, landing=landing)
    return spatial_setup(replace(problem, jump=asked), asked)


@pytest.fixture(scope="module")
def falling(setup):
    """A robot that comes down on its feet as it stands, (3, 6+n, 1), turning and moving its joints a little."""
    rng = np.random.default_rng(5)
    motion = np.zeros((3, setup.ends.y.shape[1], 1))
    motion[0, :, 0] = setup.ends.standing
    motion = setup.mechanics.from_centre(motion)
    motion[1, :, 0] = rng.uniform(-0.2, 0.2, motion.shape[1])
    motion[1, 2] = -2.0  # m/s
    return motion


def momenta(mechanics, motion, about):
    """Kinetic energy, J, and angular momentum about a point, kg m^2/s."""
    q, v, _ = mechanics.coordinates(motion)
    model = mechanics.model
    energy = pin.computeKineticEnergy(model, mechanics.data, q[0], v[0])
    of_robot = pin.computeCentroidalMomentum(model, mechanics.data, q[0], v[0])
    arm = mechanics.data.com[0] - about
    return energy, of_robot.angular + np.cross(arm, of_robot.linear)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_feet_that_land_neither_move_nor_slip_afterwards(setup, falling, count):
    mechanics = setup.mechanics
    names = [foot.name for foot in setup.feet][:count]
    after = after_impact(mechanics, falling, names)
    places, rates, _ = mechanics.feet(after, names)
    np.testing.assert_allclose(rates, 0.0, atol=1e-12)
    np.testing.assert_array_equal(after[0], falling[0])
    assert np.abs(mechanics.feet(falling, names)[1]).max() > 1.0
    contact = places[0, 0] - [0.0, 0.0, setup.feet[0].radius]
    energies, about_foot = zip(*(momenta(mechanics, motion, contact) for motion in (falling, after)), strict=True)
    assert 0 < energies[1] < energies[0]
    is_alone = count == 1  # then the impulse has no moment about it
    assert (np.abs(about_foot[1] - about_foot[0]).max() < 1e-9) == is_alone
    np.testing.assert_allclose(after_impact(mechanics, after, names), after, atol=1e-11)


def test_the_program_s_impulses_are_those_of_pinocchio(setup, falling):
    """With the rates that Pinocchio has after an impact there are impulses with which the program's rows vanish."""
    program = setup.program(jumps.COARSE)
    names = [foot.name for foot in program.arrival.feet]
    assert set(names) == {foot.name for foot in setup.feet}
    raw = np.zeros(program.size)
    begin = program.begins[program.borders[program.flight + 1]]
    n = program.model.size
    labels = np.array(program.assembly.labels)
    of_impact = labels == "balance of impulses (touchdown)"
    assert np.count_nonzero(of_impact) == n

    def from_centre(motion):
        centres, _ = setup.mechanics.centre(motion)
        moved = motion[:, :, 0].copy()
        moved[:, :3] = centres[:, :, 0]
        return moved

    def least_residual(after):
        """What is left of the rows with the best impulses, of which they are affine."""
        raw[begin : begin + n] = from_centre(falling)[0]
        raw[begin + n : begin + 2 * n] = from_centre(after)[1]
        raw[program.arrival.rates] = from_centre(falling)[1]

        def rows(impulses):
            raw[program.arrival.impulses] = impulses
            return np.asarray(program.assembly.evaluate(raw, np.zeros(program.size + 1))).ravel()[of_impact]

        count = len(program.arrival.impulses)
        without = rows(np.zeros(count))
        effects = np.stack([rows(unit) - without for unit in np.eye(count)], axis=1)
        return np.abs(without + effects @ np.linalg.lstsq(effects, -without, rcond=None)[0]).max()

    after = after_impact(setup.mechanics, falling, names)
    assert least_residual(after) < 1e-12
    assert least_residual((after + falling) / 2 * np.array([1.0, 1.001, 1.0])[:, None, None]) > 1e-5


@pytest.fixture(scope="module")
def stance(setup, falling):
    """On all feet, from where the robot falls on."""
    y, v, a = np.repeat(falling, 2, axis=2)
    grid = SpatialGrid(np.array([0.0, 1.0]), y, v, a, np.zeros((3 * len(setup.feet), 2)))
    robot = setup.problem.robot
    return SpatialStance(robot, setup.mechanics.gravity, setup.axes, tuple(setup.feet), FRICTION, grid)


def state(mechanics, motion):
    """A motion at one instant, of which nobody bears anything."""
    q, v, a = mechanics.coordinates(motion)
    return JumpState(np.zeros(1), q, v, a, {}, np.zeros_like(v), {})


def test_the_check_sees_what_no_impulses_explain(setup, stance, falling):
    mechanics = setup.mechanics
    names = [foot.name for foot in setup.feet]
    after = after_impact(mechanics, falling, names)
    before, landed = (state(mechanics, motion) for motion in (falling, after))
    speed, unbalanced = stance.impact(before, landed, FRICTION)
    assert speed == pytest.approx(np.linalg.norm(mechanics.feet(falling, names)[1], axis=2).max(), rel=1e-9)
    assert unbalanced < 1e-9
    slippery = stance.impact(before, landed, 0.01)[1]
    assert slippery > 1e-3, "these impulses are outside of a narrow cone"
    for joint in range(BASE, BASE + 3):
        other = after.copy()
        other[1, joint] += 0.5  # rad/s, most of which impulses explain that would leave the foot moving
        assert stance.impact(before, state(mechanics, other), FRICTION)[1] > FIGURES["impulse"].limit
    lifted = falling.copy()
    lifted[1] = 2 * after[1] - falling[1]  # it bounces: the ground's impulses would be twice as large
    assert stance.impact(before, state(mechanics, lifted), FRICTION)[1] < 1e-9
    pulled = stance.impact(state(mechanics, after), before, FRICTION)[1]
    assert pulled > 0.1, "the ground does not pull"
    for number in (np.nan, np.inf, 1e300):
        other = replace(landed, velocities=np.full_like(landed.velocities, number))
        assert not stance.impact(before, other, FRICTION)[1] < 1.0


@pytest.fixture(scope="module")
def landed():
    """An A1 that jumps down, and lands with speed."""
    return jumps.stored_jump("a1_down_high")


def test_a_jump_lands_with_speed(landed):
    """Its flight ends with other rates than those with which its landing begins; places are the same."""
    assert landed.ok, landed.explanation
    figures = landed.check.figures
    assert 1.0 < figures["impact"] <= landed.request.landing.impact
    assert figures["impulse"] < 1e-7
    assert figures["landing_seam"] < 1e-8
    before = landed.at([landed.flight_span[1]])
    after = landed.after[0].at(np.array([landed.after[0].span[0]]))
    np.testing.assert_allclose(after.positions[:, :3], before.positions[:, :3], atol=1e-9)
    assert np.abs(after.velocities - before.velocities).max() > 1.0


def changed_landing(jump, row, change):
    """The jump with another rate at the first instant of its landing."""
    stance = jump.after[0]
    v = stance.grid.v.copy()
    v[row, 0] += change
    return replace(jump, after=(replace(stance, grid=replace(stance.grid, v=v)), *jump.after[1:]))


@pytest.mark.parametrize(
    ("figure", "spoil"),
    [
        ("impulse", lambda jump: changed_landing(jump, 2, 0.3)),
        ("impulse", lambda jump: replace(jump, request=replace(jump.request, friction=0.1))),
        ("impact", lambda jump: with_impact(jump, 1.0)),
        ("landing_seam", lambda jump: with_impact(jump, 0.0)),
    ],
)
def test_the_check_refuses_another_impact(landed, figure, spoil):
    spoilt = spoil(landed)
    assert not spoilt.check.ok
    assert spoilt.check.figures[figure] > FIGURES[figure].limit_of(spoilt.request)


def with_impact(jump, impact):
    """The jump as if its feet might land with so much speed."""
    return replace(jump, request=replace(jump.request, landing=replace(jump.request.landing, impact=impact)))


def test_a_search_near_it_begins_with_its_rates_before_and_after(landed):
    setup = jumps.setup_in_space("a1_down_high")
    program = setup.program(jumps.COARSE)
    raw = guess_near(program, setup.mechanics, landed)
    solution = program.solution(jumps.stored_solution("a1_down_high"), 0, converged=True)
    guessed = program.solution(raw, 0, converged=True)
    touchdown = program.borders[program.flight + 1]
    change = np.abs(solution.arrival[0] - solution.v[:, touchdown]).max()
    assert change > 5.0  # rad/s, of which exact stances change a tenth between so few nodes
    assert np.abs(guessed.v[:, touchdown] - solution.v[:, touchdown]).max() < 0.1 * change
    assert np.abs(guessed.arrival[0] - solution.arrival[0]).max() < 0.1 * change


def test_rates_before_the_impact_have_limits(setup):
    program = setup.program(jumps.COARSE)
    low, high = program.box
    np.testing.assert_array_equal(high[program.arrival.rates[BASE:]], program.bounds.velocity)
    np.testing.assert_array_equal(low[program.arrival.rates[BASE:]], -program.bounds.velocity)
    kinds = {label.partition(" of ")[0] for label in program.assembly.labels if label.endswith("(touchdown)")}
    of_soles = {"pressure"} if setup.feet[0].suffix else set()
    assert kinds == {"balance", "impact", "fall", "friction", "torque"} | of_soles


def test_finer_programs_begin_with_the_same_arrival(setup):
    coarse, fine = (setup.program(replace(jumps.COARSE, refinement=share)) for share in (0.3, 0.4))
    raw = np.random.default_rng(3).normal(size=coarse.size)
    resampled = fine.resampled(coarse.solution(raw, 0, converged=True), coarse)
    np.testing.assert_array_equal(resampled[fine.arrival.variables], raw[coarse.arrival.variables])


@pytest.mark.parametrize("impact", [-0.1, 10.5, math.inf, math.nan, "fast"])
def test_other_speeds_are_refused(impact):
    with pytest.raises(fp.InputError) as error:
        fp.JumpLanding(impact=impact)
    assert error.value.element.endswith("impact")
