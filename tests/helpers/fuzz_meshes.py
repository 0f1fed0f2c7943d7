"""Robots of the gallery with their meshes beside them, some of it spoiled: URDF, SRDF and mesh files."""

from __future__ import annotations

import contextlib
import gzip
import hashlib
import io
import json
import random
import shutil
import struct
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from fuzz_mutations import spoiled, spoiled_bytes
from fuzz_sources import FLYING, FORMATS, GALLERY, PREFIX, plan_of, problem_file, robot_of

from floatplan.robot.shapes.collisions import find_mesh

COUNTS = (0, 1, 2**16, 10**9, 2**31 - 1, 2**32 - 1)  # claimed of triangles, corners, bytes
ODD = ("nan", "inf", "-1e300", "1e39", "-0", "1e-320", "99999999999999999999", "x", "")
MEGABYTES_OF_ARCHIVES = 20


def prepare_robot(rng: random.Random, folder: Path) -> list[str]:
    """Write a robot of the gallery, its meshes, a problem or a plan of it, and return the arguments of a command."""
    planned = rng.random() < 0.4
    name = rng.choice(FLYING if planned else GALLERY)
    urdf = _copied(robot_of(name), folder)
    _spoil_robot(rng, urdf)
    if planned:
        plan = folder / "plan.json"
        content = json.loads(plan_of(name).read_text(encoding="utf-8"))
        if rng.random() < 0.8:
            _vouch(content["robot"], urdf)
        plan.write_text(json.dumps(content), encoding="utf-8")
        command = rng.choice(
            (["certify"], ["replay"], ["show"], ["show", "--scene"], ["export", "-f", rng.choice(FORMATS)])
        )
        return [command[0], str(plan), *command[1:], "--urdf", str(urdf)]
    problem = folder / "problem.toml"
    text = problem_file(name).read_text(encoding="utf-8")
    problem.write_text(text.replace(PREFIX + robot_of(name), str(urdf)), encoding="utf-8")
    return rng.choice(
        (
            ["plan", str(problem), "--budget", "1", "--no-figures", "-o", str(folder / "out")],
            ["info", str(urdf)],
            ["info", str(problem), "--json"],
            ["info", str(urdf), "--shapes", str(folder / "shapes.png")],
            ["bounds", str(problem)],
        )
    )


def _copied(name: str, folder: Path) -> Path:
    """The URDF in a folder like the package's own, with its SRDFs, and links to the meshes that it names."""
    from floatplan.robot.urdf.tree import urdf_path

    origin = urdf_path(PREFIX + name)
    robots = origin.parents[len(Path(name).parts) - 1]
    here = folder / "example-robot-data" / "robots"
    (here / name).parent.mkdir(parents=True)
    shutil.copy(origin, here / name)
    for path in (origin.parent.parent / "srdf").glob("*.srdf"):
        copy = here / path.relative_to(robots)
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(path, copy)
    for filename in _mesh_names(here / name):
        path = here / filename.removeprefix("package://example-robot-data/robots/")
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.symlink_to(robots / path.relative_to(here))
    return here / name


def _vouch(robot: dict[str, Any], urdf: Path) -> None:
    """Have a plan's record of its robot say that the spoiled files are those that were planned with."""
    robot["sha256"] = hashlib.sha256(urdf.read_bytes()).hexdigest()
    with contextlib.suppress(ElementTree.ParseError):
        names = _mesh_names(urdf, "collision")
        files = {name: find_mesh(name, urdf.parent) for name in names}
        robot["meshes"] = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items() if path}


def _mesh_names(urdf: Path, within: str = "robot") -> list[str]:
    root = ElementTree.parse(urdf).getroot()
    parts = [root] if within == "robot" else list(root.iter(within))
    return sorted({mesh.get("filename", "") for part in parts for mesh in part.iter("mesh")})


def _spoil_robot(rng: random.Random, urdf: Path) -> None:
    meshes = _mesh_names(urdf, rng.choice(("collision", "collision", "robot")))
    states = list((urdf.parent.parent / "srdf").glob("*.srdf"))
    if meshes and rng.random() < 0.75:
        name = rng.choice(meshes)
        path = urdf.parents[2] / name.removeprefix("package://example-robot-data/robots/")
        content, kind = spoiled_mesh(rng, path.read_bytes(), path.suffix.lower())
        new = path.with_name(f"spoiled{kind}")
        new.write_bytes(content)
        text = urdf.read_text(encoding="utf-8")
        urdf.write_text(text.replace(name, name.removesuffix(path.name) + new.name), encoding="utf-8")
        return
    spoil = rng.choice([urdf, urdf, *states])
    spoil.write_bytes(spoiled(rng, spoil))


