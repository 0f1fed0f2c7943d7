"""Files that are no motions, or none of this robot, are refused with file, key and reason."""

from __future__ import annotations

import io
import math
import os
import pickle
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import clip_samples as samples
import numpy as np
import pytest
from once import made_once
from scipy.spatial.transform import Rotation

import floatplan as fp
from floatplan.clips.formats import LARGEST_CLIP

FPS = 50.0


def table(**changes: Any) -> Callable[[Path], Path]:
    """Write a CSV of a hop, one of its numbers another: ``frame``, ``column``, ``value``."""

    def write(folder: Path) -> Path:
        path = samples.write_csv(samples.hops(FPS), folder / "clip.csv")
        rows = np.loadtxt(path, delimiter=",")
        rows[changes["frame"], changes["column"]] = changes["value"]
        np.savetxt(path, rows, delimiter=",")
        return path

    return write


def arrays(**changes: Any) -> Callable[[Path], Path]:
    """Write an archive of mjlab's, some of its arrays others; None leaves one out."""

    def write(folder: Path) -> Path:
        data = samples.mjlab_data(samples.hops(FPS)) | changes
        np.savez(folder / "clip.npz", **{key: value for key, value in data.items() if value is not None})
        return folder / "clip.npz"

    return write


def split(points: list[int]) -> Callable[[Path], Path]:
    """Write an archive of LocoMuJoCo's whose trajectories begin at other frames."""

    def write(folder: Path) -> Path:
        data = samples.loco_data(samples.hops(FPS)) | {"split_points": np.array(points)}
        return samples.save_arrays(folder / "clip.npz", data)

    return write


def pickled(**changes: Any) -> Callable[[Path], Path]:
    """Write a pickle of GMR's, some of its values others."""

    def write(folder: Path) -> Path:
        (folder / "clip.pkl").write_bytes(pickle.dumps(samples.gmr_data(samples.hops(FPS)) | changes))
        return folder / "clip.pkl"

    return write


def content(name: str, raw: bytes) -> Callable[[Path], Path]:
    """Write bytes."""

    def write(folder: Path) -> Path:
        (folder / name).write_bytes(raw)
        return folder / name

    return write


class Runs:
    """A pickle that would run a command."""

    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return os.system, ("touch was_run",)


