"""What is in the way where a search has no jump in space: the limits that bind at its last iterate.

There limits hold, or nearly, and motion, balance or positions do not, by violations c of rows with the Jacobian J.
Along ``-J^T c`` these would become less. What keeps the search from there are limits next to their bounds: what of
``-J^T c`` points out of them is a sum of their gradients with multipliers that are not negative. The larger the
multiplier, the more the violations would become less were its limit wider.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from floatplan.arrays import Array
from floatplan.jumps.conflicts import KINDS, allowed, kind_of
from floatplan.jumps.spatial.model import BASE
from floatplan.jumps.spatial.nodes import SpatialSolution
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.jumps.spatial.setup import SpatialSetup
from floatplan.problem.jump import JumpRequest
from floatplan.problem.problem import Problem


class BindingLimit(NamedTuple):
    """A limit that binds.

    Attributes
    ----------
    label : of its row, for a person
    kind : of limit
    bound : rad, s or m, of a range, an angle, a duration or a height; elsewhere over what the program is scaled by
    weight : by how much the violations become less where it is wider by its size, to first order
    """

    label: str
    kind: str
    bound: float
    weight: float


def shortfall(program: SpatialProgram, nearest: SpatialSolution, problem: Problem, request: JumpRequest) -> str:
    """Return what is farthest from what is required at the last iterate, and the limits that bind there.

    The request is that of the program: a problem whose flight is met by a single stance has none of its own.
    """
    sentence = f"In the nearest this is farthest from what is required: {nearest.worst[1]}."
    binding = binding_limits(program, nearest.raw)
    if binding:
        sentence += f" In the way: {'; '.join(binding_sentence(limit, problem, request) for limit in binding)}."
    return sentence


def binding_limits(program: SpatialProgram, raw: Array) -> list[BindingLimit]:
    """Return the limits that bind at variables (size,), of each kind the one with the largest weight, it first.

    There are none where all rows hold.
    """
    margin = 0.02  # [-] of a limit's size, within which it binds
    minor = 0.1  # [-] of the largest weight: limits with less hardly count
    assembly = program.assembly
    row_values, derivative = assembly.first_derivatives["jac_g"](raw, np.zeros(program.size + 1))
    jacobian = derivative.sparse().tocsr()
    values = np.concatenate((np.asarray(row_values).ravel(), raw))
    box_low, box_high = program.box
    low = np.concatenate((assembly.low, box_low))
    high = np.concatenate((assembly.high, box_high))
    labels = [*assembly.labels, *_variable_labels(program)]
    kinds = np.array([kind_of(label) for label in labels])
    spatial_kinds = ("distance", "pressure", "leeway", "tilt", "least force", "impact")
    is_limit = np.isin(kinds, (*KINDS, *spatial_kinds)) & (low < high)
    sizes = _sizes(low, high)

    # Where the violations of all else descend most steeply, in variables scaled as the proximal term has them.
    count = len(assembly.labels)
    scales = np.where(box_low < box_high, 1 / np.sqrt(assembly.weights), 0.0)
    violations = np.maximum(values - high, 0.0) - np.maximum(low - values, 0.0)
    violations[is_limit] = 0.0
    descent = -scales * (jacobian.T @ violations[:count])

    below = np.flatnonzero(is_limit & (values < low + margin * sizes))
    above = np.flatnonzero(is_limit & (values > high - margin * sizes))
    limits = np.concatenate((below, above))
    if not len(limits) or not np.abs(violations).max() > 1e-6:  # as of rows of a solution
        return []
    outward = np.zeros((len(limits), program.size))
    of_rows = limits < count
    outward[of_rows] = jacobian[limits[of_rows]].toarray()
    outward[~of_rows, limits[~of_rows] - count] = 1.0
    outward *= np.repeat([-1.0, 1.0], [len(below), len(above)])[:, None] * scales
    multipliers, _ = nnls(outward.T, descent)

    weights = multipliers * sizes[limits]
    bounds = np.concatenate((low[below], high[above]))
    binding: dict[str, BindingLimit] = {}
    for index in np.argsort(-weights):
        kind = str(kinds[limits[index]])
        if weights[index] > minor * weights.max() and kind not in binding:
            bound = float(bounds[index]) * (program.height if kind == "ground" else 1.0)
            binding[kind] = BindingLimit(labels[limits[index]], kind, bound, float(weights[index]))
    return list(binding.values())


def _sizes(low: Array, high: Array) -> Array:
    """What a change of limits by a share of 1 is: half of their range, or else the bound itself."""
    narrow = 0.05  # [rad, s; -] what a size counts as at least
    bound = np.where(np.isfinite(low), low, high)
    finite = np.isfinite(low) & np.isfinite(high)
    half_range = np.subtract(high, low, out=np.zeros_like(low), where=finite) / 2
    sizes = np.where(finite, half_range, np.where(np.isfinite(bound), np.abs(bound), 0.0))
    return np.asarray(np.maximum(sizes, narrow))


def _variable_labels(program: SpatialProgram) -> list[str]:
    """Labels (size,) of the variables' bounds; empty where a bound is no limit of the robot."""
    labels = [""] * program.size
    n = program.model.size
    for node, begin in enumerate(program.begins[:-1].tolist()):
        where = program.phases[program.phase_of[node]].name
        for index, joint in enumerate(program.model.robot.joints):
            labels[begin + BASE + index] = f"range of {joint} ({where})"
            labels[begin + n + BASE + index] = f"rate of {joint} ({where})"
        labels[begin + 4] = f"tilt of the base's middle angle ({where})"
        if program.bounds.leeway < np.inf:
            labels[begin + 3] = f"leeway of the base's first angle ({where})"
            labels[begin + 5] = f"leeway of the base's last angle ({where})"
        if program.bounds.least_force > 0.0:
            for index, foot in enumerate(program.kinds[node].bearing):
                labels[begin + 3 * n + 3 * index + 2] = f"least force of {foot.name} ({where})"
    if program.arrival.feet:
        for joint, variable in zip(program.model.robot.joints, program.arrival.rates[BASE:].tolist(), strict=True):
            labels[variable] = f"rate of {joint} (touchdown)"
    first = program.size - len(program.phases)
    for index, phase in enumerate(program.phases):
        labels[first + index] = f"duration of ({phase.name})"
    return labels


