"""The benchmark runs: every section, with as little to measure as there is."""

import pkgutil
import sys
from dataclasses import fields

import jumps
import numpy as np
import pytest
from general_flight import GeneralDynamics
from long_cases import cases
from needed import skip_or_fail
from scipy.spatial.transform import Rotation
from spoiled_hops import repaired_hop

import floatplan as fp
from floatplan.jumps.spatial.program import SpatialProgram
from floatplan.motion.spatial.dynamics import spatial_dynamics


@pytest.fixture(scope="module")
def benchmark(root):
    """The benchmark, its peers cut short."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(root / "scripts")
        import peers
        import sections as benchmark

        patch.setattr(peers, "MOST_SECONDS", 0.5)
        yield benchmark


EXPECTED = {
    "speed": "SLSQP Pinocchio ms",
    "quality": "25.0411",
    "starts": "worse with more starts",
    "free": "with h free: 0 of 1",
    "random": "of 1",
    "rest": "solved 1 of 1",
    "forward": "easy",
    "obstacle": "cut into the margin",
    "witness": "violated between instants: 0",
    "growth": "time grows as n^",
    "inflight": "B, obstacle",
    "startup": "processor s",
    "many": "plans/s",
    "studies": "largest process MB",
    "single": "proof of A",
    "jump": "jump lasts s",
    "hops": "jumps drawn with seeds",
    "launch": "yes that fails",
    "contact": "on feet alone",
    "contact-in-space": "attitude deg",
    "guesses-in-space": "not found: go2_quarter_turn, seed 1, solved: False",
    "space": "drawn motions",
    "proofs": "chains of 12 joints",
    "clips": "false alarms: 0 in 9",
    "clip-repair": "true hops that come back as they are: 2 of 2",
    "clip-landings": "in 18 at least, repaired",
    "clip-stances": "have both stances, found and checked",
    "guard": "most worse",
}
LONG = {
    *("clips", "speed", "free", "obstacle", "inflight", "startup", "studies", "jump", "hops", "launch"),
    *(
        "contact",
        "contact-in-space",
        "guesses-in-space",
        "space",
        "proofs",
        "quality",
        "clip-repair",
        "clip-landings",
        "clip-stances",
        "guard",
    ),
}


@pytest.mark.parametrize("section", cases(EXPECTED, LONG))
def test_section_runs(section, benchmark, capsys, monkeypatch):
    few = {"many": 3, "starts": 2, "scanned": 21, "instants": 400, "takeoffs": 2, "peers_in_space": 0}
    few |= {"clips": 3, "repairs": 2, "chains": (3,), "long_chains": (3, 4)}
    tiny = benchmark.Counts(**dict.fromkeys((field.name for field in fields(benchmark.Counts)), 1) | few)
    for name in ("Go2's backflip", "Go2's half twist"):  # planned for seconds
        monkeypatch.delitem(sys.modules["inflight_sections"].FLOWN, name)
    of_jumps = sys.modules["jump_sections"]
    monkeypatch.setattr(of_jumps, "FEET", ("rolling",))
    monkeypatch.setattr(of_jumps, "ARMATURES", (0.0,))
    if section == "guesses-in-space":
        jumps.plan_on_fewer_nodes(monkeypatch, 0.4)
        monkeypatch.setattr(of_jumps, "GUESSED", ("go2_quarter_turn",))
        few_iterations = {"print_level": 0, "sb": "yes", "max_iter": 5}  # the search ends before it is solved
        options = {"ipopt": few_iterations, "print_time": False, "error_on_fail": False}
        monkeypatch.setattr(SpatialProgram, "_options", lambda program, loose: options | program.assembly.functions)
    if section == "clip-landings":
        monkeypatch.setattr(sys.modules["clip_landings"], "RUNS", 4)
    if section in ("jump", "contact"):
        monkeypatch.setattr(fp, "jump", lambda *_: jumps.planned_jump("go2"))
    if section == "contact-in-space":
        monkeypatch.setattr(fp, "jump", lambda _: jumps.roll())
    if section == "clip-stances":
        of_one_robot = sys.modules["clip_stances_section"]
        monkeypatch.setattr(of_one_robot, "ROBOTS", ("go2",))
        monkeypatch.setattr(of_one_robot, "repair_clip", lambda _, **__: repaired_hop())
    benchmark.SECTIONS[section](tiny)
    assert EXPECTED[section] in capsys.readouterr().out


def test_section_that_there_is_not(benchmark):
    with pytest.raises(SystemExit):
        benchmark.main(["nonsense"])


NODES_OF_A = 32  # on which floatplan ends
SAME_OPTIMUM = 1e-7  # of |b|


@pytest.fixture
def compiler(benchmark):
    """CasADi's C can be compiled."""
    from peers_compiled import can_compile

    if not can_compile():
        skip_or_fail("gcc is not installed")