def spoiled_mesh(rng: random.Random, content: bytes, kind: str) -> tuple[bytes, str]:
    """A mesh file's content with faults, and the kind of file that it then is."""
    action = rng.random()
    if action < 0.25:
        return _SPOILERS.get(kind, spoiled_bytes)(rng, content), kind
    if action < 0.45:
        return spoiled_bytes(rng, content), kind
    if action < 0.55:
        return rng.choice(_archives()), rng.choice((kind, ".zip", ".3mf", ".glb", ".obj"))
    if action < 0.65:
        return content, rng.choice((".stl", ".obj", ".dae", ".ply", ".off", ".glb", ".gltf", ".STL", ".xyz", ""))
    kind = rng.choice(sorted(_WRITERS))
    written = _WRITERS[kind](rng)
    return (spoiled_bytes(rng, written) if rng.random() < 0.3 else written), kind


@cache
def _archives() -> tuple[bytes, ...]:
    """Small files that become large ones."""
    zeros = bytes(MEGABYTES_OF_ARCHIVES * 10**6)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mesh.stl", zeros)
    return stream.getvalue(), gzip.compress(zeros)


def _number(rng: random.Random) -> str:
    return rng.choice(ODD) if rng.random() < 0.15 else f"{rng.uniform(-0.1, 0.1):.4f}"


def _index(rng: random.Random) -> str:
    return (
        rng.choice(("-1", "0", "999999", str(2**31), str(10**30), "1.5")) if rng.random() < 0.15 else rng.choice("1234")
    )


def _count(rng: random.Random, true: int) -> int:
    return rng.choice(COUNTS) if rng.random() < 0.6 else true


def _rows(rng: random.Random, count: int, item: Callable[[random.Random], str], before: str = "") -> str:
    return "".join(f"{before}{' '.join(item(rng) for _ in range(3))}\n" for _ in range(count))


