"""Meshes are read as they are written, or refused: no corner is dropped, moved or made up."""

import io
import struct
import tracemalloc

import numpy as np
import pytest
import trimesh

from floatplan.errors import InputError
from floatplan.robot.shapes.capsules import Outline, fit
from floatplan.robot.shapes.collisions import load_mesh

CORNERS = [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]]
FACES = [[0, 1, 2], [1, 3, 2]]
ONES = np.ones(3)
MOST_TIMES = 30  # [-] the bytes of a mesh's file
BLOCKS = 50e6  # [bytes] of a few arrays of as many numbers as are taken at once


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


def sphere(rings):
    """Triangles (f, 3, 3) of a sphere by latitudes and longitudes: corners of one sum x + y + z are many."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, rings + 1), indexing="ij")
    places = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    corners = places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]
    return np.concatenate(
        [np.stack([corners[i] for i in each], axis=2).reshape(-1, 3, 3) for each in ((0, 1, 2), (0, 2, 3))]
    )


def rim(count):
    """Triangles (f, 3, 3) whose corners, drawn at random, are all on the outline of a cylinder along y."""
    rng = np.random.default_rng(3)
    angle = rng.uniform(0, 2 * np.pi, 3 * count)
    return np.stack([np.cos(angle), rng.random(3 * count), np.sin(angle)], axis=1).reshape(-1, 3, 3)


def binary_stl(triangles):
    rows = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["corners"] = triangles
    return b"\0" * 80 + struct.pack("<I", len(rows)) + rows.tobytes()


def test_a_binary_stl_is_what_a_library_reads(tmp_path):
    content = binary_stl(sphere(12))
    mesh = read(tmp_path, "stl", content)
    known = trimesh.load_mesh(io.BytesIO(content), file_type="stl", process=False)
    distinct = np.unique(np.asarray(known.vertices) + 0.0, axis=0)
    assert np.array_equal(np.unique(mesh.corners + 0.0, axis=0), distinct)
    assert len(mesh.corners) == len(distinct)


@pytest.mark.parametrize(
    "triangles", [pytest.param(sphere(120), marks=pytest.mark.long), rim(2_000)], ids=["sphere", "rim"]
)
def test_memory_grows_with_the_file_and_no_faster(tmp_path, triangles):
    """Reading it, its capsules and its hull take so many times the bytes of the file and a constant."""
    content = binary_stl(triangles)
    tracemalloc.start()
    mesh = read(tmp_path, "stl", content)
    fit(Outline(mesh.corners @ np.array([1, 0, 1j]), mesh.edges))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < MOST_TIMES * len(content) + BLOCKS


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