def binding_sentence(limit: BindingLimit, problem: Problem, request: JumpRequest) -> str:
    """What is all that a limit leaves, in the words of a problem's file."""
    most, unit = allowed(limit.label, limit.kind, problem, request)
    if most:
        return f"{limit.label}, with all of the {most:.3g}{unit} that are allowed"
    if limit.kind == "distance":
        return f"{limit.label}, which is the least"
    if limit.kind == "pressure":
        return f"{limit.label}, whose sole would tip"
    if limit.kind == "leeway":
        return f"{limit.label}, with all of the {request.leeway:.3g} rad that are allowed"
    if limit.kind == "tilt":
        return f"{limit.label}, with all of the {abs(limit.bound):.3g} rad that are allowed"
    if limit.kind == "impact":
        return f"{limit.label}, with all of the {request.landing.impact:.3g} m/s that are allowed"
    unit = {"range": "rad", "duration": "s", "least force": "of the weight"}.get(limit.kind, "m")
    return f"{limit.label}, which ends at {limit.bound:.3g} {unit}"


def touchdown_sentence(setup: SpatialSetup) -> str:
    """How fast a robot that jumps down comes to the ground with all feet at once, and what would do.

    Its feet stand still there, so that its joints fold as fast as its trunk comes down: with the rates that they may
    have, in the posture in which it stands, that is as after a fall from some height. It is empty where the ground
    falls by no more than that, where feet land one after the other, or with speed.
    """
    request = setup.request
    feet = setup.phases[-1].feet
    if setup.phases[-2].side != "flight" or request.rise >= 0 or request.landing.impact:
        return ""
    mechanics = setup.mechanics
    com_motion = np.zeros((3, setup.ends.y.shape[1], 1))
    com_motion[0, :, 0] = setup.ends.y[1]
    com_motion[1, 2] = -1.0  # [m/s] of the trunk
    standing = mechanics.from_centre(com_motion)
    places = mechanics.feet(standing, [foot.name for foot in feet])
    folding = mechanics.close(standing, dict(zip((foot.name for foot in feet), places[0, 0], strict=True)))
    limits = request.margin["velocity"] * setup.problem.velocity_limits
    speeds = limits / np.maximum(np.abs(folding[1, BASE:, 0]), 1e-9)  # joints that do not move limit nothing
    slowest = int(speeds.argmin())
    fall = float(speeds[slowest] ** 2 / (2 * mechanics.gravity))
    if -request.rise <= fall:
        return ""
    joint = setup.problem.robot.joints[slowest]
    return (
        f"Feet stand still where they land: all at once, with {limits[slowest]:.3g} rad/s of {joint}, they let it come"
        f" down with {speeds[slowest]:.2g} m/s where it stands, as after a fall of {fall:.2g} m; let it jump down less,"
        " or land with speed, by jump.landing.impact."
    )
