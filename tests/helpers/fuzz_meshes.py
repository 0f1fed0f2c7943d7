"""Robots of the gallery with their meshes beside them, some of it spoiled: URDF, SRDF and mesh files."""

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
    if action < 0.4:
        return _SPOILERS.get(kind, spoiled_bytes)(rng, content), kind
    if action < 0.7:
        return spoiled_bytes(rng, content), kind
    if action < 0.85:
        return rng.choice(_archives()), rng.choice((kind, ".zip", ".3mf", ".glb", ".obj"))
    return content, rng.choice((".stl", ".obj", ".dae", ".ply", ".off", ".glb", ".gltf", ".STL", ".xyz", ""))


@cache
def _archives() -> tuple[bytes, ...]:
    """Small files that become large ones."""
    zeros = bytes(MEGABYTES_OF_ARCHIVES * 10**6)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mesh.stl", zeros)
    return stream.getvalue(), gzip.compress(zeros)


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


_SPOILERS: dict[str, Callable[[random.Random, bytes], bytes]] = {".stl": _stl, ".obj": _text, ".dae": _text}
