"""SRDF files, which add to the robot of a URDF: reference postures, and the inertias of its motors' rotors."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfText, UrdfTree, number, read_xml


def reference_posture(name: str, tree: UrdfTree, text: UrdfText) -> Mapping[str, float]:
    """Return the positions, rad or m, of joints in the SRDF state, or the keyframe of an MJCF, called ``name``.

    SRDF files are searched in the URDF's folder and in the folder ``srdf`` next to it; one with the URDF's own name
    comes before others. A state counts where the URDF has most of its joints; those it does not have, and those that do
    not move, are left out. States of one name for several groups of joints add up.

    Raises
    ------
    InputError
        If there is no such state, or a position is not a number.
    """
    postures = reference_postures(tree, text)
    if name not in postures:
        write = {
            "urdf": "put an SRDF file of this robot beside its URDF",
            "mjcf": "write it as a <key> of a <keyframe>",
        }
        advice = f"known are {', '.join(postures)}" if postures else write[text.kind]
        raise InputError(f'no posture "{name}" is known', element="reference", advice=advice)
    return postures[name]


def reference_postures(tree: UrdfTree, text: UrdfText) -> Mapping[str, Mapping[str, float]]:
    """Return all reference postures by their names, see :func:`reference_posture`."""
    if text.kind == "mjcf":
        return text.keyframes
    postures: dict[str, dict[str, float]] = {}
    for path in _srdf_files(text.path):
        of_file: dict[str, dict[str, float]] = {}
        for name, positions in _states(path, tree):
            of_file.setdefault(name, {}).update(positions)
        for name, positions in of_file.items():
            postures.setdefault(name, positions)  # of an earlier file first
    return postures


def _states(path: Path, tree: UrdfTree) -> Iterator[tuple[str, dict[str, float]]]:
    """Names and positions of the states in one SRDF file, less those of other robots."""
    for state in _read_srdf(path).iterfind("group_state"):
        name = state.get("name", "")
        joints = {joint.get("name", ""): joint for joint in state.iterfind("joint")}
        if 2 * sum(joint in tree.joint for joint in joints) <= len(joints):
            continue  # of another robot
        positions = {}
        for joint, element in joints.items():
            is_single = len(element.get("value", "").split()) <= 1
            if joint in tree.joint and tree.joint[joint].moves and is_single:
                where = f'{path.name}: state "{name}": joint "{joint}"'
                positions[joint] = number(where, element, "value", None)
        yield name, positions


def with_rotors(tree: UrdfTree, urdf: Path) -> tuple[UrdfTree, Path | None]:
    """Return the robot with its rotors' inertias as ``<rotor_params>`` of an SRDF file has them, and that file.

    As its joint feels it, a rotor has its own inertia, which the attribute ``mass`` holds, times the gear's ratio
    squared: so Pinocchio reads these files. They are looked for as those of :func:`reference_posture`; one counts where
    the URDF has most of the joints that it names, and one that is wrong is left out with a warning. A joint to which
    the URDF gives an ``armature``, and one whose product is zero, stay as they are. The file is None where none counts.
    """
    for path in _srdf_files(urdf):
        try:
            felt = _rotor_inertias(tree, path)
        except InputError as error:
            warning = f"rotors of {path.name} are left out: {error.reason}"
            tree = replace(tree, warnings=(*tree.warnings, warning))
            continue
        if felt:
            joints = []
            for joint in tree.joints:
                has_none = joint.armature is None and joint.name in felt
                joints.append(replace(joint, armature=felt[joint.name]) if has_none else joint)
            return replace(tree, joints=tuple(joints)), path
    return tree, None


def _rotor_inertias(tree: UrdfTree, path: Path) -> dict[str, float]:
    """Inertias of rotors as their joints feel them, kg m^2, in one SRDF file; nothing in that of another robot."""
    named: list[Element] = []
    for rotors in _read_srdf(path).iterfind("rotor_params"):
        named += rotors.iterfind("joint")
    own: dict[str, Element] = {}
    for joint in named:
        if joint.get("name", "") in tree.joint:
            own[joint.get("name", "")] = joint
    felt: dict[str, float] = {}
    if 2 * len(own) <= len(named):
        return felt
    for name, joint in own.items():
        where = f'rotor_params: joint "{name}"'
        inertia = number(where, joint, "mass", None)
        gear = number(where, joint, "gear_ratio", None)
        armature = inertia * gear**2
        if not 0.0 <= armature <= 1e6:  # [kg m^2] the range of a problem file's
            raise InputError(f'joint "{name}" has {armature:g} kg m^2 by its mass and gear_ratio', element=where)
        if armature > 0.0 and tree.joint[name].moves:
            felt[name] = armature
    return felt


def _srdf_files(urdf: Path) -> list[Path]:
    """The SRDF files in the URDF's folder and in the folder ``srdf`` next to it, one with the URDF's name first."""
    paths = [*sorted(urdf.parent.glob("*.srdf")), *sorted((urdf.parent.parent / "srdf").glob("*.srdf"))]
    return sorted(paths, key=lambda path: path.stem != urdf.stem)


def _read_srdf(path: Path) -> Element:
    _, root = read_xml(path)
    if root.tag != "robot":
        raise InputError(f"is not an SRDF: its root element is <{root.tag}>, not <robot>", source=path)
    return root
