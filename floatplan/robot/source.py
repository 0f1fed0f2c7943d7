"""A robot's file: a URDF, or an MJCF as a URDF; which of them it is tells its root element."""

from pathlib import Path

from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfText, read_xml, urdf_text
from floatplan.tables import RobotKind

ROOTS: dict[str, RobotKind] = {"robot": "urdf", "mujoco": "mjcf"}


def read_source(path: Path, kind: RobotKind | None = None, balance_inertias: bool = False) -> UrdfText:
    """Read a robot's file, of one kind or of either; in an MJCF, have MuJoCo balance inertias where that is asked for.

    Raises
    ------
    InputError
        It is of another kind; or as of :func:`~floatplan.robot.urdf.tree.read_urdf` and
        :func:`~floatplan.robot.mjcf.urdf.read_mjcf`.
    """
    content, root = read_xml(path)
    found = ROOTS.get(root.tag)
    if found is None or kind not in (None, found):
        wanted = {"urdf": "a URDF", "mjcf": "an MJCF", None: "a URDF or an MJCF"}[kind]
        advice = None if found is None else f"read it as one: [robot] {found} = .., or Robot.from_{found}"
        raise InputError(f"is not {wanted}: its root element is <{root.tag}>", source=path, advice=advice)
    if found == "urdf":
        return urdf_text(path, content, root)
    from floatplan.robot.mjcf.urdf import read_mjcf  # with MuJoCo, which no URDF needs

    return read_mjcf(path, content, root, balance_inertias)
