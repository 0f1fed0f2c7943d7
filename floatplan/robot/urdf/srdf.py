"""Reference postures: the ``<group_state>`` elements of SRDF files that lie beside a URDF."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from floatplan.errors import InputError
from floatplan.robot.urdf.read import read_urdf
from floatplan.robot.urdf.tree import UrdfTree
from floatplan.robot.urdf.values import number


def reference_posture(name: str, tree: UrdfTree, urdf: Path) -> dict[str, float]:
    """Return positions, rad or m, of the joints that the SRDF state called ``name`` gives.

    SRDF files are searched in the URDF's folder and in the folder ``srdf`` beside it; one with the URDF's own name
    comes before others. A state counts where the URDF has most of its joints; those it does not have, and those that do
    not move, are left out. States of one name for several groups of joints add up.

    Raises
    ------
    InputError
        If no such state is found, or a position is not a number.
    """
    known = reference_postures(tree, urdf)
    if name not in known:
        advice = f"known are {', '.join(known)}" if known else "put an SRDF file of this robot beside its URDF"
        raise InputError(f'no posture "{name}" is known', element="reference", advice=advice)
    return known[name]


def reference_postures(tree: UrdfTree, urdf: Path) -> dict[str, dict[str, float]]:
    """Return all reference postures by their names, see :func:`reference_posture`."""
    known: dict[str, dict[str, float]] = {}
    for path in _files(urdf):
        for state, positions in _states(path, tree).items():
            known.setdefault(state, positions)
    return known


def _files(urdf: Path) -> Iterator[Path]:
    """SRDF files beside the URDF, the one of the same name first."""
    found = [path for folder in (urdf.parent, urdf.parent.parent / "srdf") for path in sorted(folder.glob("*.srdf"))]
    yield from sorted(found, key=lambda path: path.stem != urdf.stem)


def _states(path: Path, tree: UrdfTree) -> dict[str, dict[str, float]]:
    """Positions by state and joint of one SRDF file, less the states of other robots."""
    states: dict[str, dict[str, float]] = {}
    for state in read_urdf(path).root.iterfind("group_state"):
        name = state.get("name", "")
        entries = {entry.get("name", ""): entry for entry in state.iterfind("joint")}
        known = {joint: entry for joint, entry in entries.items() if joint in tree.joint}
        if 2 * len(known) <= len(entries):
            continue
        positions = states.setdefault(name, {})
        for joint, entry in known.items():
            if tree.joint[joint].moves and len(entry.get("value", "").split()) <= 1:
                positions[joint] = number(f'{path.name}: state "{name}": joint "{joint}"', entry, "value", None)
    return states