def _stl(rng: random.Random, content: bytes) -> bytes:
    """A binary file's count of triangles, or the numbers of one of them."""
    if rng.random() < 0.5 or len(content) < 184:
        return content[:80] + struct.pack("<I", rng.choice(COUNTS)) + content[84:]
    at = 84 + 50 * rng.randrange((len(content) - 84) // 50) + 4 * rng.randrange(12)
    return content[:at] + struct.pack("<f", rng.choice((float("nan"), float("inf"), 1e38, -1e20))) + content[at + 4 :]


def _text(rng: random.Random, content: bytes) -> bytes:
    """One word of a text file."""
    words = content.split(b" ")
    words[rng.randrange(len(words))] = rng.choice(ODD).encode()
    return b" ".join(words)


def _write_stl(rng: random.Random) -> bytes:
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    facets = "".join(facet.format(_rows(rng, rng.choice((0, 2, 3, 3, 3, 4)), _number, "vertex ")) for _ in range(4))
    return f"solid {rng.choice(('x', '', 'x' * 5000))}\n{facets}endsolid".encode()


def _write_obj(rng: random.Random) -> bytes:
    corners = rng.choice((3, 4, 50_000)) if rng.random() < 0.2 else 3
    face = "f " + " ".join(_index(rng) for _ in range(corners)) + "\n"
    extras = rng.choice(("", "mtllib /dev/zero\n", "mtllib ../../../etc/passwd\n", "usemtl x\n", "call other.obj\n"))
    return f"{extras}{_rows(rng, 4, _number, 'v ')}{_rows(rng, 3, _index, 'f ')}{face}".encode()


def _write_off(rng: random.Random) -> bytes:
    faces = "".join(f"3 {row}\n" for row in _rows(rng, 4, _index).splitlines())
    return f"OFF\n{_count(rng, 5)} {_count(rng, 4)} 0\n{_rows(rng, 5, _number)}{faces}".encode()


def _write_ply(rng: random.Random) -> bytes:
    form = rng.choice(("ascii", "binary_little_endian", "binary_big_endian"))
    properties = "".join(f"property {rng.choice(('float', 'double', 'uchar', 'x'))} {axis}\n" for axis in "xyz")
    header = (
        f"ply\nformat {form} 1.0\nelement vertex {_count(rng, 5)}\n{properties}"
        f"element face {_count(rng, 4)}\nproperty list {rng.choice(('uchar', 'int'))} int vertex_indices\nend_header\n"
    )
    if form != "ascii":
        return header.encode() + rng.randbytes(rng.choice((10, 200)))
    return f"{header}{_rows(rng, 5, _number)}{_rows(rng, 4, _index, '3 ')}".encode()


def _write_gltf(rng: random.Random) -> bytes:
    return json.dumps(_scene(rng, "data:application/octet-stream;base64," + "AAAA" * 40)).encode()


def _write_glb(rng: random.Random) -> bytes:
    text = json.dumps(_scene(rng, None)).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", _count(rng, len(text)), b"JSON") + text + struct.pack("<I4s", _count(rng, 120), b"BIN\0")
    return b"glTF" + struct.pack("<II", rng.choice((2, 2, 2, 1, 9)), _count(rng, len(body) + 132)) + body + bytes(120)


def _scene(rng: random.Random, uri: str | None) -> dict[str, object]:
    """A glTF scene whose nodes may lie in one another, and whose parts claim sizes that they do not have."""
    uri = rng.choice((uri, uri, uri, "/dev/zero", "../../../etc/passwd", "http://localhost:1/x"))
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"mesh": 0, "children": rng.choice(([1], [1, 1], [0], [99])), "scale": [rng.choice((1.0, 1e300))] * 3},
            {"mesh": 0, "children": rng.choice(([], [], [0], [1]))},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": rng.choice((4, 5, 6, 99))}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": _count(rng, 4), "type": "VEC3"},
            {"bufferView": 1, "componentType": rng.choice((5125, 1)), "count": _count(rng, 6), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": _count(rng, 48)},
            {"buffer": 0, "byteOffset": _count(rng, 48), "byteLength": 24, "byteStride": rng.choice((4, 0, 10**9))},
        ],
        "buffers": [{"byteLength": _count(rng, 120)} | ({} if uri is None else {"uri": uri})],
    }


def _write_dae(rng: random.Random) -> bytes:
    numbers = " ".join(_number(rng) for _ in range(12))
    bomb = "<!DOCTYPE x [<!ENTITY a 'aaaaaaaaaa'>" + "".join(
        f"<!ENTITY {new} '{f'&{old};' * 10}'>" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
    )
    bomb += "<!ENTITY file SYSTEM 'file:///etc/hostname'>]>"
    start = rng.choice(("", "", bomb))
    word = rng.choice(("&i;", "&file;")) if start else rng.choice(("", "nan"))
    return (
        f'<?xml version="1.0"?>{start}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset><unit meter="{rng.choice(("1", "0", "1e300", "nan"))}"/><up_axis>{rng.choice(("Z_UP", "?"))}</up_axis>'
        f'</asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" '
        f'count="{_count(rng, 12)}">{numbers} {word}</float_array><technique_common><accessor source="#a" '
        f'count="{_count(rng, 4)}" stride="{rng.choice((3, 0, 10**9))}"><param name="X" type="float"/>'
        f'<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        f'<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="{_count(rng, 2)}">'
        f'<input semantic="VERTEX" source="#v" offset="0"/><p>{_rows(rng, 2, _index)}</p></triangles></mesh></geometry>'
        f'</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n">'
        f'<instance_geometry url="{rng.choice(("#g", "#n", "file:///etc/passwd"))}"/>'
        f"{rng.choice(('', chr(60) + 'instance_node url=' + chr(34) + '#n' + chr(34) + '/>'))}</node></visual_scene>"
        f'</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    ).encode()


_SPOILERS: dict[str, Callable[[random.Random, bytes], bytes]] = {".stl": _stl, ".obj": _text, ".dae": _text}
_WRITERS: dict[str, Callable[[random.Random], bytes]] = {
    ".stl": _write_stl,
    ".obj": _write_obj,
    ".off": _write_off,
    ".ply": _write_ply,
    ".gltf": _write_gltf,
    ".glb": _write_glb,
    ".dae": _write_dae,
}
