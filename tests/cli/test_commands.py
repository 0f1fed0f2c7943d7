from __future__ import annotations

import csv
import json
import math
import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from elsewhere import hear_ctrl_c
from proof_plans import example_a, example_b
from rich.console import Console

import floatplan as fp
from floatplan.cli import summary

ROOT = Path(__file__).resolve().parents[2]
URDF = ROOT / "urdf"
PROBLEMS = ROOT / "problems"
GYMNAST = URDF / "gymnast.urdf"
EXAMPLE = PROBLEMS / "new_configuration.toml"
HANDSTAND = ("--start", "72,18,-45", "--goal", "-90,0,0", "--degrees", "--duration", "1.4")

Command = Callable[..., Any]


def refused(run: Any, *naming: str) -> None:
    assert run.code == 2, run
    assert run.stdout == ""
    assert "Traceback" not in run.stderr
    assert all(part in run.stderr for part in naming), run.stderr
    assert list(Path.cwd().iterdir()) == []


class TestPlan:
    def test_files(self, floatplan: Command) -> None:
        run = floatplan("plan", EXAMPLE, "-o", "out", "--no-figures")
        assert run.code == 0, run
        assert sorted(path.name for path in Path("out").iterdir()) == ["plan.json", "trajectory.csv"]
        content = json.loads(Path("out/plan.json").read_text())
        assert content["ok"] is True
        assert content["angular_momentum"] == 0.13
        assert content["problem"]["name"] == "new_configuration"

    def test_figures_are_drawn_where_they_are_asked_for(self, floatplan: Command) -> None:
        assert floatplan("plan", EXAMPLE, "-o", "out").code == 0
        assert not Path("out/figures").exists()
        run = floatplan("plan", EXAMPLE, "-o", "out", "--figures")
        assert run.code == 0, run
        endings = {path.suffix for path in Path("out/figures").iterdir()}
        assert endings == {".png", ".svg"}
        assert "figures" in run.stdout

    def test_default_folder_is_named_for_the_problem(self, floatplan: Command) -> None:
        assert floatplan("plan", EXAMPLE, "--quiet", "--no-figures").code == 0
        assert Path("runs/new_configuration/plan.json").is_file()

    def test_json_is_the_plan_file_less_its_problem(self, floatplan: Command) -> None:
        run = floatplan("plan", EXAMPLE, "--json")
        content = json.loads(Path("runs/new_configuration/plan.json").read_text())
        del content["problem"]
        assert json.loads(run.stdout) == content
        assert not Path("runs/new_configuration/figures").exists()

    def test_summary_is_short_and_on_stdout(self, floatplan: Command) -> None:
        run = floatplan("plan", EXAMPLE, "--no-figures")
        assert run.stderr == ""
        assert len(run.stdout.splitlines()) <= 25
        for part in ("gymnast", "1.1 s", "108.97; -108.97, 90 deg", "20; 70, 56.73 deg", "0.13 kg m^2/s", "plan.json"):
            assert part in run.stdout, run.stdout

    @pytest.mark.parametrize("columns", [80, 120])
    def test_summary_fits_a_screen_and_says_where_to_look_next(
        self, floatplan: Command, monkeypatch: pytest.MonkeyPatch, columns: int
    ) -> None:
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

    @pytest.mark.parametrize("name", ["left_ankle_pitch_joint", "left_ankle_pitch_joint_of_an_uncommonly_long_name"])
    @pytest.mark.parametrize("peak", ["1.235", "1.235e+04"])
    def test_no_table_cuts_anything_short(self, monkeypatch: pytest.MonkeyPatch, name: str, peak: str) -> None:
        monkeypatch.setenv("COLUMNS", "80")
        titles = ["joint", *["N m", "limit", "%"] * 3, "range, deg", "% of it", "at, s"]
        cells = [name, *[peak, "9e+04", "100"] * 3, "-180 to 180", "100", "12.345"]
        with (console := Console()).capture() as capture:
            console.print(summary._table(titles, [cells], whole=True))
        lines = capture.get().splitlines()
        assert max(map(len, lines)) <= 80
        shown = Counter("".join(lines).replace(" ", ""))
        assert shown == Counter("".join([*titles, *cells]).replace(" ", ""))
        if peak == "1.235":
            assert lines[1].split()[1:] == " ".join(cells[1:]).split()

    def test_quiet_says_nothing(self, floatplan: Command) -> None:
        run = floatplan("plan", EXAMPLE, "--quiet", "--no-figures")
        assert (run.stdout, run.stderr) == ("", "")

    def test_same_seed_same_plan(self, floatplan: Command) -> None:
        for folder in ("one", "two"):
            floatplan("plan", PROBLEMS / "falling_cat.toml", "-o", folder, "--seed", "3", "--quiet", "--no-figures")
        one, two = (json.loads(Path(folder, "plan.json").read_text()) for folder in ("one", "two"))
        np.testing.assert_allclose(one["coefficients"], two["coefficients"], rtol=1e-9, atol=1e-9)
        assert one["solver"]["seed"] == 3

    def test_of_a_flight_in_space_a_proof_is_missing(self, floatplan: Command) -> None:
        assert floatplan("plan", PROBLEMS / "space" / "cat.toml", "-o", "out", "--quiet").code == 0
        assert floatplan("plan", PROBLEMS / "space" / "cat.toml", "-o", "out", "--quiet", "--prove").code == 1

    def test_a_proof_is_not_asked_for_and_left_out(self, floatplan: Command) -> None:
        run = floatplan("plan", PROBLEMS / "backflip.toml", "-o", "out", "--prove", "--no-certify")
        refused(run, "--prove", "--no-certify")
        assert not Path("out").exists()

    @pytest.mark.usefixtures("little_work")
    def test_exit_code_1_where_there_is_no_plan(self, floatplan: Command) -> None:
        run = floatplan("plan", GYMNAST, *HANDSTAND, "--angular-momentum", "40", "-o", "out", "--json")
        assert run.code == 1
        answer = json.loads(run.stdout)
        assert answer["ok"] is False
        assert answer["status"] == "infeasible"
        assert "no plan found" in run.stderr
        assert answer["explanation"]


