"""Variables of a jump's program, their values in a solution, what ties them where stances meet; its numbers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from floatplan.arrays import Array
from floatplan.jumps.model import anchor_force, casadi
from floatplan.jumps.phases import Phase
from floatplan.jumps.rows import NodeRows, Rows
from floatplan.jumps.separation import TOLERATED_SHORTFALL
from floatplan.tables import POINT_FEET

FOOT_LIFT = 0.02  # [m] of feet in the middle of the flight
LOW_FOOT_LIFT = 2 * POINT_FEET  # [m] of hops that do not reach that: the legs of slow motors extend by 0.5 m/s at most
ITERATIONS = 250  # [-] of IPOPT: 40 to 125 find a first solution where there is one, more those near conflicting limits


@dataclass(frozen=True)
class ProgramSettings:
    """Numbers of the program.

    Attributes
    ----------
    cone_margin : of the weight, by which forces stay inside the cone, but at nodes where contacts change
    base_range : of the base's orientation beyond its start and goal, rad
    base_rate : largest rate of the base, rad/s
    roughness : weight of steps of accelerations, relative to the squared torques
    smoothness : weight of squared torques, relative to the factor
    steadiness : weight of steps of accelerations, relative to the squared torques, where the factor counts
    onset : time in which the ground's force may grow by the weight, s: feet land by so much late and early
    abruptness : cost of the square of force over the weight beyond that; 3 to 100 make little difference
    abruptness_of_shares : the same where the factor counts: 10 takes 1 to 6 % of the limits more, and of 40 disturbed
        landings of a Go2 no more stand than with 1 (21 and 21, of which 14 and 18 only on their feet)
    rounding : of the weight, by which the corner of that cost is rounded
    largest_factor : that is looked for
    violation : of constraints, scaled, that IPOPT aims at; a last iterate with which it does not converge counts as a
        solution where it is within that
    converged_violation : the same where it does converge; it relaxes bounds by 1e-8, so that rows which bind are off by
        as much, 1.0000005e-8 for instance
    """

    cone_margin: float = 0.02
    base_range: float = 1.5
    base_rate: float = 40.0
    roughness: float = 3e-4
    smoothness: float = 0.03
    steadiness: float = 1e-3
    onset: float = 0.012
    abruptness: float = 10.0
    abruptness_of_shares: float = 1.0
    rounding: float = 0.02
    largest_factor: float = 20.0
    violation: float = 1e-8
    converged_violation: float = 1e-6


PROGRAM = ProgramSettings()


def ipopt_options(iterations: int, flight_is_fixed: bool, warm: bool) -> dict[str, Any]:
    """Options of IPOPT for programs of a few thousand variables."""
    options = {"print_level": 0, "sb": "yes", "tol": 1e-6, "constr_viol_tol": PROGRAM.violation}
    options["mu_strategy"] = "adaptive"
    options["max_hessian_perturbation"] = 1e6  # more takes seconds an iteration
    options["mumps_mem_percent"] = 20  # beyond what MUMPS expects: of ten times that, most time went to the system
    options["mumps_pivot_order"] = 0  # approximate minimum degree, with which it is faster than with what it chooses
    options["max_iter"] = iterations
    if flight_is_fixed:  # guesses nearly hold
        options["adaptive_mu_globalization"] = "never-monotone-mode"
    if warm:  # the guess nearly holds, and is near the best
        options |= {"mu_strategy": "monotone", "mu_init": 1e-4, "mu_target": 1e-4}
        options |= {"bound_push": 1e-5, "bound_frac": 1e-5, "max_iter": 80}
    return options


@dataclass
class Variables:
    """Variables of a program as matrices of their own units: expressions, numbers, or their bounds (2, ..).

    Attributes
    ----------
    y, v, a : (n+1, K+1) at all nodes
    forces : of each phase (2 (contacts - 1), nodes of the phase), N, of its contacts but the anchor
    closing_accelerations : of each phase (conditions, 2) at its begin and end, scaled accelerations
    durations : (phases, 1) s
    momenta : (flights, 1) h of each flight, kg m^2/s
    factor : (1, 1) on limits; (0, 1) where squared torques are minimised
    """

    y: Any
    v: Any
    a: Any
    forces: list[Any]
    closing_accelerations: list[Any]
    durations: Any
    momenta: Any
    factor: Any

    @classmethod
    def of(cls, matrices: Sequence[Any]) -> Self:
        """Of all matrices in order."""
        y, v, a, *of_phases, durations, momenta, factor = matrices
        count = len(of_phases) // 2
        return cls(y, v, a, of_phases[:count], of_phases[count:], durations, momenta, factor)

    def limit_labels(self, phases: Sequence[Phase], of_nodes: Iterable[int], joints: Sequence[str]) -> Self:
        """Of shapes, what bounds of variables are about; "" where that is no limit. Phases ``of_nodes`` are indices."""
        labels = self.map(lambda shape: np.full(shape, "", object))
        for node, index in enumerate(of_nodes):
            for row, name in enumerate(joints):
                labels.y[1 + row, node] = f"range of {name} ({phases[index].name})"
                labels.v[1 + row, node] = f"rate of {name} ({phases[index].name})"
        for row, phase in enumerate(phases):
            labels.durations[row, 0] = f"duration of ({phase.name})"
        return labels

    def matrices(self) -> list[Any]:
        """All in order."""
        of_phases = [*self.forces, *self.closing_accelerations]
        return [self.y, self.v, self.a, *of_phases, self.durations, self.momenta, self.factor]

    def map(self, function: Callable[[Any], Any]) -> Self:
        """What a function makes of each."""
        return self.of([function(matrix) for matrix in self.matrices()])


@dataclass(frozen=True, eq=False)
class JumpSolution:
    """Values at the K+1 nodes of a jump.

    Attributes
    ----------
    y, v, a : (n+1, K+1)
    forces : for each phase (2 (contacts - 1), nodes of the phase) N, of its contacts but the anchor
    durations : (phases,) s
    momenta : (flights,) h of each flight, kg m^2/s
    factor : largest share of a limit, where that is minimised; else 1
    worst : largest violation of a constraint, scaled; and which it is
    shortfall : of distances, m, where all else holds, though the cost may not be least; else infinite
    iterations : int
    overloaded : locked joints that bear too much in the first feasible motion, at which the search stopped
    """

    y: Array
    v: Array
    a: Array
    forces: tuple[Array, ...]
    durations: Array
    momenta: Array
    factor: float
    worst: tuple[float, str]
    shortfall: float
    iterations: int
    overloaded: tuple[str, ...] = ()

    @property
    def is_motion(self) -> bool:
        """Whether it is a motion to go on with; IPOPT need not have converged.

        Rows hold, distances fall short by no more than is tolerated, and no locked joint without a row bears too much.
        """
        return self.shortfall <= TOLERATED_SHORTFALL and not self.overloaded


def bound_forces(box: Array, phase: Phase, towards_flight: Phase, least: float) -> None:
    """Set bounds (2, 2 others, nodes) N of forces: at ``least`` upwards, N; none where a contact leaves or comes."""
    box[0, 1::2] = least * phase.force_shares
    seam = -1 if phase.side == "takeoff" else 0
    stays = [contact.name for contact in towards_flight.contacts]
    for row, contact in enumerate(phase.others):
        if contact.vertical:
            box[:, 2 * row] = 0.0
        if contact.name not in stays:
            box[:, 2 * row : 2 * row + 2, seam] = 0.0


def bound_ends(box: Variables, phases: Sequence[Phase], ends: Array, begin_rates: Array | None) -> None:
    """Set bounds of the motion where a jump stands, as in its ``ends``, or where it begins in motion.

    Where it begins with rates (n+1,) rad/s, its accelerations are free.
    """
    for node in (0, -1):
        if phases[node].contacts:
            box.y[:, :, node] = ends[node]
            box.v[:, :, node] = 0.0
            box.a[:, :, node] = 0.0
    if begin_rates is not None:
        box.v[:, :, 0] = begin_rates
        box.a[:, :, 0] = np.array([[-np.inf], [np.inf]])


def add_meeting(rows: Rows, node_rows: NodeRows, index: int, variables: Variables, periodic: bool) -> None:
    """Add rows where a stance ends and the next begins: equal forces; of a periodic jump's ends an equal motion.

    What stands there is the same, but seen from another anchor. With the motion given one number is free, by which
    the feet press against one another: a horizontal force.

    Parameters
    ----------
    index : of the stance among the phases, as :func:`meets_next` says
    periodic : whether the jump ends as it begins
    """
    phases = node_rows.phases
    following = (index + 1) % len(phases)
    one = phases[index]
    two = phases[following]
    motion = (variables.y, variables.v, variables.a)
    if periodic and not following:
        change = (node_rows.ends[-1] - node_rows.ends[0], 0.0, 0.0)  # whole turns
        for order, (values, by) in enumerate(zip(motion, change, strict=True)):
            rows.add(node_rows.time_unit**order * (values[:, -1] - values[:, 0] - by), 0.0, 0.0, "periodic")
    if not one.others:
        return
    forces = casadi().SX.sym("forces", 2 * len(one.others))
    own, pairs = anchor_force(node_rows.model, one, forces)
    by_name = dict(zip([contact.name for contact in one.contacts], [own, *pairs], strict=True))
    function = node_rows.model.function("horizontal", [by_name[two.others[0].name][0]], forces)
    node = int(node_rows.first_nodes[index + 1])
    (before,) = rows.at_nodes(function, *(values[:, node] for values in motion), variables.forces[index][:, -1])
    after = variables.forces[following][0, 0]
    rows.add((before - after) / node_rows.weight, 0.0, 0.0, f"forces ({one.name})")


def onset_cost(load: Any, times: Any, abruptness: float) -> Any:
    """Cost (1, nodes) of ground forces that grow at once, at times (1, nodes) s from the landing on.

    A foot that lands late is pressed down without a ground below it, and hits it the faster the more force it was to
    bear by then: what the load is beyond one weight in ``onset`` costs, by its ``abruptness``.
    """
    beyond = load - times / PROGRAM.onset
    positive = (beyond + casadi().sqrt(beyond**2 + PROGRAM.rounding**2)) / 2
    return abruptness * positive**2
