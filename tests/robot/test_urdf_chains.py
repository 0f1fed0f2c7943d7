"""The chains of ``urdf/``: written by their script, and those of the paper's Table I."""

import runpy
import sys

import numpy as np
import pytest
from robot_samples import CHAIN_NAMES, URDF_FOLDER

from floatplan.robot import Robot

SCRIPT = URDF_FOLDER.parent / "benchmarks" / "make_chain.py"


def test_script_writes_the_files_byte_for_byte(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(tmp_path)])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(CHAIN_NAMES)
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (URDF_FOLDER / path.name).read_bytes()


@pytest.mark.parametrize("name", CHAIN_NAMES)
def test_chain_is_its_table(name):
    bodies = runpy.run_path(str(SCRIPT))["CHAINS"][name]
    robot = Robot.from_urdf(URDF_FOLDER / f"{name}.urdf")
    tree = robot.tree
    assert robot.warnings == ()
    assert (robot.plane.name, tuple(robot.plane.normal), robot.plane.turn) == ("xz", (0, -1, 0), 1.0)
    assert robot.joints == tuple(f"q{i}" for i in range(1, len(bodies)))
    assert tree.names == tuple(body.name for body in bodies)
    assert tree.mass.tolist() == [body.m for body in bodies]
    assert tree.inertia == pytest.approx([body.I for body in bodies], rel=1e-14)
    assert tree.center == pytest.approx([body.l for body in bodies], rel=1e-14)
    assert tree.anchor[1:] == pytest.approx([body.l + body.r for body in bodies[:-1]], rel=1e-14)
    assert tree.turns.tolist() == np.tri(len(bodies), len(bodies) - 1, -1).tolist()
    assert not tree.offsets.any()
    assert (robot.frames["foot"].body, robot.frames["foot"].local) == (0, 0j)
    assert robot.frames["hand"].body == len(bodies) - 1
    assert robot.frames["hand"].local == pytest.approx(bodies[-1].l + bodies[-1].r, rel=1e-14)
