"""A robot's file: a URDF, or an MJCF as a URDF; its root element says which."""

from pathlib import Path

from floatplan.errors import InputError
from floatplan.robot.urdf.tree import UrdfText, read_xml, urdf_text
from floatplan.tables import RobotKind


def read_source(path: Path, kind: RobotKind | None = None, balance_inertias: bool = False) -> UrdfText:
    """Read a robot's file, of one kind or of either; in an MJCF, balance inertias where the option says so.

    Raises
    ------
    InputError
        It is of another kind; or as of :func:`~floatplan.robot.urdf.tree.read_urdf` and
        :func:`~floatplan.robot.mjcf.urdf.read_mjcf`.
    """
    content, root = read_xml(path)
    kinds: dict[str, RobotKind] = {"robot": "urdf", "mujoco": "mjcf"}
    file_kind = kinds.get(root.tag)
    if file_kind is None or kind not in (None, file_kind):
        required = {"urdf": "a URDF", "mjcf": "an MJCF", None: "a URDF or an MJCF"}[kind]
        advice = None if file_kind is None else f"read it as one: [robot] {file_kind} = .., or Robot.from_{file_kind}"
        raise InputError(f"is not {required}: its root element is <{root.tag}>", source=path, advice=advice)
    if file_kind == "urdf":
        return urdf_text(path, content, root)
    from floatplan.robot.mjcf.urdf import read_mjcf  # with MuJoCo, which no URDF needs

    return read_mjcf(path, content, root, balance_inertias)
