"""What the system may refuse, and what files may be: one message, exit code 2, nothing lost, nothing replaced."""

import contextlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import mkstemp

import pytest
from long_cases import cases

import floatplan as fp
from floatplan import files
from floatplan.cli.results import ResultFile, write_results
from floatplan.errors import InputError, printable
from floatplan.export.formats import FORMATS
from floatplan.files import read_regular
from floatplan.view.figures.figures import save_figures
from floatplan.view.scene.meshes import visual_model


@pytest.fixture(scope="module")
def plan_file(root, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.json"
    return fp.plan(fp.load_problem(root / "problems" / "new_configuration.toml"), prove=True).save(path)


@pytest.fixture(scope="module")
def results_of_a_run(plan_file, tmp_path_factory):
    """A folder with all that a run leaves."""
    folder = tmp_path_factory.mktemp("results")
    plan = fp.load_plan(plan_file)
    write_results(plan, folder, 1000.0)
    save_figures(plan, folder / ResultFile.FIGURES, formats=("png",))
    plan.show(folder / ResultFile.REPORT, browse=False)
    return folder


@pytest.fixture
def results(results_of_a_run, tmp_path):
    return shutil.copytree(results_of_a_run, tmp_path / "results")


@pytest.fixture(scope="module")
def newer(root):
    problem = fp.load_problem(root / "problems" / "new_configuration.toml")
    return fp.plan(replace(problem, flight=replace(problem.flight, duration=1.0)))


def with_mesh(root, folder, kind, name):
    """A gymnast whose first link has a mesh, among its visuals or collisions; and where that is to be written."""
    path = folder / "robot.urdf"
    text = (root / "urdf" / "gymnast.urdf").read_text(encoding="utf-8")
    mesh = f'<{kind}><geometry><mesh filename="{name}"/></geometry></{kind}></link>'
    path.write_text(text.replace("</link>", mesh, 1), encoding="utf-8")
    return path, folder / name


def process(*arguments, shell="", cwd=None):
    """The command line as a process, with what a shell does to its streams."""
    words = " ".join(f"'{word}'" for word in (sys.executable, "-m", "floatplan", *map(str, arguments)))
    return subprocess.run(["bash", "-c", f"{words} {shell}"], capture_output=True, text=True, cwd=cwd, check=False)


class TestReads:
    @pytest.mark.parametrize("command", ["plan", "info", "bounds", "takeoff", "certify", "replay", "show"])
    def test_devices_and_pipes_are_refused(self, floatplan, tmp_path, command):
        pipe = tmp_path / "pipe.toml"
        os.mkfifo(pipe)
        for path in (pipe, Path("/dev/zero"), tmp_path):
            run = floatplan(command, path)
            assert run.code == 2
            assert "is not a regular file" in run.stderr or "is a directory" in run.stderr

    def test_a_file_that_is_too_large_is_not_read(self, tmp_path):
        path = tmp_path / "sparse"
        with path.open("wb") as stream:
            stream.truncate(10**12)
        with pytest.raises(InputError, match="larger than 1 MB"):
            read_regular(path, 10**6, "a plan file")

    @pytest.mark.parametrize(("suffix", "reason"), [(".zip", "is not one of"), (".obj", "larger than")])
    def test_visual_meshes_are_held_to_the_same(self, root, tmp_path, suffix, reason):
        path, mesh = with_mesh(root, tmp_path, "visual", f"part{suffix}")
        with mesh.open("wb") as stream:
            stream.truncate(10**12 if suffix == ".obj" else 10)
        with pytest.raises(InputError, match=reason):
            visual_model(fp.Robot.from_urdf(path))

    @pytest.mark.parametrize("name", ["../secret.urdf", "/etc/passwd", "a/../../secret.urdf"])
    def test_example_robots_stay_in_their_folder(self, tmp_path, monkeypatch, name):
        folder = tmp_path / "robots"
        (folder / "a").mkdir(parents=True)
        (tmp_path / "secret.urdf").write_text('<robot name="x"><link name="a"/></robot>', encoding="utf-8")
        monkeypatch.setenv("EXAMPLE_ROBOT_DATA_MODEL_DIR", str(folder))
        with pytest.raises(InputError, match="has no file"):
            fp.Robot.from_urdf(f"example-robot-data:{name}")


class TestWrites:
    def test_what_is_no_regular_file_is_not_replaced(self, floatplan, plan_file, tmp_path):
        pipe = tmp_path / "pipe"
        os.mkfifo(pipe)
        run = floatplan("export", plan_file, "-f", "csv", "-o", pipe)
        assert (run.code, "is not replaced" in run.stderr) == (2, True)
        assert pipe.is_fifo()

    def test_what_an_older_run_made_goes(self, floatplan, root, results):
        assert floatplan("export", results / "plan.json", "-f", "npz", "-q").code == 0
        (results / "notes.txt").write_text("mine")
        for name in ("comparison.png", "moments.svg", "torque_use.png"):
            (results / "figures" / name).touch()
        older = {path.name for path in results.rglob("*") if path.is_file()}
        assert {"report.html", "torques.png", "trajectory.npz"} <= older
        run = floatplan("plan", root / "problems" / "new_configuration.toml", "-o", results, "--no-figures")
        told = "the plan there is replaced, and what was made of it removed: report.html, trajectory.npz, figures"
        assert (run.code, run.stderr) == (0, f"{results}: {told}\n")
        assert {path.name for path in results.rglob("*") if path.is_file()} == {
            "plan.json",
            "trajectory.csv",
            "notes.txt",
        }

    @pytest.mark.parametrize("full_at", ["plan.json", "trajectory.csv"])
    def test_on_a_full_disk_older_results_stay(self, floatplan, root, results, monkeypatch, full_at):
        older = _contents(results)
        assert {"plan.json", "trajectory.csv", "report.html", "torques.png"} <= {path.name for path in older}
        write = files._temporary_file

        def full(path, content):
            with monkeypatch.context() as patch:
                if path.name == full_at:
                    patch.setattr(files.tempfile, "mkstemp", _on_a_full_disk)
                return write(path, content)

        monkeypatch.setattr(files, "_temporary_file", full)
        run = floatplan("plan", root / "problems" / "new_configuration.toml", "-o", results, "--seed", "1", "-q")
        assert (run.code, run.stderr) == (2, f"error: {results / full_at}: {NO_SPACE}\n")
        assert _contents(results) == older

    @pytest.mark.parametrize(
        ("arguments", "file"),
        [
            (["export", "-f", "csv"], FORMATS["csv"].file),
            *(
                pytest.param(["export", "-f", name], form.file, marks=pytest.mark.long)
                for name, form in FORMATS.items()
                if name not in ("csv", "unitree-sdk")
            ),
            (["show"], "report.html"),
            pytest.param(["show", "--scene"], "scene.html", marks=pytest.mark.long),
            pytest.param(["show", "--png"], "figures/snapshots.png", marks=pytest.mark.long),
            pytest.param(["show", "--svg"], "figures/snapshots.svg", marks=pytest.mark.long),
            (["show", "--gif"], "flight.gif"),
            (["certify", "--save"], "plan.json"),
            (["replay", "--save"], "plan.json"),
            pytest.param(
                ["replay", "--replan", "100", "--flights", "1", "-o", "."], "flights.html", marks=pytest.mark.long
            ),
        ],
    )
    def test_on_a_full_disk_the_file_is_named(self, floatplan, plan_file, tmp_path, monkeypatch, arguments, file):
        """Of a plan; never the temporary name, of which nobody asked for anything."""
        path = shutil.copy(plan_file, tmp_path)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(files.tempfile, "mkstemp", _on_a_full_disk)
        run = floatplan(arguments[0], path, *arguments[1:])
        place = file if "-o" in arguments else tmp_path / file
        assert (run.code, run.stderr) == (2, f"error: {place}: {NO_SPACE}\n")

    def test_what_is_interrupted_leaves_nothing_older_beside_the_new(self, results, newer, tmp_path, monkeypatch):
        """Stopped before each of the removals and renamings: a plan has no company but what was made of it."""
        older = _relative(results)
        unlink, replaced = Path.unlink, Path.replace
        kept = []
        for steps in range(20):
            folder = shutil.copytree(results, tmp_path / str(steps))
            left = iter(range(steps))

            def stopping(act, left=left):
                def counted(*arguments, **options):
                    if next(left, None) is None:
                        raise KeyboardInterrupt
                    return act(*arguments, **options)

                return counted

            with contextlib.suppress(KeyboardInterrupt), monkeypatch.context() as patch:
                patch.setattr(Path, "unlink", stopping(unlink))
                patch.setattr(Path, "replace", stopping(replaced))
                write_results(newer, folder, 1000.0)
            now = {path: content for path, content in _relative(folder).items() if not path.name.startswith(".")}
            kept.append(now[Path("plan.json")] == older[Path("plan.json")])
            if kept[-1]:
                assert now.items() <= older.items()
            else:
                assert not now.items() & older.items()
        assert kept[0]
        assert not kept[-1]
        assert sum(kept) >= 6

    @pytest.mark.parametrize(
        ("shell", "code"),
        [
            pytest.param(">&- 2>&-", 0, marks=pytest.mark.long),
            pytest.param(">/dev/full", 2, marks=pytest.mark.long),
            ("--json >/dev/full", 2),
            pytest.param("2>&- >/dev/null", 0, marks=pytest.mark.long),
            pytest.param("2>/dev/full", 0, marks=pytest.mark.long),
        ],
    )
    def test_closed_and_full_streams_lose_no_plan(self, root, tmp_path, shell, code):
        problem = root / "problems" / "new_configuration.toml"
        run = process("plan", problem, "--no-figures", "-o", tmp_path / "out", shell=shell)
        assert run.returncode == code
        assert "Traceback" not in run.stderr
        assert fp.load_plan(tmp_path / "out" / "plan.json").ok

    @pytest.mark.parametrize("name", ["n" * 300, "a/" + "n" * 300])
    def test_names_that_are_too_long(self, floatplan, root, tmp_path, name):
        problem = root / "problems" / "new_configuration.toml"
        run = floatplan("plan", problem, "--no-figures", "-o", tmp_path / name)
        assert (run.code, "File name too long" in run.stderr) == (2, True)


class TestSizes:
    def test_collisions_are_bounded(self, root, tmp_path):
        text = (root / "urdf" / "gymnast.urdf").read_text(encoding="utf-8")
        box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
        path = tmp_path / "boxes.urdf"
        path.write_text(text.replace("</link>", box * 501 + "</link>", 1), encoding="utf-8")
        with pytest.raises(InputError, match="collision elements, more than 500"):
            _ = fp.Robot.from_urdf(path).shapes

    def test_steps_and_bandwidths_are_bounded(self, floatplan, plan_file):
        for arguments in (["--feedback", "1e300"], ["--engine", "mujoco", "--step", "1e-300"]):
            assert floatplan("replay", plan_file, *arguments).code == 2


class TestText:
    def test_names_cannot_steer_a_terminal(self, root, tmp_path):
        path = tmp_path / "red.urdf"
        text = (root / "urdf" / "gymnast.urdf").read_text(encoding="utf-8")
        path.write_text(text.replace('"q1"', '"q1\u202e"'), encoding="utf-8")
        with pytest.raises(InputError, match="cannot be shown"):
            fp.Robot.from_urdf(path)

    @pytest.mark.parametrize(
        "words", [["x" * 5000], ["\x1b[31m"], ["--" + "x" * 5000], ["--rate", "x" * 5000], ["\udcff"]]
    )
    def test_the_words_of_a_command_line_are_quoted_shortly(self, floatplan, plan_file, words):
        run = floatplan("export", plan_file, "-f", "csv", *words)
        assert run.code == 2
        assert len(run.stderr) < 2000
        assert run.stderr.replace("\n", "").isprintable()

    @pytest.mark.parametrize("name", ["\x1b[31mred.csv", "two\nlines.csv", "\udcff.csv"])
    def test_paths_are_printed_on_one_line(self, floatplan, plan_file, root, tmp_path, name):
        problem = root / "problems" / "new_configuration.toml"
        for arguments in (
            ["export", plan_file, "-f", "csv"],
            ["show", plan_file],
            ["plan", problem, "--no-figures"],
            ["schema"],
        ):
            run = floatplan(*arguments, "-o", tmp_path / name)
            assert run.code in (0, 2)
            assert (run.stdout + run.stderr).replace("\n", "").isprintable()
            assert len(run.stdout.splitlines()) <= 1

    def test_messages_are_one_line_and_short(self):
        error = InputError("bad\x1b[31m\nthing " + "x" * 5000, element="e" * 999, advice="a " * 999, source="s" * 9999)
        assert len(str(error)) < 1500
        assert str(error).isprintable()
        assert printable("/a/" + "b" * 200 + "/end").endswith("/end")


NO_SPACE = "cannot be written: No space left on device"


def _on_a_full_disk(**options):
    """A temporary file of which nothing can be written."""
    _, path = mkstemp(**options)
    return os.open("/dev/full", os.O_WRONLY), path


def _contents(folder):
    """All files below a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _relative(folder):
    return {path.relative_to(folder): content for path, content in _contents(folder).items()}


def test_a_table_has_no_formula(root, tmp_path):
    text = (root / "urdf" / "gymnast.urdf").read_text(encoding="utf-8").replace('"q1"', '"=1+1"')
    (tmp_path / "g.urdf").write_text(text, encoding="utf-8")
    robot = fp.Robot.from_urdf(tmp_path / "g.urdf")
    problem = fp.Problem(robot, fp.Posture(0, [0, 0]), fp.Posture(0.5, [0.1, 0.2]), fp.Flight(duration=1.0))
    path = fp.plan(problem).export("csv", tmp_path / "t.csv")
    assert all(cell[0] not in "=+-@" for cell in path.read_text(encoding="utf-8").splitlines()[0].split(","))


LETTERS = "g\u00e9l\u00e9nk \u0107 [red]"


@pytest.mark.parametrize("encoding", cases(["ascii", "latin-1", "cp1252"], ["latin-1", "cp1252"]))
def test_letters_that_a_terminal_has_not_are_told_in_another_way(root, tmp_path, encoding):
    """As of a locale such as C or de_DE.ISO-8859-1: the answer and the exit code are those of any other."""
    urdf = (root / "urdf" / "gymnast.urdf").read_text(encoding="utf-8").replace('"q1"', f'"{LETTERS}"')
    (tmp_path / "robot.urdf").write_text(urdf, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "floatplan", "info", "robot.urdf"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONIOENCODING": f"{encoding}:strict"},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert LETTERS.encode(encoding, "backslashreplace") in done.stdout


def test_a_folder_whose_name_is_no_text_is_told(root, tmp_path, floatplan, monkeypatch):
    """Its bytes are not UTF-8, so that no problem file can lead there; beside the robot it need not."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/d\xe9\xff"))
    folder.mkdir()
    shutil.copy(root / "urdf" / "acrobat.urdf", folder / "robot.urdf")
    monkeypatch.setitem(sys.modules, "casadi", None)  # no jump is looked for, which takes seconds
    run = floatplan("init", folder / "robot.urdf", "-o", tmp_path / "here.toml")
    assert run.code == 2
    assert "cannot be written: it would hold" in run.stderr
    assert "which is not UTF-8; rename the file or folder" in run.stderr
    assert not (tmp_path / "here.toml").exists()
    run = floatplan("init", folder / "robot.urdf", "-o", folder / "here.toml")
    assert run.code == 0, run.stderr
    assert run.stderr.isprintable() or "\\udce9" in run.stdout + run.stderr