def zeros() -> bytes:
    """A small archive whose array is half a gigabyte of zeros."""
    stream = io.BytesIO()
    packed = zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with packed, packed.open("fps.npy", "w") as member:
        for _ in range(LARGEST_CLIP // 1_000_000 + 1):
            member.write(bytes(1_000_000))
    return stream.getvalue()


def bomb(folder: Path) -> Path:
    """Write that archive."""
    (folder / "clip.npz").write_bytes(made_once("archive of zeros", zeros))
    return folder / "clip.npz"


FRAMES = samples.hops(FPS).frames
WRONG = {
    "a number that is none": (table(frame=7, column=9, value=np.nan), r"clip\.csv.*joints of frame 7"),
    "an endless place": (table(frame=3, column=2, value=np.inf), r"clip\.csv.*place of frame 3"),
    "no number a second": (pickled(fps=float("nan")), r"clip\.pkl.*fps.*nan frames a second"),
    "degrees": (table(frame=5, column=8, value=150.0), r"clip\.csv.*l_knee.*rad outside .*radians"),
    "a quaternion of no length": (
        pickled(root_rot=np.zeros((FRAMES, 4))),
        r"clip\.pkl.*quaternion of frame 0 .*length 0",
    ),
    "one frame": (content("clip.csv", b"0,0,0,0,0,0,1,0,0,0,0\n"), r"clip\.csv.*1 frame"),
    "no frame": (content("clip.csv", b""), r"clip\.csv.*no frame"),
    "text": (content("clip.csv", b"a,b\nc,d\n"), r"clip\.csv.*row 2"),
    "rows of two lengths": (content("clip.csv", b"1,2,3\n1,2\n"), r"clip\.csv.*rows of 2 and of 3"),
    "too few columns": (content("clip.csv", b"1,2,3\n" * 9), r"clip\.csv.*3 columns"),
    "too many frames": (content("clip.csv", b"0,0,0,0,0,0,1,0\n" * 200_010), r"clip\.csv.*more than 200000 frames"),
    "another robot": (pickled(dof_pos=np.zeros((FRAMES, 7))), r"clip\.pkl.*7 joints, the model 4"),
    "frames of two counts": (pickled(dof_pos=np.zeros((FRAMES - 1, 4))), rf"clip\.pkl.*{FRAMES - 1} frames .*{FRAMES}"),
    "frames that go back": (split([40, 0]), r"clip\.npz.*split_points.*\[40, 0\].*one trajectory"),
    "no rate": (arrays(fps=None), r"clip\.npz.*fps"),
    "a rate of 0": (arrays(fps=np.array([0.0])), r"clip\.npz.*fps.*0 frames a second"),
    "rates": (arrays(fps=np.array([1.0, 2.0])), r"clip\.npz.*fps.*2 numbers"),
    "joints that are words": (arrays(joint_pos=np.array([["a"]])), r"clip\.npz.*joint_pos.*table of numbers"),
    "bodies of a wrong shape": (arrays(body_pos_w=np.zeros((5, 3))), r"clip\.npz.*body_pos_w.*\(5, 3\)"),
    "complex numbers": (arrays(joint_pos=np.zeros((FRAMES, 4), complex)), r"clip\.npz.*joint_pos.*table of numbers"),
    "objects": (arrays(joint_pos=np.array([[None]], dtype=object)), r"clip\.npz.*NumPy archive"),
    "unknown keys": (arrays(body_pos_w=None), r"clip\.npz.*no known format"),
    "a pickle that runs": (pickled(root_pos=Runs()), r"clip\.pkl.*system.*not plain data"),
    "a pickle that is cut off": (content("clip.pkl", pickle.dumps({"fps": 1})[:-3]), r"clip\.pkl.*pickle"),
    "an archive that is cut off": (content("clip.npz", b"PK\x03\x04 and no more"), r"clip\.npz.*NumPy archive"),
    "a zip bomb": (bomb, r"clip\.npz.*more than \d+ MB"),
    "another ending": (content("clip.bvh", b"HIERARCHY"), r"clip\.bvh.*\.csv, \.npz or \.pkl"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said(name: str, robot: fp.Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write, message = WRONG[name]
    with pytest.raises(fp.InputError, match=message):
        fp.load_clip(write(tmp_path), model=robot)
    assert not (tmp_path / "was_run").exists()


@pytest.mark.parametrize("command", ["check", "repair"])
@pytest.mark.parametrize("name", WRONG)
def test_commands_refuse_the_same(
    name: str, command: str, model: Path, tmp_path: Path, floatplan: Callable[..., Any]
) -> None:
    write, message = WRONG[name]
    path = write(tmp_path)
    run = floatplan("clip", command, path, "--model", model)
    assert run.code == 2
    assert len(run.stderr.splitlines()) == 1
    assert re.match(rf"error: .*{message}", run.stderr)
    assert not run.stdout
    assert list(tmp_path.glob("*_repaired*")) == []


def test_quaternions_that_change_their_sign_are_the_same_motion(robot: fp.Robot, tmp_path: Path) -> None:
    path = samples.write_csv(samples.hops(FPS), tmp_path / "clip.csv")
    rows = np.loadtxt(path, delimiter=",")
    rows[1::2, 3:7] *= -1.0
    np.savetxt(tmp_path / "signs.csv", rows, delimiter=",")
    plain, signs = (fp.load_clip(each, model=robot, fps=FPS) for each in (path, tmp_path / "signs.csv"))
    np.testing.assert_allclose(signs.configurations, plain.configurations, atol=1e-12)
    assert fp.check_clip(signs).table() == fp.check_clip(plain).table()


def test_a_foot_whose_mesh_is_not_there_is_remarked(tmp_path: Path) -> None:
    model = tmp_path / "hopper.urdf"
    model.write_text(samples.robot_text().replace('<sphere radius="0.02"/>', '<mesh filename="foot.stl"/>'))
    clip = fp.load_clip(samples.write_csv(samples.hops(FPS), tmp_path / "clip.csv"), model=model, fps=FPS)
    assert any(re.search(r"foot\.stl of l_shank and 1 more are not found", remark) for remark in clip.remarks)


def test_a_robot_that_hangs_is_remarked(robot: fp.Robot, tmp_path: Path) -> None:
    """It hangs by its hands, its feet 1 m above the ground, and lets go."""
    times = np.arange(150) / FPS
    fallen = 0.5 * 9.81 * np.clip(times - 1.0, 0.0, math.sqrt(2.0 / 9.81)) ** 2
    still = samples.hops(FPS)
    places = np.stack((0.0 * times, 0.0 * times, still.places[0, 2] + 1.0 - fallen), axis=1)
    hanging = samples.Sample(places, Rotation.identity(len(times)), np.tile(still.joints[0], (len(times), 1)), FPS)
    path = samples.write_csv(hanging, tmp_path / "clip.csv")
    check = fp.check_clip(fp.load_clip(path, model=robot, fps=FPS))
    assert any(re.search(r"ground from 0\.00 to 1\.00 m high: of a robot that hangs", each) for each in check.remarks)
    level = fp.check_clip(fp.load_clip(path, model=robot, fps=FPS, ground=0.0))
    assert not any("hangs" in remark for remark in level.remarks)
    assert [judged.verdict for judged in level.flights] == ["afloat", "physical"]
    afloat, falls = level.flights
    assert afloat.flight.begin == 0.0
    assert falls.flight.begin == pytest.approx(1.0, abs=0.05)


def test_options_that_contradict_the_file(robot: fp.Robot, tmp_path: Path) -> None:
    path = arrays()(tmp_path)
    for options, message in (
        ({"fps": 30.0}, r"50 frames a second, not 30"),
        ({"fps": 0.0}, r"0 frames a second"),
        ({"quaternion": "xyzw"}, r"wxyz, not xyzw"),
        ({"quaternion": "zyxw"}, r"no order"),
        ({"format": "gmr-pkl"}, r"root_pos.*missing"),
        ({"format": "bvh"}, r"no format"),
    ):
        with pytest.raises(fp.InputError, match=message):
            fp.load_clip(path, model=robot, **options)


def test_strange_arguments_are_refused(tmp_path: Path) -> None:
    model = tmp_path / "hopper.urdf"
    model.write_text(samples.robot_text())
    path = samples.write_csv(samples.hops(60, (0.5,), gravity=7.0), tmp_path / "clip.csv")
    strange: list[Any] = [object(), b"1", 1j, [1, "x"], float("nan"), -1.0, {}, np.zeros((2, 2)), "\0", 10**400]
    good: dict[str, Any] = {"path": path, "model": model, "fps": 60.0}
    clip = fp.load_clip(**good)
    for value in strange:
        for name in ("path", "model", "format", "fps", "quaternion", "feet"):
            with pytest.raises(fp.InputError):
                fp.load_clip(**{**good, name: value})
        with pytest.raises(fp.InputError):
            fp.check_clip(value)
        with pytest.raises(fp.InputError):
            fp.repair_clip(value)
        for name in ("choice", "flights", "degree"):
            with pytest.raises(fp.InputError):
                fp.repair_clip(clip, **{name: value})
    with pytest.raises(fp.InputError, match="gravity"):
        fp.check_clip(clip, gravity=-9.81)