class TestTrajectory:
    def test_rows_and_columns(self, floatplan: Command) -> None:
        assert floatplan("plan", EXAMPLE, "-o", "out", "--no-figures", "--quiet").code == 0
        rows = list(csv.reader(Path("out/trajectory.csv").read_text().splitlines()))
        assert rows[0][:5] == ["time", "orientation", "orientation_rate", "com_x", "com_y"]
        assert rows[0][5:] == [
            f"{joint}_{quantity}"
            for joint in ("q1", "q2")
            for quantity in ("position", "velocity", "acceleration", "torque")
        ]
        table = np.array(rows[1:], dtype=float)
        np.testing.assert_allclose(table[:, 0], np.arange(1101) / 1000, atol=1e-15)
        plan = fp.load_plan("out/plan.json")
        state = plan.at(table[:, 0])
        np.testing.assert_array_equal(table[:, 1], state.orientation)
        np.testing.assert_array_equal(table[:, 3:5], state.com_position)
        np.testing.assert_array_equal(table[:, 9], state.positions[:, 1])
        np.testing.assert_array_equal(table[:, 8], state.torques[:, 0])

    @pytest.mark.parametrize(("rate", "rows"), [(100.0, 111), (7.0, 9), (0.5, 2)])
    def test_the_end_is_always_a_row(self, rate: float, rows: int, floatplan: Command) -> None:
        from floatplan.plans.trajectory import sample_times

        times = sample_times(1.1, rate)
        assert (times[0], times[-1], len(times)) == (0.0, 1.1, rows)
        assert (np.diff(times) > 0).all()

    @pytest.mark.parametrize("rate", ["0", "-5", "nan", "inf", "1e300"])
    def test_wrong_rates_are_refused(self, rate: str, floatplan: Command) -> None:
        refused(floatplan("plan", EXAMPLE, "--rate", rate), "rate")


