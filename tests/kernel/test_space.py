"""Trees in space as the kernel moves them, against Pinocchio: momentum, torques in free flight, their derivatives."""

import numpy as np
import pinocchio as pin
import pytest

from floatplan.kernel.library import kernel as loaded
from floatplan.motion.spatial.dynamics import SpatialDynamics
from floatplan.robot.urdf.base import FREE_FLYER as BASE

JOINTS = (  # as many kinds as there are, the rest drawn
    pin.JointModelRX(),
    pin.JointModelRY(),
    pin.JointModelRZ(),
    pin.JointModelPX(),
    pin.JointModelPZ(),
    pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
    pin.JointModelPrismaticUnaligned(np.array([0.0, 0.8, -0.6])),
)
INSTANTS = 11  # not a multiple of how many are computed at once


def drawn_tree(seed):
    """A tree on a free base whose joints turn and slide, with rotors; some coupled, one held."""
    rng, model = np.random.default_rng(seed), pin.Model()
    model.gravity = pin.Motion.Zero()
    at = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    for number in rng.permutation(len(JOINTS)):
        parent = int(rng.integers(1, model.njoints))
        at = model.addJoint(parent, JOINTS[number], pin.SE3.Random(), f"joint {number}")
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    model.armature = np.concatenate((np.zeros(BASE), rng.uniform(0, 0.2, len(JOINTS))))
    selection = np.eye(len(JOINTS))[:, :-2]
    selection[-1, 0] = -0.5
    return SpatialDynamics(model, rng.normal(size=len(JOINTS)), selection)


@pytest.fixture(params=range(3))
def dynamics(request, monkeypatch):
    """A tree, for each set of instructions that there is."""
    if request.param > loaded().instructions:
        pytest.skip("this processor has no such instructions")
    monkeypatch.setattr(loaded(), "instructions", request.param)
    pin.seed(request.param)
    return drawn_tree(request.param)


def drawn_state(dynamics):
    rng, n = np.random.default_rng(7), dynamics.selection.shape[1]
    return [rng.normal(size=(INSTANTS, size)) for size in (n, n, n, 3)]


def momentum_slopes(dynamics, positions, velocities, rates):
    """Derivatives (K, 3, n) of ``I omega + A q'`` by the planned positions, at rates omega (K, 3)."""
    joints = len(dynamics.selection)
    shapes = {"inertia": (3, 3), "joint_map": (3, joints), "slopes": (3, joints)}
    found = dynamics.computed(positions, velocities, np.zeros_like(velocities), rates, **shapes)
    return found["slopes"] @ dynamics.selection


def torque_slopes(dynamics, *state):
    """Derivatives of torques by planned positions, velocities, accelerations, (K, J, n), and by the base's rates."""
    joints = len(dynamics.selection)
    shapes = {"torques": (joints,), "base_acceleration": (BASE,), "torque_slopes": (joints, 3 * joints + 3)}
    by_all = dynamics.computed(*state, **shapes)["torque_slopes"]
    by_joints = [by_all[..., d * joints : (d + 1) * joints] @ dynamics.selection for d in range(3)]
    return *by_joints, by_all[..., 3 * joints :]


def test_momentum_is_that_of_pinocchio(dynamics):
    model, data = dynamics.model, dynamics.data
    positions, velocities, _, rates = drawn_state(dynamics)
    inertia, joint_map = dynamics.momentum_maps(positions)
    slopes = momentum_slopes(dynamics, positions, velocities, rates)
    moving = dynamics.full_velocities(velocities, rates)
    for k, q in enumerate(dynamics.configurations(positions)):
        expected = pin.computeCentroidalMap(model, data, q)[3:BASE]
        assert np.allclose(inertia[k], expected[:, 3:BASE], rtol=1e-12, atol=1e-12)
        assert np.allclose(joint_map[k], expected[:, BASE:] @ dynamics.selection, rtol=1e-12, atol=1e-12)
        none = np.zeros(model.nv)
        by_position = pin.computeCentroidalDynamicsDerivatives(model, data, q, moving[k], none)[0][3:BASE, BASE:]
        assert np.allclose(slopes[k], by_position @ dynamics.selection, rtol=1e-11, atol=1e-11)


def test_torques_are_those_that_leave_no_wrench_on_the_base(dynamics):
    state = drawn_state(dynamics)
    torques, base = dynamics.torques(*state), dynamics.base_accelerations(*state)
    moving = dynamics.full_velocities(state[1], state[3])
    for k, q in enumerate(dynamics.configurations(state[0])):
        full = np.concatenate((base[k], dynamics.selection @ state[2][k]))
        forces = pin.rnea(dynamics.model, dynamics.data, q, moving[k], full)
        assert np.allclose(forces, np.concatenate((np.zeros(BASE), torques[k])), rtol=1e-11, atol=1e-11)


def test_their_derivatives_are_those_of_differences(dynamics):
    state, step = drawn_state(dynamics), 1e-6
    for which, slopes in enumerate(torque_slopes(dynamics, *state)):
        for column in range(state[which].shape[1]):
            ends = []
            for sign in (1, -1):
                moved = [each.copy() for each in state]
                moved[which][:, column] += sign * step
                ends.append(dynamics.torques(*moved))
            assert np.allclose(slopes[..., column], (ends[0] - ends[1]) / (2 * step), rtol=1e-6, atol=1e-6)
