"""Names and order of joints and bodies: of a robot's own file, and of the model of a program that reads a motion."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, fromstring

from floatplan.errors import InputError, naming
from floatplan.files import LARGEST_URDF, parsed_xml, read_regular
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.tree import MOVING
from floatplan.simulation.mujoco_model import import_mujoco

MOST_NAMED = 8  # in a message


@dataclass(frozen=True)
class ModelNames:
    """What a model has, in its order.

    Attributes
    ----------
    joints : names of the joints of one degree of freedom
    bodies : names of the links
    root : name of the joint by which it floats; None where the file has none, "" where it has no name
    path : the file
    """

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    root: str | None = None
    path: Path | None = None

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
        return f"its {said} in the robot's file" + ("; what was written has its order" if moved else "")


def own_names(robot: Robot) -> ModelNames:
    """Return the joints that move and the links of a robot's file, in its order."""
    return _in_urdf(fromstring(robot.xml))


def matched(own: ModelNames, path: str | Path, *, with_bodies: bool) -> ModelNames:
    """Return the names in a model, URDF or MJCF, that is to read a motion of the robot with the names ``own``.

    Of an MJCF the tree of most joints is the robot. Links of the robot that the model has not, such as those that it
    fused with others, are left out.

    Raises
    ------
    InputError
        The file cannot be read, or MuJoCo is not installed; one of both has a joint that the other has not; or, where
        bodies matter, it has a body that the robot has not.
    """
    path = Path(path)
    root = parsed_xml(read_regular(path, LARGEST_URDF, "a URDF or MJCF file"), path)
    if root.tag not in ("robot", "mujoco"):
        raise InputError(f"is neither a URDF nor an MJCF: its root element is <{root.tag}>", source=path)
    names = replace(_in_urdf(root) if root.tag == "robot" else _in_mjcf(path), path=path)
    if not with_bodies:
        names = replace(names, bodies=tuple(name for name in names.bodies if name in own.bodies))
    pairs = (
        ("the motion has no joint", names.joints, own.joints),
        ("the model has no joint", own.joints, names.joints),
        ("the motion has no body", names.bodies, own.bodies),
    )
    lacking = [(what, [f'"{name}"' for name in wanted if name not in there]) for what, wanted, there in pairs]
    wrong = [
        f"{what} {', '.join(each[:MOST_NAMED])}{' ..' * (len(each) > MOST_NAMED)}" for what, each in lacking if each
    ]
    if wrong or len(names.joints) != len(own.joints) or len(set(names.bodies)) != len(names.bodies):
        advice = "give the model of the same robot, or rename them in it"
        raise InputError("; ".join(wrong) or "names one twice", source=path, element="model", advice=advice)
    return names


def _in_urdf(root: Element) -> ModelNames:
    joints = root.findall("joint")
    floats = [joint for joint in joints if joint.get("type") == "floating"]
    outside = {parent.get("link") for joint in floats for parent in joint.iterfind("parent")}
    links = [link.get("name", "") for link in root.iterfind("link")]
    return ModelNames(
        tuple(joint.get("name", "") for joint in joints if joint.get("type") in MOVING),
        tuple(name for name in links if name not in outside),
        floats[0].get("name", "") if floats else None,
    )


def _in_mjcf(path: Path) -> ModelNames:
    """What MuJoCo reads; nothing is compiled, so that meshes need not be there."""
    mujoco = import_mujoco("model")
    with naming(path):
        try:
            top = mujoco.MjSpec.from_file(str(path)).worldbody.bodies
        except ValueError as error:
            raise InputError(f"MuJoCo refuses it: {error}", element="model") from None
    free, trees = mujoco.mjtJoint.mjJNT_FREE, [list(_from(base)) for base in top]
    tree = max(trees, key=lambda tree: sum(len(body.joints) for body in tree), default=[])
    floats, joints = (
        [j.name for body in tree for j in body.joints if (j.type == free) is is_free] for is_free in (True, False)
    )
    return ModelNames(tuple(joints), tuple(body.name for body in tree if body.name), floats[0] if floats else None)


def _from(body: Any) -> Iterator[Any]:
    """A body and all that it carries, in the order of MuJoCo's numbers."""
    yield body
    for each in body.bodies:
        yield from _from(each)