class TestRobotAndOptions:
    @pytest.mark.parametrize("goal", [["--goal", "-90,0,0"], ["--goal=-90,0,0"], ["--goal", "-90 0 0"]])
    def test_negative_numbers(self, goal: list[str], floatplan: Command) -> None:
        run = floatplan(
            "plan",
            GYMNAST,
            "--start",
            "72,18,-45",
            *goal,
            "--degrees",
            "--duration",
            "1.4",
            "-o",
            "out",
            "--no-figures",
        )
        assert run.code == 0, run
        problem = fp.load_problem("out/problem.toml")
        assert problem.final.orientation == -math.pi / 2
        assert problem.initial.orientation == math.radians(72)
        np.testing.assert_array_equal(problem.initial.positions, np.radians([18, -45]))

    def test_radians_are_the_default(self, floatplan: Command) -> None:
        floatplan("plan", GYMNAST, "--start", "1,0.5,-0.25", "--goal", "0,0,0", "--duration", "1", "--no-figures")
        problem = fp.load_problem("runs/gymnast/problem.toml")
        assert problem.initial.orientation == 1.0
        np.testing.assert_array_equal(problem.initial.positions, [0.5, -0.25])

    def test_all_options(self, floatplan: Command) -> None:
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

    def test_options_override_a_problem_file(self, floatplan: Command) -> None:
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

    def test_an_overridden_takeoff_moves_the_landing_that_follows_it(self, floatplan: Command) -> None:
        floatplan("plan", PROBLEMS / "falling_cat.toml", "--takeoff", "hand", "-o", "out", "--no-figures")
        assert fp.load_plan("out/plan.json").problem.landing.frame == "hand"

    def test_forgotten_degrees(self, floatplan: Command) -> None:
        run = floatplan("plan", GYMNAST, "--start", "72,18,-45", "--goal", "-90,0,0", "--duration", "1.4")
        refused(run, "command line: --start: positions.q1: 18 rad is outside", "give --degrees")

    @pytest.mark.parametrize(
        ("arguments", "naming"),
        [
            (["--start", "1,2"], ["--start", "2 numbers where 3 are wanted", "orientation, q1, q2"]),
            (["--start", "1,2,x"], ["--start", "'x' is not a number"]),
            (["--goal", "0,0,0"], ["--start", "is missing"]),
            (["--start", "0,0,0"], ["--goal", "is missing", "--duration"]),
            (
                ["--start", "0,0,nan", "--goal", "0,0,0", "--duration", "1"],
                ["--start: positions[1]", "nan is not a finite"],
            ),
            ([*HANDSTAND, "--takeoff", "toe"], ["--takeoff", "no frame 'toe'", "foot"]),
            ([*HANDSTAND, "--degree", "4"], ["--degree", "4 is outside"]),
            ([*HANDSTAND, "--degree", "x"], ["--degree", "'x'"]),
            ([*HANDSTAND, "--objective", "beauty"], ["--objective", "'beauty'"]),
            ([*HANDSTAND, "--angular-momentum", "much"], ["--angular-momentum", "'much'"]),
            ([*HANDSTAND, "--duration", "-1"], ["--duration", "-1.0 s is not positive"]),
            ([*HANDSTAND, "--start-velocities", "1,2,3"], ["--start-velocities", "3 values for 2 joints"]),
            ([*HANDSTAND, "--plane", "xyz"], ["--plane", "xyz"]),
            ([*HANDSTAND, "--budget", "nan"], ["budget"]),
        ],
    )
    def test_wrong_options(self, arguments: list[str], naming: list[str], floatplan: Command) -> None:
        refused(floatplan("plan", GYMNAST, *arguments), *naming)

    def test_a_plane_beside_a_problem_file(self, floatplan: Command) -> None:
        refused(floatplan("plan", EXAMPLE, "--plane", "xz"), "--plane", "robot.plane")

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
    def test_wrong_usage(self, arguments: list[str], floatplan: Command) -> None:
        refused(floatplan(*arguments), "Usage")


