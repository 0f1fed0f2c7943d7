"""Whatever a public class or function is given: it takes it, or says at once what is wrong with it."""

import inspect
import math
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

import floatplan as fp
from floatplan.inflight import authority as authority_module
from floatplan.view.figures.animation import FilmFormat

MADE_BY_FLOATPLAN = {
    "JumpReplay",
    *("Authority", "Certificate", "ClosedLoop", "Contact", "Correction", "FlightState", "Plan", "Plans", "Reference"),
    *("Replay", "Study", "Jump", "JumpCheck", "JumpPhase", "Launch", "MotionSample"),
    *("Clip", "ClipCheck", "ClipFlight", "ClipRepair", "FlightJudgement", "Bench"),
}
TRIED_AMONG_JUMPS = ("jump", "launch", "load_jump", "replay_jump")  # in tests of their own
TRIED_AMONG_CLIPS = ("load_clip", "check_clip", "repair_clip", "bench")
NO_ARGUMENTS = {"__version__", "FloatplanError", "InputError", "method"}
FEW_LETTERS = 1500  # of any representation

STRANGE = {
    "None": lambda: None,
    "true": lambda: True,
    "text": lambda: "x",
    "no text": lambda: "",
    "number as text": lambda: "1.4",
    "bytes": lambda: b"1.4",
    "nul": lambda: "\0",
    "NaN": lambda: math.nan,
    "infinity": lambda: math.inf,
    "minus infinity": lambda: -math.inf,
    "negative": lambda: -1,
    "zero": lambda: 0.0,
    "fraction": lambda: 1.5,
    "NumPy's number": lambda: np.float32(0.5),
    "array of no dimension": lambda: np.array(0.5),
    "large": lambda: 10**9,
    "huge": lambda: 1e308,
    "more than a double": lambda: 10**400,
    "complex": lambda: 1j,
    "empty list": list,
    "one": lambda: [0.1],
    "three": lambda: (0, 0, 1),
    "NaNs": lambda: [math.nan, math.nan],
    "ragged": lambda: [[0.1], [0.1, 0.2]],
    "Nones": lambda: [None],
    "texts": lambda: ["x", "y"],
    "matrix": lambda: np.zeros((2, 2)),
    "empty array": lambda: np.zeros(0),
    "array of texts": lambda: np.array(["x", "y"]),
    "array of objects": lambda: np.array([None, {}], dtype=object),
    "empty mapping": dict,
    "mapping": lambda: {"q1": "x"},
    "mapping of NaN": lambda: {"q1": math.nan},
    "mapping from numbers": lambda: {1: 0.1},
    "mapping to mappings": lambda: {"q1": {"q1": 1.0}},
    "generator": lambda: (each for each in (0.1, 0.2)),
    "set": lambda: {0.1},
    "object": object,
    "class": lambda: fp.Circle,
    "circle": lambda: fp.Circle(center=(9, 9), radius=0.1),
    "a path that leads nowhere": lambda: Path("/nowhere/at/all"),
}


@dataclass(frozen=True)
class Call:
    """Something public, and arguments with which it is right; ``then`` is done with what it returns."""

    function: Callable[..., Any]
    arguments: Mapping[str, Any]
    then: Callable[[Any], Any] = repr


@pytest.fixture(scope="module")
def problem(root):
    return fp.load_problem(root / "problems" / "handstand.toml")


@pytest.fixture(scope="module")
def plan(problem):
    return fp.plan(problem)


