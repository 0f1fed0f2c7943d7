"""SRDF files, which say more about the robot of a URDF: reference postures, and the inertias of its motors' rotors."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfText, UrdfTree, number, read_xml

LARGEST_ARMATURE = 1e6  # [kg m^2] as of a problem file's


def reference_posture(name: str, tree: UrdfTree, text: UrdfText) -> Mapping[str, float]:
    """Return positions, rad or m, of the joints that the SRDF state, or the keyframe of an MJCF, called ``name`` gives.

    SRDF files are searched in the URDF's folder and in the folder ``srdf`` beside it; one with the URDF's own name
    comes before others. A state counts where the URDF has most of its joints; those it does not have, and those that do
    not move, are left out. States of one name for several groups of joints add up.

    Raises
    ------
    InputError
        If no such state is found, or a position is not a number.
    """
    known = reference_postures(tree, text)
    if name not in known:
        write = {
            "urdf": "put an SRDF file of this robot beside its URDF",
            "mjcf": "write it as a <key> of a <keyframe>",
        }
        advice = f"known are {', '.join(known)}" if known else write[text.kind]
        raise InputError(f'no posture "{name}" is known', element="reference", advice=advice)
    return known[name]


def reference_postures(tree: UrdfTree, text: UrdfText) -> Mapping[str, Mapping[str, float]]:
    """Return all reference postures by their names, see :func:`reference_posture`."""
    if text.kind == "mjcf":
        return text.keyframes
    known: dict[str, dict[str, float]] = {}
    for path in _srdf_files(text.path):
        of_file: dict[str, dict[str, float]] = {}
        for name, positions in _states(path, tree):
            of_file.setdefault(name, {}).update(positions)
        known |= {name: positions for name, positions in of_file.items() if name not in known}
    return known


def _states(path: Path, tree: UrdfTree) -> Iterator[tuple[str, dict[str, float]]]:
    """Names and positions of the states in one SRDF file, less those of other robots."""
    for state in _read_srdf(path).iterfind("group_state"):
        name = state.get("name", "")
        joints = {joint.get("name", ""): joint for joint in state.iterfind("joint")}
        moving = {
            joint: element
            for joint, element in joints.items()
            if joint in tree.joint and tree.joint[joint].moves and len(element.get("value", "").split()) <= 1
        }
        if 2 * sum(joint in tree.joint for joint in joints) > len(joints):
            place = f'{path.name}: state "{name}": joint'
            yield name, {joint: number(f'{place} "{joint}"', each, "value", None) for joint, each in moving.items()}


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
        joints = tuple(
            replace(joint, armature=felt[joint.name]) if joint.armature is None and joint.name in felt else joint
            for joint in tree.joints
        )
        if felt:
            return replace(tree, joints=joints), path
    return tree, None


def _rotor_inertias(tree: UrdfTree, path: Path) -> dict[str, float]:
    """Inertias of rotors as their joints feel them, kg m^2, in one SRDF file; nothing in that of another robot."""
    named = [joint for rotors in _read_srdf(path).iterfind("rotor_params") for joint in rotors.iterfind("joint")]
    known = {joint.get("name", ""): joint for joint in named if joint.get("name", "") in tree.joint}
    felt: dict[str, float] = {}
    if 2 * len(known) <= len(named):
        return felt
    for name, joint in known.items():
        place = f'rotor_params: joint "{name}"'
        inertia, gear = (number(place, joint, key, None) for key in ("mass", "gear_ratio"))
        armature = inertia * gear**2
        if not 0.0 <= armature <= LARGEST_ARMATURE:
            raise InputError(f'joint "{name}" has {armature:g} kg m^2 by its mass and gear_ratio', element=place)
        if armature > 0.0 and tree.joint[name].moves:
            felt[name] = armature
    return felt


def _srdf_files(urdf: Path) -> list[Path]:
    """The SRDF files in the URDF's folder and in the folder ``srdf`` beside it, one with the URDF's name first."""
    folders = (urdf.parent, urdf.parent.parent / "srdf")
    paths = [path for folder in folders for path in sorted(folder.glob("*.srdf"))]
    return sorted(paths, key=lambda path: path.stem != urdf.stem)


def _read_srdf(path: Path) -> Element:
    _, root = read_xml(path)
    if root.tag != "robot":
        raise InputError(f"is not an SRDF: its root element is <{root.tag}>, not <robot>", source=path)
    return root
