"""What is drawn of a robot: less than there is, and nothing that could be seen is missing."""

import sys

import numpy as np
import pytest
import trimesh

import floatplan as fp
from floatplan.view.scene.meshes import coarser, fewer


class TestCoarser:
    @pytest.mark.parametrize("cell", [0.05, 0.1, 0.4])
    def test_no_point_is_far_from_where_it_was(self, cell):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
        vertices, faces = coarser(ball.vertices, ball.faces, cell)
        drawn = trimesh.Trimesh(vertices, faces, process=False)
        assert np.abs(np.linalg.norm(drawn.triangles_center, axis=1) - 1).max() < np.sqrt(3) * cell
        apart = np.linalg.norm(ball.vertices[:, None] - vertices, axis=2)
        assert apart.min(axis=1).max() <= np.sqrt(3) * cell
        assert len(faces) <= len(ball.faces)
        assert np.array_equal(np.unique(faces), np.arange(len(vertices)))
        assert (np.einsum("ij,ij->i", drawn.face_normals, drawn.triangles_center) > 0).mean() > 0.99, "outside is out"


class TestFewer:
    def test_without_the_library_there_is_one_clear_error(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "fast_simplification", None)
        ball = trimesh.creation.icosphere(subdivisions=2)
        with pytest.raises(fp.InputError, match="fast-simplification is not installed") as caught:
            fewer(ball.vertices, ball.faces, 80)
        assert "view" in str(caught.value)
