"""What is drawn of a robot: less than there is, and nothing that could be seen is missing."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

import floatplan as fp
from floatplan.view.scene.meshes import bends, coarser, fewer, joined, uniform_colour

ROOT = Path(__file__).parents[2]


class TestCoarser:
    @pytest.mark.parametrize("cell", [0.05, 0.1, 0.4])
    def test_no_point_is_far_from_where_it_was(self, cell):
        ball = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
        vertices, faces = coarser(ball.vertices, ball.faces, cell)
        drawn = trimesh.Trimesh(vertices, faces, process=False)
        assert np.abs(np.linalg.norm(drawn.triangles_center, axis=1) - 1).max() < np.sqrt(3) * cell
        apart = np.linalg.norm(ball.vertices[:, None] - vertices, axis=2)
        assert apart.min(axis=1).max() <= np.sqrt(3) * cell
        assert len(faces) <= len(ball.faces)
        assert np.array_equal(np.unique(faces), np.arange(len(vertices)))
        assert (np.einsum("ij,ij->i", drawn.face_normals, drawn.triangles_center) > 0).mean() > 0.99, "outside is out"

    def test_fine_meshes_become_light(self):
        ball = trimesh.creation.icosphere(subdivisions=6, radius=1.0)
        _, faces = coarser(ball.vertices, ball.faces, 0.1)
        assert len(ball.faces) == 81920
        assert 1000 < len(faces) < 5000

    def test_a_mesh_that_is_coarse_already_stays(self):
        box = trimesh.creation.box((1.0, 2.0, 3.0))
        vertices, faces = coarser(box.vertices, box.faces, 0.1)
        drawn = trimesh.Trimesh(vertices, faces)
        assert drawn.volume == pytest.approx(6.0)
        assert drawn.is_watertight


class TestFewer:
    @pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
    @pytest.mark.parametrize("count", [100, 1000, 4000])
    def test_a_ball_stays_round(self, count, scale):
        ball = trimesh.creation.icosphere(subdivisions=5, radius=1.0)
        vertices, faces = fewer(scale * ball.vertices, ball.faces, count)
        drawn = trimesh.Trimesh(vertices / scale, faces, process=False)
        assert 0.9 * count < len(faces) <= count
        assert np.abs(np.linalg.norm(drawn.vertices, axis=1) - 1).max() < 20 / count
        assert drawn.volume == pytest.approx(ball.volume, rel=20 / count)
        assert drawn.is_watertight

    def test_flat_sides_take_fewest(self):
        ball, box = trimesh.creation.icosphere(subdivisions=5), trimesh.creation.box((1.0, 2.0, 3.0))
        for _ in range(4):
            box = box.subdivide()
        meshes = [(box.vertices, box.faces), (np.add(ball.vertices, [5.0, 0.0, 0.0]), ball.faces)]
        vertices, faces = fewer(*joined(meshes), 1000)
        assert len(box.faces) == 3072
        assert (vertices[faces[:, 0], 0] < 2.0).sum() == 12
        assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(6.0 + ball.volume, rel=0.02)

    def test_few_stay_as_they_are(self):
        ball = trimesh.creation.icosphere(subdivisions=1)
        vertices, faces = fewer(ball.vertices, ball.faces, 80)
        assert vertices is ball.vertices
        assert faces is ball.faces

    def test_without_the_library_there_is_one_clear_error(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "fast_simplification", None)
        ball = trimesh.creation.icosphere(subdivisions=2)
        with pytest.raises(fp.InputError, match="fast-simplification is not installed") as caught:
            fewer(ball.vertices, ball.faces, 80)
        assert "view" in str(caught.value)


class TestBends:
    def test_a_circle_is_as_round_as_asked(self):
        circle = np.exp(1j * np.linspace(0.0, 2 * np.pi, 1001))
        kept = bends(circle, 0.1)
        assert kept[0] == 0
        assert kept[-1] == 1000
        assert 63 <= len(kept) <= 64  # 2 pi / 0.1, and both ends
        assert np.abs(circle[kept[:-1]] + np.diff(circle[kept]) / 2).min() > np.cos(0.06)

    def test_a_line_is_its_ends(self):
        assert bends(np.linspace(0.0, 1 + 2j, 50), 0.1).tolist() == [0, 49]

    def test_a_corner_stays(self):
        path = np.concatenate((np.linspace(0, 1, 20), 1 + 1j * np.linspace(0, 1, 20)[1:]))
        assert bends(path, 0.1).tolist() == [0, 19, 38]

    def test_one_that_stands_still(self):
        assert bends(np.full(20, 1 + 1j), 0.1).tolist() == [0, 19]


class TestPlainColour:
    def test_of_a_material(self):
        mesh = trimesh.creation.box()
        mesh.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[171, 177, 197, 255]))
        assert uniform_colour(mesh) == (171, 177, 197)

    def test_of_faces(self):
        mesh = trimesh.creation.box()
        mesh.visual = ColorVisuals(mesh, face_colors=[[1, 2, 3, 255]] * 12)
        assert uniform_colour(mesh) == (1, 2, 3)
        mesh.visual.face_colors[3] = [1, 2, 4, 255]
        assert uniform_colour(mesh) is None

    def test_glass_is_drawn_as_it_is(self):
        mesh = trimesh.creation.box()
        mesh.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[171, 177, 197, 100]))
        assert uniform_colour(mesh) is None