class TestWhereResultsGo:
    """Found out before the search: it would be a pity to lose its answer."""

    @pytest.fixture(autouse=True)
    def no_search(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def search(*_: object, **__: object) -> None:
            raise AssertionError("searched, though the results cannot be written")

        monkeypatch.setattr("floatplan.planning.planner.plan", search)

    def test_a_file(self, floatplan: Command, tmp_path: Path) -> None:
        file = tmp_path / "file"
        file.touch()
        refused(floatplan("plan", EXAMPLE, "-o", file), str(file), "is not a directory")
        refused(floatplan("plan", EXAMPLE, "-o", file / "below" / "it"), str(file), "is not a directory")

    def test_a_folder_in_the_way(self, floatplan: Command, tmp_path: Path) -> None:
        (tmp_path / "out" / "plan.json").mkdir(parents=True)
        refused(floatplan("plan", EXAMPLE, "-o", tmp_path / "out"), "plan.json is a directory")

    def test_a_file_in_the_way(self, floatplan: Command, tmp_path: Path) -> None:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "figures").touch()
        refused(floatplan("plan", EXAMPLE, "-o", tmp_path / "out"), "figures is not a directory")

    def test_a_dangling_link(self, floatplan: Command, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to(tmp_path / "nowhere")
        refused(floatplan("plan", EXAMPLE, "-o", tmp_path / "link" / "out"), "link", "is not a directory")

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
    def test_no_permission(self, floatplan: Command, tmp_path: Path) -> None:
        folder = tmp_path / "closed"
        folder.mkdir(mode=0o500)
        refused(floatplan("plan", EXAMPLE, "-o", folder / "out"), "cannot be written to")


class TestInfo:
    def test_json(self, floatplan: Command) -> None:
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

    def test_limits_that_are_given(self, floatplan: Command) -> None:
        facts = json.loads(floatplan("info", URDF / "high_jumper.urdf", "--json").stdout)
        assert facts["velocity_limits"] == [18, 12, 20]
        assert facts["torque_limits"] == [450, 500, 160]

    def test_for_reading(self, floatplan: Command) -> None:
        run = floatplan("info", URDF / "high_jumper.urdf", "--frames")
        assert run.code == 0
        for part in ("high_jumper, 75 kg", "xz", "q3", "-3.4 to 0.6", "450", "foot"):
            assert part in run.stdout, run.stdout

    def test_of_a_problem_file_is_of_its_robot(self, floatplan: Command) -> None:
        assert json.loads(floatplan("info", EXAMPLE, "--json").stdout)["joints"] == ["q1", "q2"]

    def test_missing_file(self, floatplan: Command) -> None:
        refused(floatplan("info", "nowhere.urdf", "--json"), "nowhere.urdf", "no such file")


class TestBounds:
    @pytest.mark.parametrize(("name", "midpoint"), [("new_configuration", 0.0941), ("handstand", -1.1778)])
    def test_examples_of_the_paper(self, name: str, midpoint: float, floatplan: Command) -> None:
        facts = json.loads(floatplan("bounds", PROBLEMS / f"{name}.toml", "--json").stdout)
        assert facts["angular_momentum_midpoint"] == pytest.approx(midpoint, abs=5e-5)
        low, high = facts["angular_momentum_bounds"]
        assert low < facts["angular_momentum_midpoint"] < high
        assert len(facts["D_min"]) == len(facts["D_max"]) == 3

    def test_for_reading(self, floatplan: Command) -> None:
        run = floatplan("bounds", PROBLEMS / "falling_cat.toml")
        assert run.code == 0
        assert "without turning back" in run.stdout
        assert "momentum by rate" in run.stdout

    def test_an_h_outside_is_told(self, floatplan: Command, tmp_path: Path) -> None:
        text = EXAMPLE.read_text().replace("0.13", "13").replace("../urdf", str(URDF))
        path = tmp_path / "p.toml"
        path.write_text(text)
        assert "13.0 kg m^2/s, outside the interval" in floatplan("bounds", path).stdout


class TestCertify:
    def test_proved(self, floatplan: Command, tmp_path: Path) -> None:
        path = example_b().save(tmp_path / "plan.json")
        run = floatplan("certify", path, "--json")
        facts = json.loads(run.stdout)
        assert (run.code, facts["verdict"]) == (0, "proved")
        assert facts["clearance_min"] > 0.02
        keys = {"verdict", "orientation_end", "clearance_min", "torque_peak", "velocity_peak", "findings"}
        assert keys <= set(facts)

    def test_what_was_found_is_kept_where_asked(self, floatplan: Command, tmp_path: Path) -> None:
        path = example_b().save(tmp_path / "plan.json")
        before = path.read_text()
        assert floatplan("certify", path).code == 0
        assert path.read_text() == before
        assert floatplan("certify", path, "--save").code == 0
        assert fp.load_plan(path).record.certificate["verdict"] == "proved"

    def test_a_plan_finds_its_robot_from_any_folder(
        self, floatplan: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        for name in ("problems", "urdf"):
            (tmp_path / "here" / name).symlink_to(ROOT / name)
        assert floatplan("plan", "problems/obstacle.toml", "--no-figures", "--quiet").code == 0
        assert Path(json.loads(Path("runs/obstacle/plan.json").read_text())["robot"]["urdf"]).is_absolute()
        monkeypatch.chdir("runs/obstacle")
        assert floatplan("certify", "plan.json").code == 0
        assert floatplan("export", "plan.json", "-f", "csv").code == 0

    def test_refuted(self, floatplan: Command, tmp_path: Path) -> None:
        record = example_b()
        path = replace(record, angular_momentum=record.angular_momentum + 1e-3).save(tmp_path / "plan.json")
        run = floatplan("certify", path)
        assert run.code == 1
        assert run.stdout.startswith("refuted")
        assert len(run.stdout.splitlines()) <= 25

    def test_a_robot_that_has_moved(self, floatplan: Command, tmp_path: Path) -> None:
        record = example_a()
        path = replace(record, robot=replace(record.robot, urdf="gone.urdf")).save(tmp_path / "plan.json")
        refused(floatplan("certify", path), "gone.urdf", "o such file", "--urdf")
        assert floatplan("certify", path, "--urdf", GYMNAST).code == 0

    def test_bad_input(self, floatplan: Command, tmp_path: Path) -> None:
        refused(floatplan("certify", "nowhere.json"), "nowhere.json", "no such file")
        refused(floatplan("certify", EXAMPLE), "new_configuration.toml", "is a TOML file, not a plan")
        path = example_a().save(tmp_path / "plan.json")
        refused(floatplan("certify", path, "--urdf", URDF / "acrobat.urdf"), "acrobat.urdf")


def program(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "floatplan", *map(str, arguments)]


class TestProcess:
    """What only a process of its own can show."""

    def test_help_is_quick(self) -> None:
        """It imports nothing that takes long: 0.15 s, with Pinocchio it would be 0.6 s."""
        asked = [sys.executable, "-X", "importtime", "-m", "floatplan", "--help"]
        told = subprocess.run(asked, check=True, capture_output=True, text=True).stderr
        imported = {line.rpartition("|")[2].strip() for line in told.splitlines() if line.startswith("import time:")}
        assert "floatplan.cli.commands" in imported
        assert not imported & {"numpy", "scipy", "pinocchio", "matplotlib", "casadi", "mujoco", "viser", "pyarrow"}

    def test_stdout_holds_the_json_object_and_nothing_else(self, tmp_path: Path) -> None:
        done = subprocess.run(
            program("plan", EXAMPLE, "--json"), capture_output=True, text=True, check=True, cwd=tmp_path
        )
        assert json.loads(done.stdout)["ok"] is True

    def test_interrupted(self, tmp_path: Path) -> None:
        code = (
            "import os, signal, floatplan.planning.planner, floatplan.cli\n"
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "def interrupt(*_, **__): os.kill(os.getpid(), signal.SIGINT)\n"
            "floatplan.planning.planner.follow_unconstrained = interrupt\n"
            "floatplan.cli.main()"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, "plan", str(EXAMPLE)],
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=hear_ctrl_c,
            cwd=tmp_path,
        )
        assert done.returncode == 128 + signal.SIGINT
        assert done.stderr == "error: interrupted\n"
        assert list(tmp_path.iterdir()) == []

    def test_a_reader_that_goes_away(self) -> None:
        with subprocess.Popen(
            program("info", GYMNAST, "--json"), stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as done:
            assert done.stdout is not None
            assert done.stderr is not None
            done.stdout.close()
            assert b"Traceback" not in done.stderr.read()
