"""Every room that tells kinds of obstacles apart knows the same ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import floatplan as fp
from floatplan.certificate.planar.obstacles import SEPARATIONS
from floatplan.motion.planar.clearance import OBSTACLE_DISTANCES
from floatplan.plans.schema import OBSTACLES
from floatplan.problem.parts import OBSTACLE_KINDS, Obstacle
from floatplan.view.surroundings import OUTLINES

EXAMPLE = Path(__file__).resolve().parents[1] / "problems" / "new_configuration.toml"
REGISTRIES = {
    "motion": OBSTACLE_DISTANCES,
    "plan files": OBSTACLES,
    "certificate": SEPARATIONS,
    "pictures": OUTLINES,
}


@pytest.mark.parametrize("room", REGISTRIES)
def test_every_room_knows_every_kind(room):
    assert REGISTRIES[room].keys() == OBSTACLE_KINDS.keys()


def test_every_class_is_a_kind():
    assert set(OBSTACLE_KINDS.values()) == set(Obstacle.__subclasses__())


@pytest.mark.parametrize("kind", OBSTACLE_KINDS)
def test_plan_files_hold_every_field_of_its_own(kind):
    own = OBSTACLE_KINDS[kind].__dataclass_fields__.keys() - Obstacle.__dataclass_fields__.keys()
    assert OBSTACLES[kind].keys() == own


@pytest.mark.parametrize("other", [Obstacle(), "circle"])
def test_a_problem_refuses_other_kinds(other):
    with pytest.raises(fp.InputError, match=r"obstacles\[0\].*is not a Circle, HalfPlane or Bar"):
        replace(fp.load_problem(EXAMPLE), obstacles=(other,))
