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
from floatplan.jumps.spatial.impact import after_impact
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.setup import spatial_setup
from floatplan.jumps.spatial.stance import SpatialGrid, SpatialStance

FRICTION = 0.6


@pytest.fixture(scope="module", params=["points", "rolling"])
def setup(request):
    """A Go2 that jumps by a quarter turn, and may land with 0.5 m/s."""
    problem = fp.load_problem(PROBLEMS / "jumps" / "space" / "go2_quarter_turn.toml")
    landing = replace(problem.jump.landing, impact=0.5)
    asked = replace(problem.jump, feet=request.param, landing=landing)
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
    assert len(names) == 4
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


def test_rates_before_the_impact_have_limits(setup):
    program = setup.program(jumps.COARSE)
    low, high = program.box
    np.testing.assert_array_equal(high[program.arrival.rates[BASE:]], program.bounds.velocity)
    np.testing.assert_array_equal(low[program.arrival.rates[BASE:]], -program.bounds.velocity)
    kinds = {label.partition(" of ")[0] for label in program.assembly.labels if label.endswith("(touchdown)")}
    assert kinds == {"balance", "impact", "fall", "friction", "torque"}


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