@pytest.fixture(scope="module")
def authority(plan):
    """Of few errors, here and wherever it is asked for while this one is at hand."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(authority_module, "LARGEST", 0.01)
        patch.setattr(authority_module, "SHARES", (0.0,))
        yield fp.authority(plan)


@pytest.fixture
def seldom(monkeypatch):
    """Closed loops at 50 Hz: what comes of them matters little here."""
    monkeypatch.setattr("floatplan.simulation.closed_loop.PERIOD", 2e-2)


def parts(problem):
    """What people make; what they put into a problem is put into one."""
    gymnast = problem.robot

    def into(field, wrapped=lambda part: part):
        return lambda part: replace(problem, **{field: wrapped(part)})

    def in_flight(field):
        return into("flight", lambda part: replace(problem.flight, **{field: part}))

    limits = {"position": "full", "velocity": 99.0, "torque": {"q1": 99.0}, "motor": {}, "orientation_rate": 99.0}
    obstacle = {"margin": 0.1, "velocity": (0.0, 0.0), "window": (0.1, 0.2)}
    in_space = {**obstacle, "velocity": (0, 0, 0)}
    ends = {"contacts": [["hand"]], "durations": [(0.1, 0.2)]}
    made = [
        (fp.Posture(0.1, {"q1": 0.1, "q2": 0.2}, 0.0, [0.0, 0.0]), into("start")),
        (fp.Attitude(angles=(0.1, 0.2, 0.3), axes="yxz"), str),
        (fp.Takeoff("foot", (0.0, 0.0)), in_flight("takeoff")),
        (fp.Landing("hand", 0.1), in_flight("landing")),
        (fp.Flight(1.4, 3.0), into("flight")),
        (fp.Motion((7, 7), "torque"), into("motion")),
        (
            fp.ClipReference(positions=[[0.1, 0.2], [0.3, 0.4]]),
            into("motion", lambda clip: fp.Motion(objective="clip", clip=clip)),
        ),
        (fp.Limits(**limits, acceleration=(99.0, math.inf)), into("limits")),
        (fp.Motor(9.0, 0.1), into("limits", lambda motor: fp.Limits(motor={"q1": motor}))),
        (fp.Circle(center=(9, 9), radius=0.1, **obstacle), into("obstacles", lambda it: [it])),
        (fp.HalfPlane(point=(0, -9), normal=(0, 1), **obstacle), into("obstacles", lambda it: [it])),
        (fp.Bar(start=(8, 9), end=(9, 9), radius=0, **obstacle), into("obstacles", lambda it: [it])),
        (fp.Sphere(center=(9, 9, 9), radius=0.1, **in_space), repr),
        (fp.Capsule(start=(8, 9, 9), end=(9, 9, 9), radius=0.1, **in_space), repr),
        (fp.HalfSpace(point=(0, 0, -9), normal=(0, 0, 1), **in_space), repr),
        (fp.Box(center=(9, 9, 9), size=(1, 1, 1), **in_space), repr),
        (fp.SelfClearance(("body0", "body2"), 0.01), into("self_clearances", lambda it: [it])),
        (fp.JumpRequest(feet="point", objective="limits"), into("jump")),
        (fp.JumpTakeoff(**ends, from_="standing"), into("jump", lambda it: fp.JumpRequest(takeoff=it))),
        (fp.JumpLanding(**ends, to="standing"), into("jump", lambda it: fp.JumpRequest(landing=it))),
        (fp.JumpFlight(1, 2, (0.3, 0.4)), into("jump", lambda it: fp.JumpRequest(flights=[it]))),
        (replace(problem, name="x"), repr),
        (fp.Coupling("q1", -1.0), repr),
        (fp.Payload("body1", 0.5, (0.0, 0.0, 0.1)), repr),
        (fp.Perturbation(h=0.1, mass=0.1, noise=0.1, delay=0.1), repr),
    ]
    chosen = ("plane", "joints", "coupled", "locked", "reference", "armature", "damping")
    payload = {"link": "body1", "mass": 0.5, "at": (0.0, 0.0, 0.1)}
    robot = {"balance_inertias": True, "payload": payload, "base": "planar", "angles": "rad"}
    posture = {"orientation": 0.1, "positions": {"q1": 0.1, "q2": 0.2}, "velocities": 0.0, "accelerations": [0.0, 0.0]}
    return {
        **{
            type(part).__name__: Call(type(part), {name: getattr(part, name) for name in names_of(type(part))}, put)
            for part, put in made
        },
        "Posture.degrees": Call(fp.Posture.degrees, posture, into("goal")),
        "Family": Call(fp.Family, {"base": problem, "varied": {"flight.duration": [1.3, 1.4]}}, tried),
        "Robot": Call(fp.Robot.from_urdf, {"source": gymnast.path, **dict.fromkeys(chosen), **robot}),
    }


def tried(problems):
    for index in range(len(problems)):
        repr(problems[index])


def calls(problem, plan, authority, folder):
    """Public functions, and methods of what they return."""
    file = plan.save(folder / "plan.json")
    toml = fp.save_problem(problem, folder / "problem.toml")
    asked = {"problem": problem, "angular_momentum": 3.0}
    replanner = fp.Replanner(plan)
    options = {"seed": 0, "starts": 1, "prove": False}
    flown = {"rate": 50.0, "perturb": "h=1%", "flights": 1, "seed": 0, "engine": "pinocchio", "feedback": 10.0}
    return {
        "plan": Call(fp.plan, {"problem": problem, **options, "budget": None, "progress": None}),
        "plan_many": Call(fp.plan_many, {"problems": [problem], **options, "jobs": 1, "search": False, "attempts": 4}),
        "certify": Call(fp.certify, {"plan": plan, "urdf": None, "budget": 4000, "out_of_plane": False}),
        "takeoff": Call(fp.takeoff, asked),
        "landing": Call(fp.landing, asked),
        "load_plan": Call(fp.load_plan, {"path": file, "urdf": None}),
        "load_problem": Call(fp.load_problem, {"path": toml}),
        "save_problem": Call(fp.save_problem, {"problem": problem, "path": folder / "again.toml"}),
        "closed_loop": Call(fp.closed_loop, {"plan": plan, **flown, "budget": None}),
        "replay": Call(
            fp.replay,
            {
                "plan": plan,
                "robot": None,
                "engine": "pinocchio",
                "perturb": "",
                "feedback": None,
                "step": 0.01,
                "seed": 0,
            },
        ),
        "Replanner": Call(fp.Replanner, {"plan": plan, "rate": 200.0, "sigma": 0.001, "acceleration": None}),
        "authority": Call(lambda plan: repr(plan) if isinstance(plan, fp.Plan) else fp.authority(plan), {"plan": plan}),
        "Authority.until": Call(authority.until, {"error": 0.1}),
        "Replanner.reference": Call(replanner.reference, {"t": 0.1}),
        **{
            f"Plan.{name}": Call(getattr(plan, name), {"times": 0.5})
            for name in ("at", "q", "v", "a", "tau", "forces", "contact_points")
        },
        "Plan.save": Call(plan.save, {"path": file}),
        "Plan.export": Call(
            plan.export,
            {
                "form": "csv-full",
                "path": folder / "trajectory.csv",
                "rate": 10.0,
                "kp": 5.0,
                "kd": {"q1": 1.0},
                "model": None,
            },
        ),
        "Plan.figures": Call(plan.figures, {"compare": plan}, len),
        "Plan.show": Call(plan.show, {"path": folder / "report.html", "browse": False}),
        "Plan.animate": Call(plan.animate, {"path": folder / "flight.gif", "speed": 9.0, "progress": None}),
    }


def refusals(name, call):
    """Put everything strange in the place of each argument; yield what was raised that floatplan does not raise."""
    for argument in call.arguments:
        refused = 0
        for what, strange in STRANGE.items():
            value = strange()
            if argument == "progress" and callable(value):
                continue  # what it raises is its own affair
            try:
                call.then(call.function(**{**call.arguments, argument: value}))
            except fp.FloatplanError as error:
                refused += 1
                if not str(error) or len(str(error)) > 2000:
                    yield f"{name}({argument}={what}): {len(str(error))} characters"
            except Exception as error:
                yield f"{name}({argument}={what}): {type(error).__name__}: {str(error)[:200]}"
        if not refused and name != "Replanner.reference":
            yield f"{name}({argument}): takes anything"


def names_of(function):
    """Names of a function's arguments, of which some may stand in a TypedDict."""
    names = set(inspect.signature(function).parameters)
    if "choices" in names:
        names = names - {"choices"} | set(get_args(get_type_hints(function)["choices"])[0].__annotations__)
    return names


