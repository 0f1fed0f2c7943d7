"""Meshes are read as they are written, or refused: no corner is dropped, moved or made up."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh

from floatplan.errors import InputError
from floatplan.robot.shapes.collisions import find_mesh, load_mesh

CORNERS = [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]]
FACES = [[0, 1, 2], [1, 3, 2]]
ONES = np.ones(3)


def stl(corners, faces):
    """A binary STL; faces name corners."""
    triangles = np.array(corners, dtype="<f4")[np.array(faces)]
    rows = [struct.pack("<3f", 0, 0, 1) + triangle.tobytes() + b"\0\0" for triangle in triangles]
    return b"\0" * 80 + struct.pack("<I", len(rows)) + b"".join(rows)


def obj(corners, faces):
    lines = [f"v {' '.join(map(str, corner))}" for corner in corners]
    return "\n".join([*lines, *(f"f {' '.join(str(k + 1) for k in face)}" for face in faces), ""]).encode()


def off(corners, faces):
    rows = [f"OFF\n{len(corners)} {len(faces)} 0", *(" ".join(map(str, corner)) for corner in corners)]
    return "\n".join([*rows, *(f"3 {' '.join(map(str, face))}" for face in faces), ""]).encode()


def ply(corners, faces):
    head = f"ply\nformat ascii 1.0\nelement vertex {len(corners)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [*(" ".join(map(str, corner)) for corner in corners), *(f"3 {' '.join(map(str, face))}" for face in faces)]
    return (head + "\n".join([*rows, ""])).encode()


def dae(corners, faces):
    source = "http://www.collada.org/2005/11/COLLADASchema"
    numbers = " ".join(str(part) for corner in corners for part in corner)
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    accessor = f'<accessor count="{len(corners)}" source="#pa" stride="3">{params}</accessor>'
    return (
        f'<?xml version="1.0"?><COLLADA xmlns="{source}" version="1.4.1"><asset><up_axis>Z_UP</up_axis></asset>'
        f'<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="{3 * len(corners)}">'
        f"{numbers}</float_array><technique_common>{accessor}</technique_common></source>"
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles count="{len(faces)}"><input offset="0" semantic="VERTEX" source="#v"/>'
        f"<p>{' '.join(str(k) for face in faces for k in face)}</p></triangles></mesh></geometry></library_geometries>"
        '<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    ).encode()


KINDS = {"stl": stl, "obj": obj, "off": off, "ply": ply, "dae": dae}


def read(folder, kind, content, scale=ONES):
    path = folder / f"part.{kind}"
    path.write_bytes(content)
    return load_mesh(path, np.asarray(scale), 'link "a": collision: mesh')


def refusal(folder, kind, content, scale=ONES):
    with pytest.raises(InputError) as caught:
        read(folder, kind, content, scale)
    assert caught.value.source.endswith(f"part.{kind}")
    assert caught.value.element == 'link "a": collision: mesh'
    return caught.value.reason


@pytest.mark.parametrize("kind", KINDS)
def test_corners_and_edges_are_those_of_the_file(tmp_path, kind):
    mesh = read(tmp_path, kind, KINDS[kind](CORNERS, FACES), (1, 2, -0.5))
    wanted = np.array(CORNERS) * (1, 2, -0.5)
    assert sorted(mesh.corners.tolist()) == sorted(wanted.tolist())
    edges = {frozenset(map(tuple, mesh.corners[edge].tolist())) for edge in mesh.edges}
    pairs = [(0, 1), (1, 2), (0, 2), (1, 3), (2, 3)]
    assert edges == {frozenset(map(tuple, wanted[list(pair)].tolist())) for pair in pairs}
    assert len(mesh.edges) == 5


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e30", "1e38", "-2000"])
def test_corners_that_are_nowhere_are_refused(tmp_path, kind, number):
    corners = [*CORNERS[:3], [float(number) if kind == "stl" else number, 0, 1]]
    reason = refusal(tmp_path, kind, KINDS[kind](corners, FACES))
    assert "finite" in reason or "NaN" in reason or "farther away" in reason or "farther than" in reason


@pytest.mark.parametrize("kind", ["obj", "off", "ply", "dae"])
@pytest.mark.parametrize("corner", [4, 9, -2])
def test_faces_without_corners_are_refused(tmp_path, kind, corner):
    faces = [FACES[0], [1, corner, 2]]
    if kind == "obj" and corner < 0:
        faces = [FACES[0], [1, -9, 2]]  # counts from the end there
    refusal(tmp_path, kind, KINDS[kind](CORNERS, faces))


@pytest.mark.parametrize("kind", KINDS)
def test_meshes_without_faces_are_refused(tmp_path, kind):
    content = stl(CORNERS, np.zeros((0, 3), dtype=int)) if kind == "stl" else KINDS[kind](CORNERS, [])
    refusal(tmp_path, kind, content)


@pytest.mark.parametrize("content", [b"", b"this is not a mesh", b"\0" * 100])
@pytest.mark.parametrize("kind", ["stl", "obj", "off", "ply", "dae", "glb", "xyz", "txt", ""])
def test_what_is_no_mesh_is_refused(tmp_path, kind, content):
    refusal(tmp_path, kind, content)


def test_a_part_that_is_broken_is_not_left_out(tmp_path):
    """Beside a geometry that is sound, one whose faces have no corners: a reader would pass over it."""
    sound = dae(CORNERS, FACES).decode()
    geometry = sound[sound.index("<geometry") : sound.index("</library_geometries>")]
    broken = geometry.replace('id="g"', 'id="h"').replace("1 3 2", "1 7 2")
    both = sound.replace(geometry, geometry + broken)
    both = both.replace('<instance_geometry url="#g"/>', '<instance_geometry url="#g"/><instance_geometry url="#h"/>')
    refusal(tmp_path, "dae", both.encode())


def test_near_corners_are_not_merged(tmp_path):
    """A mesh in units of kilometres: a hundred-millionth of one is 10 micrometres."""
    corners = [[0, 0, 0], [1e-9, 0, 0], [0, 0, 1e-9]]
    mesh = read(tmp_path, "obj", obj(corners, [[0, 1, 2]]), (1e6, 1e6, 1e6))
    assert np.ptp(mesh.corners, axis=0) == pytest.approx([1e-3, 0, 1e-3])


def test_corners_that_no_face_has_do_not_count(tmp_path):
    mesh = read(tmp_path, "off", off([*CORNERS, [50, 0, 50]], FACES))
    assert len(mesh.corners) == 4


def test_a_scale_is_part_of_the_size(tmp_path):
    in_millimetres = stl(np.array(CORNERS) * 900, FACES)
    assert read(tmp_path, "stl", in_millimetres, (1e-3, 1e-3, 1e-3)).corners.max() == pytest.approx(0.9)
    assert "farther than" in refusal(tmp_path, "stl", in_millimetres, (1e3, 1, 1))


def test_the_mesh_is_in_the_file_alone(tmp_path):
    """What a glTF keeps in another file would escape the hash."""
    files = trimesh.Scene(trimesh.creation.box()).export(file_type="gltf")
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    refusal(tmp_path, "gltf", (tmp_path / "model.gltf").read_bytes())
    glb = trimesh.Scene(trimesh.creation.box()).export(file_type="glb")
    assert np.ptp(read(tmp_path, "glb", glb).corners, axis=0) == pytest.approx([1, 1, 1])


def test_a_scene_with_a_corner_that_is_not_finite_is_refused(tmp_path):
    """Readers of scenes process their parts unasked, and drop such corners with their faces."""
    scene = trimesh.Scene(trimesh.creation.box())
    content = bytearray(scene.export(file_type="glb"))
    corner = np.array([0.5, 0.5, 0.5], dtype="<f4").tobytes()
    assert corner in content
    at = content.index(corner)
    content[at : at + 4] = struct.pack("<f", float("nan"))
    assert "not finite" in refusal(tmp_path, "glb", bytes(content))


@pytest.mark.parametrize("name", ["n" * 5000, "package://" + "n" * 5000, "a\0b", "nobody.stl"])
def test_a_name_that_no_file_can_have_is_that_of_none(tmp_path, name):
    assert find_mesh(name, tmp_path) is None
