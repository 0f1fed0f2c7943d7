"""``floatplan jump`` and ``launch``: files, words and exit codes; what is wrong is refused with file and key."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from jumps import backflip, find_jumps_once

import floatplan as fp
from floatplan.jumps.check import JumpCheck
from floatplan.jumps.jump import Jump
from floatplan.jumps.launches import launch as launching
from floatplan.jumps.launches.result import Launch


@pytest.fixture
def go2(root):
    return root / "problems" / "jumps" / "go2.toml"


@pytest.fixture
def found(monkeypatch):
    """The search finds the jump that is at hand; which problems it is asked."""
    asked = []

    def search(problem, **_):
        asked.append(problem)
        return backflip()

    monkeypatch.setattr(fp, "jump", search)
    return asked


def answering(monkeypatch, answer):
    monkeypatch.setattr(fp, "jump", lambda problem, **_: answer)


def words(text):
    return " ".join(text.split())


def test_found_checked_and_proved(floatplan, go2, found):
    run = floatplan("jump", go2, "-o", "results")
    assert run.code == 0
    for part in ("flight proved, stances checked", "FL_foot", "torques take", "jump.json", "plan.json", "not proved"):
        assert part in words(run.stdout)
    assert len(run.stdout.splitlines()) < 50  # phases, what was checked, three warnings
    assert [each.jump is not None for each in found] == [True]
    flight = fp.load_plan("results/plan.json")
    assert flight.certificate.proved
    again = fp.load_jump("results/jump.json")
    assert again.ok
    assert again.verdict.startswith("flight proved, stances checked")
    assert sorted(path.name for path in Path("results").iterdir()) == ["jump.json", "plan.json", "report.html"]


def test_json(floatplan, go2, found):
    run = floatplan("jump", go2, "--json", "--quiet")
    assert run.code == 0
    facts = json.loads(run.stdout)
    assert facts["verdict"].startswith("flight proved, stances checked")
    assert [phase["kind"] for phase in facts["phases"]] == ["stance", "stance", "flight", "stance", "stance"]
    assert facts["figures"]["torque"] <= 0.85
    assert [path.name for path in sorted(Path("runs/go2_backflip").iterdir())] == ["jump.json", "plan.json"]


@pytest.mark.long
def test_show_draws_a_jump(floatplan, tmp_path):
    path = backflip().save(tmp_path / "jump.json")
    run = floatplan("show", path)
    assert (run.code, run.stdout.strip()) == (0, str(tmp_path / "report.html"))
    problem = backflip().problem
    nothing = Jump(problem, fp.JumpRequest(), explanation="Friction stands in the way.").save(tmp_path / "none.json")
    plan = fp.load_jump(path).flight
    for arguments, said in (
        ((nothing,), "none.json: no jump found, so there is nothing to show"),
        ((path, "--compare", plan.save(tmp_path / "plan.json")), "compare: a jump is not compared"),
    ):
        run = floatplan("show", *arguments, "-o", "nowhere")
        assert run.code == 2
        assert said in words(run.stderr)
    content = json.loads(path.read_text())
    content["stances"][-1]["y"][1][-1] = 50.0
    wrong = tmp_path / "wrong.json"
    wrong.write_text(json.dumps(content))
    run = floatplan("show", wrong, "-o", "nowhere")
    assert run.stderr.startswith("warning: this jump does not hold: ")
    assert (run.code, "not within limits" in Path("nowhere/report.html").read_text()) == (0, True)
    path.write_text(path.read_text().replace("floatplan.jump/1", "floatplan.jump/9"))
    assert floatplan("show", path).code == 2


def test_not_found(floatplan, go2, found, monkeypatch):
    floatplan("jump", go2, "-o", "results", "--quiet")
    problem = fp.load_problem(go2)
    assert problem.jump is not None
    answering(monkeypatch, Jump(problem, problem.jump, explanation="Friction stands in the way."))
    run = floatplan("jump", go2, "-o", "results")
    assert run.code == 1
    assert "no jump found" in run.stdout
    assert "Friction stands in the way." in run.stdout
    assert [path.name for path in Path("results").iterdir()] == ["jump.json"]
    assert not fp.load_jump("results/jump.json").ok


def test_stances_that_do_not_hold_are_not_called_checked(floatplan, go2, monkeypatch):
    broken = replace(backflip())
    figures = {**backflip().check.figures, "torque": 1.2}
    vars(broken)["check"] = JumpCheck(False, figures, ("torques take 120% of their limits, 0.85 at most",))
    answering(monkeypatch, broken)
    run = floatplan("jump", go2, "-o", "results")
    assert run.code == 1
    assert "stances checked" not in words(run.stdout)
    assert "not within limits: torques take 120% of their limits" in words(run.stdout)


def test_without_casadi_it_says_what_to_install(floatplan, go2, tmp_path, monkeypatch):
    flight = backflip().flight
    plan = flight.save(tmp_path / "plan.json")
    monkeypatch.setitem(sys.modules, "casadi", None)
    for command in (("jump", go2), ("launch", plan)):
        run = floatplan(*command)
        assert run.code == 2
        assert "CasADi is not installed" in run.stderr
        assert "jump]" in run.stderr
    assert list(Path.cwd().iterdir()) == []


def test_plan_says_which_stances_reach_it(floatplan, root, monkeypatch):
    """In the summary, in the report and in JSON; and where no frame stands, that none was looked for."""
    said = {"takeoff": "A stance reaches the takeoff, with 15% to spare.", "landing": "No stance was found."}

    def search(plan, *, end, seed, starts, **_):
        return Launch(end == "takeoff", 0.85, "velocity", "q1", (said[end], "more of it"), {})

    monkeypatch.setattr(launching, "launch", search)
    high_jump = root / "problems" / "high_jump.toml"
    run = floatplan("plan", high_jump, "--launch", "--report", "--no-figures", "-o", "result")
    assert run.code == 0
    for sentence in said.values():
        assert sentence in words(run.stdout)
        assert sentence in Path("result/report.html").read_text()
    facts = json.loads(floatplan("plan", high_jump, "--launch", "--json", "--quiet").stdout)["launch"]
    assert (facts["takeoff"]["ok"], facts["landing"]["ok"]) == (True, False)
    assert "launch" not in json.loads(floatplan("plan", high_jump, "--json", "--quiet").stdout)
    flies = floatplan("plan", root / "problems" / "falling_cat.toml", "--launch", "--no-figures")
    assert words(flies.stdout).count("none was looked for: no frame stands on the ground") == 2
    monkeypatch.setitem(sys.modules, "casadi", None)
    run = floatplan("plan", high_jump, "--launch")
    assert run.code == 2
    assert "--launch: CasADi is not installed" in run.stderr


WRONG = {  # in go2.toml: what is replaced, and what is said then
    "a posture that is not static": (
        'contacts = [["RL_foot", "FL_foot"]',
        'from = { RL_calf_joint = -100 }\ncontacts = [["RL_foot", "FL_foot"]',
        "jump.takeoff.from: the posture is not static: its feet are",
    ),
    "a posture that falls": (
        'contacts = [["FL_foot"], ["FL_foot", "RL_foot"]]',
        'to = { FL_thigh_joint = -25, RL_thigh_joint = -25 }\ncontacts = [["FL_foot"], ["FL_foot", "RL_foot"]]',
        "jump.landing.to: the posture is not static: its centre of mass is",
    ),
    "a contact in the air": (
        '[["RL_foot", "FL_foot"], ["RL_foot"]]',
        '[["RL_foot", "FL_hip"], ["RL_foot"]]',
        "jump.takeoff.contacts: 'FL_hip' is in the air",
    ),
    "friction 0": ("friction = 0.6", "friction = 0", "jump.friction: 0.0 is not positive"),
    "no gravity": ("duration = 0.4", "duration = 0.4\ngravity = 0", "flight.gravity: nothing stands without gravity"),
    "a momentum that is no number": (
        "[jump.takeoff]",
        'fixed = ["angular_momentum"]\n[jump.takeoff]',
        "flight.angular_momentum: 'free' is no number to keep",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused(floatplan, go2, tmp_path, name):
    before, after, said = WRONG[name]
    text = go2.read_text().replace('"rolling"', '"point"')
    assert before in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(before, after))
    run = floatplan("jump", path)
    assert run.code == 2, run.stdout
    assert "wrong.toml" in run.stderr
    assert said in words(run.stderr)
    assert list(Path.cwd().iterdir()) == []


@pytest.mark.parametrize(
    ("answer", "code", "said"),
    [
        (Launch(True, 0.9, "velocity", "q1", ("A stance reaches the takeoff.",), {}), 0, "checked 2000 times"),
        (Launch(False, 1.7, "torque", "q1", ("No stance was found.",), {}), 1, "does not prove that none exists"),
        (Launch(False, float("inf"), "", "", ("No stance was found.",), {}), 1, "does not prove that none exists"),
    ],
)
def test_launch(floatplan, tmp_path, monkeypatch, answer, code, said):
    asked = []
    monkeypatch.setattr(fp, "launch", lambda plan, request, **words: asked.append((request, words)) or answer)
    flight = backflip().flight
    path = flight.save(tmp_path / "plan.json")
    run = floatplan("launch", path, "--landing", "--friction", "0.4")
    assert run.code == code
    assert answer.sentences[0] in run.stdout
    assert said in words(run.stdout)
    assert (asked[0][0].friction, asked[0][1]["end"]) == (0.4, "landing")
    facts = json.loads(floatplan("launch", path, "--json").stdout)
    assert (facts["ok"], facts["friction"]) == (answer.ok, 0.6)


@pytest.mark.long
def test_from_end_to_end(floatplan, go2, monkeypatch):
    find_jumps_once(monkeypatch)
    run = floatplan("jump", go2, "-o", "results")
    assert run.code == 0
    assert "flight proved, stances checked" in words(run.stdout)
    run = floatplan("launch", "results/plan.json")
    assert run.code == 0
    assert "to spare" in run.stdout
