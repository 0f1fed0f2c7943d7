import json
import math
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from places import PROBLEMS, ROOT, URDF
from proof_plans import example_a, example_b

import floatplan as fp
from floatplan.view.figures import figures

GYMNAST = URDF / "gymnast.urdf"
EXAMPLE = PROBLEMS / "new_configuration.toml"
HANDSTAND = ("--start", "72,18,-45", "--goal", "-90,0,0", "--degrees", "--duration", "1.4")


def refused(run, *naming):
    assert run.code == 2, run
    assert run.stdout == ""
    assert "Traceback" not in run.stderr
    assert all(part in run.stderr for part in naming), run.stderr
    assert list(Path.cwd().iterdir()) == []


class TestPlan:
    def test_files(self, floatplan):
        run = floatplan("plan", EXAMPLE, "-o", "out", "--no-figures")
        assert run.code == 0, run
        assert sorted(path.name for path in Path("out").iterdir()) == ["plan.json", "trajectory.csv"]
        content = json.loads(Path("out/plan.json").read_text())
        assert content["ok"] is True
        assert content["angular_momentum"] == 0.13
        assert content["problem"]["name"] == "new_configuration"

    def test_figures_are_drawn_where_they_are_asked_for(self, floatplan, monkeypatch):
        """The first one here; ``test_figures.py`` has all."""
        named = figures._named_figures
        monkeypatch.setattr(figures, "_named_figures", lambda *of: islice(named(*of), 1))
        assert floatplan("plan", EXAMPLE, "-o", "out").code == 0
        assert not Path("out/figures").exists()
        run = floatplan("plan", EXAMPLE, "-o", "out", "--figures")
        assert run.code == 0, run
        endings = {path.suffix for path in Path("out/figures").iterdir()}
        assert endings == {".png", ".svg"}
        assert "figures" in run.stdout

    def test_json_is_the_plan_file_less_its_problem(self, floatplan):
        run = floatplan("plan", EXAMPLE, "--json")
        content = json.loads(Path("runs/new_configuration/plan.json").read_text())
        del content["problem"]
        assert json.loads(run.stdout) == content
        assert not Path("runs/new_configuration/figures").exists()

    @pytest.mark.parametrize("columns", [80, 120])
    def test_summary_fits_a_screen_and_says_where_to_look_next(self, floatplan, monkeypatch, columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        run = floatplan("plan", PROBLEMS / "obstacle.toml", "-o", "out")
        assert run.code == 0
        lines = run.stdout.splitlines()
        assert len(lines) <= 25
        assert max(map(len, lines)) <= columns
        assert any(
            line.split(maxsplit=1) == ["next", "floatplan show out/plan.json"] for line in map(str.rstrip, lines)
        )
        assert Path("out/plan.json").is_file()

    def test_quiet_says_nothing(self, floatplan):
        run = floatplan("plan", EXAMPLE, "--quiet", "--no-figures")
        assert (run.stdout, run.stderr) == ("", "")

    def test_a_flight_in_space_is_proved_too(self, floatplan):
        assert floatplan("plan", PROBLEMS / "space" / "cat.toml", "-o", "out", "--quiet", "--prove").code == 0

    def test_a_proof_is_not_asked_for_and_left_out(self, floatplan):
        run = floatplan("plan", PROBLEMS / "backflip.toml", "-o", "out", "--prove", "--no-certify")
        refused(run, "--prove", "--no-certify")
        assert not Path("out").exists()

    @pytest.mark.usefixtures("little_work")
    def test_exit_code_1_where_there_is_no_plan(self, floatplan):
        run = floatplan("plan", GYMNAST, *HANDSTAND, "--angular-momentum", "40", "-o", "out", "--json")
        assert run.code == 1
        answer = json.loads(run.stdout)
        assert answer["ok"] is False
        assert answer["status"] == "infeasible"
        assert "no plan found" in run.stderr
        assert answer["explanation"]


class TestRobotAndOptions:
    @pytest.mark.parametrize("goal", [["--goal", "-90,0,0"], ["--goal=-90,0,0"], ["--goal", "-90 0 0"]])
    def test_negative_numbers(self, goal, floatplan):
        run = floatplan("plan", GYMNAST, *HANDSTAND[:2], *goal, *HANDSTAND[4:], "-o", "out", "--no-figures")
        assert run.code == 0, run
        problem = fp.load_problem("out/problem.toml")
        assert problem.final.orientation == -math.pi / 2
        assert problem.initial.orientation == math.radians(72)
        np.testing.assert_array_equal(problem.initial.positions, np.radians([18, -45]))

    def test_all_options(self, floatplan):
        run = floatplan(
            *("plan", GYMNAST, *HANDSTAND, "--start-velocities", "18", "--goal-velocities", "-18,36"),
            *("--start-accelerations", "0,90", "--goal-accelerations", "90,0", "--angular-momentum", "free"),
            *("--takeoff", "foot", "--landing", "hand", "--horizontal-velocity", "2", "--degree", "8,9"),
            *("--objective", "acceleration", "--plane", "xz", "-o", "out", "--no-figures"),
        )
        assert run.code in (0, 1), run
        problem = fp.load_problem("out/problem.toml")
        np.testing.assert_allclose(problem.initial.velocities, [math.pi / 10] * 2, rtol=1e-15)
        np.testing.assert_allclose(problem.final.velocities, [-math.pi / 10, math.pi / 5], rtol=1e-15)
        np.testing.assert_allclose(problem.initial.accelerations, [0, math.pi / 2], rtol=1e-15)
        np.testing.assert_allclose(problem.final.accelerations, [math.pi / 2, 0], rtol=1e-15)
        assert problem.flight.angular_momentum == "free"
        assert (problem.takeoff.frame, problem.landing.frame) == ("foot", "hand")
        assert problem.flight.horizontal_velocity == 2
        assert problem.degrees == (8, 9)
        assert problem.motion.objective == "acceleration"

    def test_options_override_a_problem_file(self, floatplan):
        run = floatplan(
            *("plan", EXAMPLE, "--goal", "25,70,56.73", "--degrees", "--duration", "1.2"),
            *("--angular-momentum", "midpoint", "-o", "out", "--no-figures"),
        )
        assert run.code == 0, run
        problem = fp.load_plan("out/plan.json").problem
        assert problem.final.orientation == math.radians(25)
        assert problem.flight.duration == 1.2
        assert problem.flight.angular_momentum == "midpoint"
        assert problem.initial.orientation == math.radians(108.97)
        assert problem.name == "new_configuration"
        assert not Path("out/problem.toml").exists()

    def test_an_overridden_takeoff_moves_the_landing_that_follows_it(self, floatplan):
        floatplan("plan", PROBLEMS / "falling_cat.toml", "--takeoff", "hand", "-o", "out", "--no-figures")
        assert fp.load_plan("out/plan.json").problem.landing.frame == "hand"

    @pytest.mark.parametrize(
        "arguments",
        [
            ["plan"],
            ["plan", EXAMPLE, "--sed", "1"],
            ["plan", EXAMPLE, "--seed", "x"],
            ["plan", EXAMPLE, "--starts", "0"],
            ["fly"],
        ],
    )
    def test_wrong_usage(self, arguments, floatplan):
        refused(floatplan(*arguments), "Usage")


class TestWhereResultsGo:
    """Found out before the search: it would be a pity to lose its answer."""

    @pytest.fixture(autouse=True)
    def no_search(self, monkeypatch):
        def search(*_, **__):
            raise AssertionError("searched, though the results cannot be written")

        monkeypatch.setattr("floatplan.planning.planner.plan", search)

    def test_a_file(self, floatplan, tmp_path):
        file = tmp_path / "file"
        file.touch()
        refused(floatplan("plan", EXAMPLE, "-o", file), str(file), "is not a directory")
        refused(floatplan("plan", EXAMPLE, "-o", file / "below" / "it"), str(file), "is not a directory")

    def test_a_dangling_link(self, floatplan, tmp_path):
        (tmp_path / "link").symlink_to(tmp_path / "nowhere")
        refused(floatplan("plan", EXAMPLE, "-o", tmp_path / "link" / "out"), "link", "is not a directory")


class TestInfo:
    def test_json(self, floatplan):
        facts = json.loads(floatplan("info", GYMNAST, "--json").stdout)
        assert facts["joints"] == ["q1", "q2"]
        assert facts["mass"] == pytest.approx(6.5, rel=1e-12)
        assert facts["plane"]["horizontal"] == [1, 0, 0]
        assert facts["plane"]["vertical"] == [0, 0, 1]
        assert facts["plane"]["normal"] == [0, -1, 0]
        assert facts["velocity_limits"] == [None, None]
        assert facts["position_limits"] == [[-math.pi, math.pi]] * 2
        np.testing.assert_allclose(facts["D_min"], [0.32212, 0.16673, 0.01896], atol=1e-5)
        np.testing.assert_allclose(facts["D_max"], [0.81135, 0.48981, 0.12512], atol=1e-5)
        assert facts["out_of_plane_leak"] == pytest.approx(0, abs=1e-12)
        assert (facts["locked"], facts["coupled"], facts["warnings"]) == ({}, {}, [])

    def test_for_reading(self, floatplan):
        run = floatplan("info", URDF / "high_jumper.urdf", "--frames")
        assert run.code == 0
        for part in ("high_jumper, 75 kg", "xz", "q3", "-3.4 to 0.6", "450", "foot"):
            assert part in run.stdout, run.stdout

    def test_of_a_problem_file_is_of_its_robot(self, floatplan):
        assert json.loads(floatplan("info", EXAMPLE, "--json").stdout)["joints"] == ["q1", "q2"]


class TestCertify:
    def test_proved(self, floatplan, tmp_path):
        path = example_b().save(tmp_path / "plan.json")
        run = floatplan("certify", path, "--json")
        facts = json.loads(run.stdout)
        assert (run.code, facts["verdict"]) == (0, "proved")
        assert facts["clearance_min"] > 0.02
        keys = {"verdict", "orientation_end", "clearance_min", "torque_peak", "velocity_peak", "findings"}
        assert keys <= set(facts)

    def test_what_was_found_is_kept_where_asked(self, floatplan, tmp_path):
        path = example_b().save(tmp_path / "plan.json")
        before = path.read_text()
        assert floatplan("certify", path).code == 0
        assert path.read_text() == before
        assert floatplan("certify", path, "--save").code == 0
        assert fp.load_plan(path).record.certificate["verdict"] == "proved"

    def test_a_plan_finds_its_robot_from_any_folder(self, floatplan, monkeypatch, tmp_path):
        for name in ("problems", "urdf"):
            (tmp_path / "here" / name).symlink_to(ROOT / name)
        assert floatplan("plan", "problems/obstacle.toml", "--no-figures", "--quiet").code == 0
        assert Path(json.loads(Path("runs/obstacle/plan.json").read_text())["robot"]["urdf"]).is_absolute()
        monkeypatch.chdir("runs/obstacle")
        assert floatplan("certify", "plan.json").code == 0
        assert floatplan("export", "plan.json", "-f", "csv").code == 0

    def test_refuted(self, floatplan, tmp_path):
        record = example_b()
        path = replace(record, angular_momentum=record.angular_momentum + 1e-3).save(tmp_path / "plan.json")
        run = floatplan("certify", path)
        assert run.code == 1
        assert run.stdout.startswith("refuted")
        assert len(run.stdout.splitlines()) <= 25

    def test_a_robot_that_has_moved(self, floatplan, tmp_path):
        record = example_a()
        path = replace(record, robot=replace(record.robot, urdf="gone.urdf")).save(tmp_path / "plan.json")
        refused(floatplan("certify", path), "gone.urdf", "o such file", "--urdf")
        assert floatplan("certify", path, "--urdf", GYMNAST).code == 0


def program(*arguments):
    return [sys.executable, "-m", "floatplan", *map(str, arguments)]


class TestProcess:
    """What only a process of its own can show."""

    def test_help_is_quick(self):
        """It imports nothing that takes long: 0.15 s, with Pinocchio it would be 0.6 s."""
        asked = [sys.executable, "-X", "importtime", "-m", "floatplan", "--help"]
        told = subprocess.run(asked, check=True, capture_output=True, text=True).stderr
        imported = {line.rpartition("|")[2].strip() for line in told.splitlines() if line.startswith("import time:")}
        assert "floatplan.cli.commands" in imported
        assert not imported & {"numpy", "scipy", "pinocchio", "matplotlib", "casadi", "mujoco", "viser", "pyarrow"}

    def test_a_reader_that_goes_away(self):
        with subprocess.Popen(
            program("info", GYMNAST, "--json"), stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as done:
            done.stdout.close()
            assert b"Traceback" not in done.stderr.read()