@pytest.mark.parametrize(
    "peer", cases(["peers_pinocchio.PinocchioSlsqp", "peers_compiled.CompiledSqp"], {"peers_compiled.CompiledSqp"})
)
def test_a_peer_reaches_the_optimum(peer, planned, request):
    request.getfixturevalue("compiler" if "compiled" in peer else "benchmark")
    plan = planned("new_configuration")
    answer = pkgutil.resolve_name(peer)(plan.problem, NODES_OF_A).solve()
    assert answer.solved
    np.testing.assert_allclose(answer.coefficients, plan.coefficients, rtol=0, atol=SAME_OPTIMUM * answer.norm)


@pytest.mark.usefixtures("benchmark")
def test_peers_know_the_same_momentum(any_robot):
    import casadi as ca
    from peers_compiled import orientation_rate
    from peers_pinocchio import pinocchio_rate

    rng, momentum = np.random.default_rng(0), 0.7
    q, qd = rng.uniform(-2, 2, (2, 9, len(any_robot.joints)))
    own = GeneralDynamics(any_robot.tree).base_rate_derivatives(q, qd, momentum)
    peer = pinocchio_rate(any_robot).base_rate_derivatives(q, qd, momentum)
    for name in ("rate", "by_position", "by_velocity", "by_momentum"):
        expected = getattr(own, name)
        np.testing.assert_allclose(getattr(peer, name), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    symbolic = np.asarray(orientation_rate(any_robot.tree, momentum).map(9)(ca.DM(q.T), ca.DM(qd.T))).ravel()
    np.testing.assert_allclose(symbolic, own.rate, rtol=0, atol=1e-9 * np.abs(own.rate).max())


@pytest.mark.usefixtures("benchmark")
def test_the_peer_in_space_turns_as_fast(root):
    import casadi as ca
    from peers_space import turning_rate

    robot = fp.Robot.from_urdf(root / "urdf" / "diver.urdf", base="free-flyer")
    rng = np.random.default_rng(0)
    q, qd = rng.uniform(-1, 1, (2, 1, len(robot.joints)))
    turned, h = Rotation.random(random_state=1), rng.normal(size=3)
    inertia, joint_map = spatial_dynamics(robot).momentum_maps(q)
    expected = np.linalg.solve(inertia[0], turned.as_matrix().T @ h - joint_map[0] @ qd[0])
    found = turning_rate(robot)(*map(ca.DM, (q[0], qd[0], turned.as_quat(), h)))
    np.testing.assert_allclose(found.full().ravel(), expected, rtol=0, atol=1e-12)


@pytest.mark.usefixtures("benchmark")
def test_collocated_flights_drift_as_the_page_says(root, planned, capsys):
    import collocated_flight

    collocated_flight.main()
    page = (root / "docs" / "howto" / "momentum_not_constant.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out in page
    plan = planned("handstand")
    times = np.linspace(0.0, plan.duration, 11)
    base = collocated_flight.Base(plan, times)
    by_dynamics = -base.damping * plan.at(times).orientation_rate - base.forcing
    np.testing.assert_allclose(by_dynamics, plan.a(times)[:, 3:6] @ plan.robot.plane.normal, rtol=0, atol=1e-10)