def test_what_people_make(problem):
    found = []
    for name, call in parts(problem).items():
        assert names_of(call.function) == set(call.arguments), name
        call.then(call.function(**call.arguments))
        found += list(refusals(name, call))
    assert found == []


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.usefixtures("seldom")
def test_what_people_call(problem, plan, authority, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda _: True)
    monkeypatch.setattr("floatplan.view.figures.animation.FILM", FilmFormat(rate=1.0))
    found = []
    for name, call in calls(problem, plan, authority, tmp_path).items():
        assert names_of(call.function) == set(call.arguments), name
        call.then(call.function(**call.arguments))
        with monkeypatch.context() as patch:
            # Each was written, or drawn, once.
            patch.setattr("floatplan.view.report.report.report", lambda *_, **__: "")
            patch.setattr("floatplan.view.figures.figures._named_figures", lambda *_: ())
            found += list(refusals(name, call))
    assert found == []


@pytest.mark.long
def test_studies(root, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fp.save_problem(problem, tmp_path / "problem.toml")
    file = tmp_path / "study.toml"
    file.write_text('problem = "problem.toml"\n[vary]\n"flight.duration" = [1.3, 1.4]\n"start.orientation" = [1.2]\n')
    options = {"folder": "out", "restart": True, "engine": "processes", "scheduler": None, "executor": None}
    options |= {"jobs": 1, "progress": None}
    study = fp.study(file, folder="out", jobs=1)
    monkeypatch.setattr("floatplan.studies.maps.write_maps", lambda *_: [])  # drawn once, above
    found = []
    for name, call in {
        "study": Call(fp.study, {"path": file, **options}),
        "Study.heatmap": Call(study.heatmap, {"x": "flight.duration", "y": "start.orientation", "z": "objective"}),
        "Study.best": Call(study.best, {"k": 1, "by": "objective"}),
        "Study.plan": Call(study.plan, {"index": 1}),
    }.items():
        assert names_of(call.function) == set(call.arguments), name
        call.then(call.function(**call.arguments))
        found += list(refusals(name, call))
    assert found == []
    assert len(repr(study)) < FEW_LETTERS
    assert "2 rows" in repr(study)


def test_every_public_name_is_tried(problem, plan, authority, tmp_path):
    tried = {
        name.partition(".")[0]
        for name in (
            *parts(problem),
            *calls(problem, plan, authority, tmp_path),
            "study",
            *TRIED_AMONG_JUMPS,
            *TRIED_AMONG_CLIPS,
        )
    }
    assert set(fp.__all__) == tried | MADE_BY_FLOATPLAN | NO_ARGUMENTS


SAID = [  # a call, and what is said of it
    (lambda _: fp.Flight(duration=-1), "duration: -1 s is not positive"),
    (lambda _: fp.Flight(duration=math.nan), "duration: nan is not a finite number"),
    (lambda _: fp.Flight(duration="1.4"), "duration: '1.4' is not a number"),
    (lambda _: fp.Flight(1.4, takeoff="foot"), "takeoff: 'foot' is not a Takeoff"),
    (lambda _: fp.Circle(center=(0, 0, 1), radius=1), r"center: \(0, 0, 1\) is not two numbers"),
    (lambda _: fp.Limits(motor={"q1": (9.0, 0.1)}), r"motor.q1: \(9.0, 0.1\) is not a Motor"),
    (lambda _: fp.Limits(torque=-3.0), "torque: -3.0 is not positive"),
    (lambda _: fp.Motion(degree=4), "degree: 4 is outside 5 to 15; six boundary conditions"),
    (lambda _: fp.Posture(math.nan, {"q1": math.inf}), "orientation: nan .*\npositions.q1: inf is not a finite"),
    (lambda _: fp.HalfPlane(window=(1.0, 0.5)), "window: the window ends"),
    (lambda _: fp.SelfClearance(("a", "a")), "links: the two links are the same"),
    (lambda _: fp.Coupling("j", 1.0, math.nan), "offset: nan is not a finite number"),
    (lambda _: fp.plan_many([None]), r"problems\[0\]: None is neither a Problem nor the path of one"),
    (lambda it: replace(it, robot="x.urdf"), "robot: 'x.urdf' is not a Robot; load it with Robot.from_urdf"),
    (lambda it: replace(it, obstacles=fp.Circle(center=(9, 9), radius=0.1)), "is not a sequence of obstacles"),
    (lambda it: replace(it, start=None), "start: None is not a Posture"),
    (lambda it: replace(it, name=3), "name: 3 is not a text"),
    (lambda it: fp.plan(it, seed=1.5), "seed: 1.5 is not a whole number"),
    (lambda it: fp.plan(it, budget="x"), "budget: 'x' is not a number"),
    (lambda it: fp.plan(it, starts=10**9), "starts: 1000000000 is outside 1 to 1000"),
]


@pytest.mark.parametrize(("call", "message"), SAID)
def test_what_is_wrong_is_said_at_once(problem, call, message):
    with pytest.raises(fp.InputError, match=message):
        call(problem)


@pytest.mark.usefixtures("seldom")
def test_a_path_stands_for_what_is_in_its_file(root, plan, authority, tmp_path):
    toml, file = root / "problems" / "handstand.toml", plan.save(tmp_path / "plan.json")
    for path in (toml, str(toml)):
        assert fp.plan(path).coefficients.tolist() == plan.coefficients.tolist()
        assert fp.takeoff(path).verdict == fp.takeoff(plan.problem).verdict
        assert fp.landing(path).verdict == fp.landing(plan.problem).verdict
    assert fp.plan_many([toml, plan.problem]).ok.all()
    assert fp.replay(file).position_error.tolist() == fp.replay(plan).position_error.tolist()
    assert fp.Replanner(str(file)).plan.coefficients.tolist() == plan.coefficients.tolist()
    assert fp.closed_loop(file, 50.0, flights=1, feedback=10.0).flights == 1
    assert fp.authority(file).momentum.shape == authority.momentum.shape


def test_arrays_are_kept_as_they_were(problem):
    """What is given cannot change under a posture that was checked."""
    positions, center = np.array([0.1, 0.2]), np.array([9.0, 9.0])
    posture, circle = fp.Posture(0.1, positions), fp.Circle(center=center, radius=0.1)
    positions[0] = center[0] = math.nan
    assert list(posture.positions) == [0.1, 0.2]
    assert circle == fp.Circle(center=(9.0, 9.0), radius=0.1)


def test_a_posture_in_degrees():
    turned = fp.Posture.degrees(72, {"q1": 18, "q2": -45}, [90, 0], "free")
    assert turned.orientation == math.radians(72)
    assert turned.positions == {"q1": math.radians(18), "q2": math.radians(-45)}
    assert list(turned.velocities) == [math.pi / 2, 0.0]
    assert turned.accelerations == "free"
    assert fp.Posture.degrees(0.0, 0, "takeoff").velocities == "takeoff"


def test_degrees_given_as_radians_are_a_warning(problem):
    def turns(start, goal):
        limits = fp.Limits({"q1": (-50.0, 50.0), "q2": (-50.0, 50.0)})
        asked = replace(problem, start=start, goal=goal, limits=limits)
        return [each.to_dict() for each in fp.plan(asked).warnings if each.kind == "turns"]

    (base, joint) = turns(fp.Posture(72, {"q1": 18, "q2": 0.1}), fp.Posture(-90, 0.0))
    assert base["subject"] == problem.robot.tree.names[0]
    assert base["value"] == 162.0
    assert base["limit"] == pytest.approx(4 * math.pi)
    assert (joint["subject"], joint["value"], joint["unit"], joint["instant"]) == ("q1", 18.0, "rad", None)
    assert "Posture.degrees" in base["message"]
    two = fp.Posture(0.0, 0.1), fp.Posture(4 * math.pi, 0.2)
    assert turns(*two) == []
    assert turns(two[0], fp.Posture(4.1 * math.pi, 0.2)) != []
    assert turns(fp.Posture(4.1 * math.pi, 0.1), two[1]) != []


@pytest.mark.usefixtures("seldom")
def test_representations_are_short_and_tell(problem, plan, authority):
    family = fp.Family(problem, {"flight.duration": np.linspace(1.3, 1.5, 1000)})
    plans = fp.plan_many(family)
    replanner = fp.Replanner(plan)
    first = plan.at(0.0)
    measured = (float(first.orientation), float(first.orientation_rate), first.positions, first.velocities)
    flown = fp.closed_loop(plan, 50.0, flights=2, feedback=10.0)
    for shown, told in (
        (plans, "status: 1000 optimal"),
        (family, "varied: flight.duration (1000,) from 1.3 to 1.5"),
        (first, "torques: "),
        (plan.at(np.linspace(0, 1, 999)), "positions: (999, 2) from "),
        (plan.peaks, "clearance: None"),
        (plan.contacts[0], plan.contacts[0].frame),
        (plan, "optimal"),
        (problem, "handstand"),
        (problem.robot, "gymnast"),
        (fp.certify(plan), "proved"),
        (replanner, "landing: 1.4 s"),
        (replanner.update(0.0, *measured), "status: applied"),
        (replanner.reference(0.1), "feedforward: "),
        (authority, "momentum: "),
        (flown, "flights: 2"),
        (flown.corrected, "orientation: "),
        (fp.replay(plan), "landed"),
        (fp.Perturbation(), "Perturbation"),
        *((call.function(**call.arguments), name.partition(".")[0]) for name, call in parts(problem).items()),
    ):
        text = repr(shown)
        assert told in text
        assert len(text) < FEW_LETTERS, text
        assert " object at " not in text
        assert "<function" not in text
