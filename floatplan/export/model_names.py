"""Names and order of joints and bodies: of a robot's own file, and of the model of a program that reads a motion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

import numpy as np

from floatplan.errors import InputError, naming
from floatplan.export.base_joints import BaseJoints
from floatplan.robot.mjcf.compiled import CompiledMjcf
from floatplan.robot.mjcf.tree import joint_names
from floatplan.robot.mjcf.urdf import compiled_file
from floatplan.robot.robot import Robot
from floatplan.robot.urdf.base import free_base
from floatplan.robot.urdf.check import read_tree
from floatplan.robot.urdf.tree import MOVING, read_xml


@dataclass(frozen=True, eq=False)
class MjcfModel:
    """An MJCF file that is to read a motion: its numbers of the robot's joints, by name, and the joints of its base."""

    path: Path
    compiled: CompiledMjcf
    joints: Mapping[str, int]
    base: BaseJoints


@dataclass(frozen=True)
class ModelNames:
    """Names of joints of one degree of freedom and of links, in a model's order; ``root`` is that of its free joint.

    ``mjcf`` is the model itself where it is an MJCF.
    """

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    root: str = "root"  # as in the models of LocoMuJoCo; a URDF names none
    mjcf: MjcfModel | None = None

    @property
    def floats_by_joints(self) -> bool:
        """Whether it is an MJCF whose base floats by other joints than a free one."""
        return self.mjcf is not None and bool(self.mjcf.base.numbers) and not self.mjcf.base.is_free

    def order_note(self, robot: Robot) -> str:
        """A sentence that tells whether joints and bodies are in another order here than in a robot's own file."""
        own = own_names(robot)
        different = []
        if list(self.joints) != [name for name in own.joints if name in self.joints]:
            different.append("joints")
        if list(self.bodies) != [name for name in own.bodies if name in self.bodies]:
            different.append("bodies")
        if not different:
            return "its joints and bodies are in the same order as in the robot's file"
        kinds = " and ".join(different)
        return f"its {kinds} are in another order than in the robot's file; what is written has its order"


def own_names(robot: Robot, *, by_limbs: bool = False) -> ModelNames:
    """Return the joints that move and the links of a robot's file, in its order, or else limb by limb.

    The latter is MuJoCo's order: after each link all that hang on it, of several joints of it the file's first first.
    """
    return _in_urdf(fromstring(robot.xml), by_limbs)


def own_mjcf(robot: Robot) -> ModelNames:
    """Return the names in the MJCF that a robot was read from; errors as of :func:`matched`."""
    with naming(robot.path):
        return _in_mjcf(robot.path, compiled_file(robot.path, robot.balance_inertias))


def matched(own: ModelNames, path: str | Path, *, with_bodies: bool, by_limbs: bool = False) -> ModelNames:
    """Return the names in a model, URDF or MJCF, that is to read a motion of the robot with the names ``own``.

    In an MJCF the robot is the tree with most joints, without those of its base, which floats here. Of a URDF the
    joints by which its base floats do not count, where the motion has none of them. Links of ``own`` that a model has
    fused are left out. Names of a URDF are in its order, or limb by limb as of :func:`own_names`.

    Raises
    ------
    InputError
        The file cannot be read, or MuJoCo is not installed; one of both has a joint that the other has not; or, where
        bodies matter, it has a body that the robot has not.
    """
    _, root = read_xml(Path(path))
    if root.tag not in ("robot", "mujoco"):
        raise InputError(f"is neither a URDF nor an MJCF: its root element is <{root.tag}>", source=path)
    with naming(path):
        names = _in_urdf(root, by_limbs) if root.tag == "robot" else _in_mjcf(Path(path), compiled_file(Path(path)))
    if root.tag == "robot" and set(names.joints) - set(own.joints):
        with naming(path):
            base = {joint.name for joint in free_base(read_tree(root))} - set(own.joints)
        names = replace(names, joints=tuple(name for name in names.joints if name not in base))
    if not with_bodies:
        names = replace(names, bodies=tuple(name for name in names.bodies if name in own.bodies))
    pairs = (
        ("the motion has no joint", names.joints, own.joints),
        ("the model has no joint", own.joints, names.joints),
        ("the motion has no body", names.bodies, own.bodies),
    )
    wrong = []
    for reason, required, present in pairs:
        missing = [name for name in required if name not in present]
        if len(missing) > 8:  # a message of more is no help
            missing[8:] = [".."]
        if missing:
            wrong.append(f"{reason} {', '.join(missing)}")
    if wrong:
        raise InputError("; ".join(wrong), source=path, advice="give the model of the same robot, or rename them in it")
    return names


def _in_urdf(root: Element, by_limbs: bool) -> ModelNames:
    joints = list(root.iterfind("joint"))
    links = list(root.iterfind("link"))
    if by_limbs:
        joints, links = _by_limbs(joints, links)
    return ModelNames(
        joints=tuple(joint.get("name", "") for joint in joints if joint.get("type") in MOVING),
        bodies=tuple(link.get("name", "") for link in links if link.get("type") != "frame"),  # which is no body
    )


def _by_limbs(joints: list[Element], links: list[Element]) -> tuple[list[Element], list[Element]]:
    """Elements of joints and links, limb by limb."""

    def end(joint: Element, tag: str) -> str:
        element = joint.find(tag)
        return "" if element is None else element.get("link", "")

    link_of = {link.get("name", ""): link for link in links}
    children = {end(joint, "child") for joint in joints}
    ordered_joints: list[Element] = []
    ordered_links: list[Element] = []
    stack: list[Element] = []

    def visit(name: str) -> None:
        ordered_links.append(link_of[name])
        stack.extend(joint for joint in reversed(joints) if end(joint, "parent") == name)

    for root in link_of.keys() - children:
        visit(root)
    while stack:
        joint = stack.pop()
        ordered_joints.append(joint)
        visit(end(joint, "child"))
    return ordered_joints, ordered_links


def _in_mjcf(path: Path, model: CompiledMjcf) -> ModelNames:
    roots = model.body_rootid[model.jnt_bodyid]  # of each joint
    base = np.bincount(roots, minlength=1).argmax()  # it carries most joints
    bodies = [model.names["body"][body] for body in np.flatnonzero(model.body_rootid == base)]
    of_base = roots == base
    moving = np.flatnonzero(of_base & (model.jnt_bodyid != base))
    free = np.flatnonzero(of_base & (model.jnt_type == model.constants["mjJNT_FREE"]))
    names = joint_names(model)
    joints = {names[joint]: joint for joint in moving.tolist()}
    carrying = np.flatnonzero(of_base & (model.jnt_bodyid == base)).tolist()
    return ModelNames(
        joints=tuple(joints),
        bodies=tuple(name for name in bodies if name),
        root=model.names["joint"][free[0]] if len(free) else "",
        mjcf=MjcfModel(path, model, joints, BaseJoints(model, carrying, int(base))),
    )
