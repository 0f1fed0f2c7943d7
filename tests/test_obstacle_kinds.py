"""Every room that tells kinds of obstacles apart knows the same ones."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from places import PROBLEMS

import floatplan as fp
from floatplan.certificate.planar.obstacles import SEPARATIONS
from floatplan.certificate.spatial.obstacles import SPATIAL_SEPARATIONS
from floatplan.motion.planar.clearance import OBSTACLE_DISTANCES
from floatplan.motion.spatial.clearance import SPATIAL_DISTANCES
from floatplan.plans.record import OBSTACLES, OBSTACLES_IN_SPACE
from floatplan.problem.parts import OBSTACLE_KINDS, Obstacle
from floatplan.problem.spatial_obstacles import SPATIAL_OBSTACLE_KINDS, SpatialObstacle
from floatplan.view.outlines import OUTLINES

EXAMPLE = PROBLEMS / "new_configuration.toml"
MAPS = (Path(fp.__file__).parent / "view" / "report" / "assets" / "flight.js").read_text(encoding="utf-8")
OF_KINDS = {
    "plan files": OBSTACLES.keys(),
    "certificate": SEPARATIONS.keys(),
    "pages of maps": re.findall(r'^  "?([\w-]+)"?: \(\{', MAPS.split("const CAPSULES = {")[1].split("\n};")[0], re.M),
}
OF_PIECES = {"motion": OBSTACLE_DISTANCES, "pictures": OUTLINES}


@pytest.mark.parametrize("room", OF_KINDS)
def test_every_room_knows_every_kind(room):
    assert set(OF_KINDS[room]) == OBSTACLE_KINDS.keys()


@pytest.mark.parametrize("room", OF_PIECES)
@pytest.mark.parametrize("kind", OBSTACLE_KINDS)
def test_every_room_knows_what_every_kind_is_made_of(room, kind):
    example = OBSTACLE_KINDS[kind].example(1 + 2j, 1.0)
    assert {piece.kind for piece in example.pieces} <= OF_PIECES[room].keys()
    assert example.thickness > 0
    assert example.where


@pytest.mark.parametrize("kind", OBSTACLE_KINDS)
def test_plan_files_hold_every_field_of_its_own(kind):
    own = OBSTACLE_KINDS[kind].keys.keys() - Obstacle.keys.keys()
    assert OBSTACLES[kind].keys() == own


def test_every_room_knows_every_kind_in_space():
    assert SPATIAL_DISTANCES.keys() == OBSTACLES_IN_SPACE.keys() == SPATIAL_OBSTACLE_KINDS.keys()
    assert SPATIAL_SEPARATIONS.keys() == SPATIAL_OBSTACLE_KINDS.keys()
    for kind, known in SPATIAL_OBSTACLE_KINDS.items():
        assert OBSTACLES_IN_SPACE[kind].keys() == known.keys.keys() - SpatialObstacle.keys.keys()


@pytest.mark.parametrize("other", [Obstacle(), "circle"])
def test_a_problem_refuses_other_kinds(other):
    kinds = "Circle, HalfPlane, Bar, Sphere, Capsule, HalfSpace or Box"
    with pytest.raises(fp.InputError, match=rf"obstacles\[0\].*is not a {kinds}"):
        replace(fp.load_problem(EXAMPLE), obstacles=(other,))


def test_a_problem_in_a_plane_refuses_kinds_of_space():
    with pytest.raises(
        fp.InputError, match=r"obstacles\[0\].*a Sphere is for flights in space.*Circle, HalfPlane or Bar"
    ):
        replace(fp.load_problem(EXAMPLE), obstacles=(fp.Sphere(center=(0, 0, 3), radius=0.2),))
