"""Names and order of joints and bodies: of a robot's own file, and of the model of a program that reads a motion."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, fromstring

from floatplan.errors import InputError
from floatplan.files import LARGEST_URDF, parsed_xml, read_regular
from floatplan.robot.mjcf.compiled import import_mujoco
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.tree import MOVING

MOST_NAMED = 8  # in a message


@dataclass(frozen=True)
class ModelNames:
    """Names of joints of one degree of freedom and of links, in a model's order; ``root`` is that of its free joint."""

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    root: str = "root"  # as the models of LocoMuJoCo have it; a URDF names none

    def order_beside(self, robot: Robot) -> str:
        """Say whether joints and bodies are in another order here than in a robot's own file."""
        own = own_names(robot)
        pairs = (("joints", self.joints, own.joints), ("bodies", self.bodies, own.bodies))
        moved = [kind for kind, here, there in pairs if list(here) != [name for name in there if name in here]]
        said = (
            f"{' and '.join(moved)} are in another order than"
            if moved
            else "joints and bodies are in the same order as"
        )
        return f"its {said} in the robot's file" + ("; what is written has its order" if moved else "")


def own_names(robot: Robot) -> ModelNames:
    """Return the joints that move and the links of a robot's file, in its order."""
    return _in_urdf(fromstring(robot.xml))


def matched(own: ModelNames, path: str | Path, *, with_bodies: bool) -> ModelNames:
    """Return the names in a model, URDF or MJCF, that is to read a motion of the robot with the names ``own``.

    In an MJCF the robot is what hangs together by most joints. Links of ``own`` that a model has fused are left out.

    Raises
    ------
    InputError
        The file cannot be read, or MuJoCo is not installed; one of both has a joint that the other has not; or, where
        bodies matter, it has a body that the robot has not.
    """
    root = parsed_xml(read_regular(path, LARGEST_URDF, "a URDF or MJCF file"), Path(path))
    if root.tag not in ("robot", "mujoco"):
        raise InputError(f"is neither a URDF nor an MJCF: its root element is <{root.tag}>", source=path)
    names = _in_urdf(root) if root.tag == "robot" else _in_mjcf(path)
    if not with_bodies:
        names = replace(names, bodies=tuple(name for name in names.bodies if name in own.bodies))
    lacking = (
        ("the motion has no joint", [name for name in names.joints if name not in own.joints]),
        ("the model has no joint", [name for name in own.joints if name not in names.joints]),
        ("the motion has no body", [name for name in names.bodies if name not in own.bodies]),
        (
            "the model names twice",
            [name for kind in (names.joints, names.bodies) for name in kind if kind.count(name) > 1],
        ),
    )
    wrong = [
        f"{what} {', '.join(each[:MOST_NAMED])}{', ..' * (len(each) > MOST_NAMED)}" for what, each in lacking if each
    ]
    if wrong:
        raise InputError("; ".join(wrong), source=path, advice="give the model of the same robot, or rename them in it")
    return names


def _in_urdf(root: Element) -> ModelNames:
    joints = (joint.get("name", "") for joint in root.iterfind("joint") if joint.get("type") in MOVING)
    return ModelNames(tuple(joints), tuple(link.get("name", "") for link in root.iterfind("link")))


def _in_mjcf(path: str | Path) -> ModelNames:
    """What MuJoCo reads; nothing is compiled, so that meshes need not be there."""
    mujoco = import_mujoco("model")
    try:
        top = mujoco.MjSpec.from_file(str(path)).worldbody.bodies
    except ValueError as error:
        raise InputError(f"MuJoCo refuses it: {error}", source=path) from None
    free, trees = mujoco.mjtJoint.mjJNT_FREE, [list(_from(base)) for base in top]
    tree = max(trees, key=lambda tree: sum(len(body.joints) for body in tree), default=[])
    joints = [(joint.name, joint.type == free) for body in tree for joint in body.joints]
    floats = [name for name, is_free in joints if is_free]
    of_joints = tuple(name for name, is_free in joints if not is_free)
    return ModelNames(of_joints, tuple(body.name for body in tree if body.name), floats[0] if floats else "")


def _from(body: Any) -> Iterator[Any]:
    """A body and all that it carries, in the order of MuJoCo's numbers."""
    yield body
    for each in body.bodies:
        yield from _from(each)
