"""An MJCF as the URDF that the other rooms read, of the same links, joints, masses, shapes and motors.

Every body is a link with its own frame, every joint keeps its name and the zero of its position. A joint whose anchor
is not the body's origin, or that is not the last of its body, moves a link that is nothing but a frame.
"""

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, fromstring
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from floatplan.arguments import without
from floatplan.robot.mjcf.compiled import CompiledMjcf, compiled_mjcf
from floatplan.robot.mjcf.motors import joint_motors
from floatplan.robot.mjcf.text import MjcfText, whole_mjcf
from floatplan.robot.mjcf.tree import MjcfTree, new_name
from floatplan.robot.urdf.inertias import balanced_warning
from floatplan.robot.urdf.tree import UrdfText, read_xml


@np.errstate(all="ignore")  # numbers may be huge, and are checked as those of any URDF
def read_mjcf(path: Path, content: bytes, root: Element, balance_inertias: bool = False) -> UrdfText:
    """Return the URDF of an MJCF file, from its content and root element.

    With ``balance_inertias`` MuJoCo's compiler balances them, whatever the file says.

    Raises
    ------
    InputError
        As of :func:`~floatplan.robot.mjcf.text.whole_mjcf`, :func:`~floatplan.robot.mjcf.compiled.compiled_mjcf` and
        :class:`~floatplan.robot.mjcf.tree.MjcfTree`.
    """
    name = (root.get("model") or "").strip() or path.stem
    text = whole_mjcf(root, path)
    model, balanced = _compiled(text, balance_inertias)
    tree = MjcfTree(model)
    motors, of_motors = joint_motors(tree)
    meshes = {}
    for number, mesh in enumerate(model.names["mesh"]):
        meshes[number] = text.meshes[mesh]
    elements = [*_links(tree, meshes), *_joints(tree, motors)]
    xml = f"<robot {_written(name=name)}>{''.join(elements)}</robot>"
    entries = {tree.joint_names[joint]: int(model.jnt_qposadr[joint]) for joint in tree.moving}
    keyframes = {}
    for key, q in zip(model.names["key"], model.key_qpos, strict=True):
        if key:
            keyframes[key] = {joint: float(q[entry]) for joint, entry in entries.items()}
    return UrdfText(
        path=path,
        xml=xml,
        sha256=hashlib.sha256(content).hexdigest(),
        root=fromstring(xml),
        kind="mjcf",
        files={name: hashlib.sha256(content_of_file).hexdigest() for name, content_of_file in text.files.items()},
        keyframes=keyframes,
        warnings=(*tree.warnings, *of_motors, *balanced),
        gravity_direction=tree.gravity_direction,
    )


def compiled_file(robot_file: Path, balance_inertias: bool = False) -> CompiledMjcf:
    """Return an MJCF file as MuJoCo compiles it; errors as of :func:`read_mjcf`, but of checks of the robot."""
    _, root = read_xml(robot_file)
    return _compiled(whole_mjcf(root, robot_file), balance_inertias)[0]


def _compiled(text: MjcfText, balance_inertias: bool) -> tuple[CompiledMjcf, list[str]]:
    balanced = _with_balanced_inertias(text.root) if balance_inertias else []
    return compiled_mjcf(text), balanced


def _with_balanced_inertias(root: Element) -> list[str]:
    """Have the compiler balance inertias; return the warning about the bodies whose written ones it will change."""
    SubElement(root, "compiler", balanceinertia="true")
    names = [body.get("name") or "one without a name" for body in root.iter("body") if _unbalanced(body)]
    return [balanced_warning(names)] if names else []


def _unbalanced(body: Element) -> bool:
    """Whether the inertia that is written for a body has a moment above the sum of the others."""
    inertial = body.find("inertial")
    if inertial is None:
        return False
    try:
        full = list(map(float, inertial.get("fullinertia", "").split()))
        if len(full) == 6:
            xx, yy, zz, xy, xz, yz = full
            moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            moments = np.array(list(map(float, inertial.get("diaginertia", "").split())))
    except (ValueError, np.linalg.LinAlgError):  # which MuJoCo refuses
        return False
    return bool(2.0 * moments.max(initial=0.0) > moments.sum())


def _written(**values: Any) -> str:
    """Attributes: texts, numbers with all digits, or several of these."""
    attributes = []
    for key, value in values.items():
        written = value if isinstance(value, str) else " ".join(map(repr, np.atleast_1d(value).astype(float).tolist()))
        attributes.append(f"{key}={quoteattr(written)}")
    return " ".join(attributes)


def _origin(placement: Any) -> str:
    return f"<origin {_written(xyz=placement.translation, rpy=pin.rpy.matrixToRpy(placement.rotation))}/>"


def _placement(position: Any, quaternion: Any = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """``pinocchio.SE3`` of a position and a quaternion w x y z."""
    return pin.SE3(pin.Quaternion(*quaternion).normalized().matrix(), np.array(position))


def _links(tree: MjcfTree, meshes: Mapping[int, str]) -> Iterator[str]:
    """The bodies: mass, and the geometry that can touch something, or all of it where none can."""
    model = tree.model
    touching = (model.geom_contype | model.geom_conaffinity).astype(bool)
    touching[[*model.pair_geom1, *model.pair_geom2]] = True
    of_robot = np.isin(model.geom_bodyid, tree.bodies)
    shapes = touching & of_robot if (touching & of_robot).any() else of_robot
    for body in tree.bodies:
        inertial = ""
        if model.body_mass[body] > 0.0:
            xx, yy, zz = model.body_inertia[body]
            moments = _written(ixx=xx, iyy=yy, izz=zz, ixy=0.0, ixz=0.0, iyz=0.0)
            origin = _origin(_placement(model.body_ipos[body], model.body_iquat[body]))
            mass = _written(value=model.body_mass[body])
            inertial = f"<inertial>{origin}<mass {mass}/><inertia {moments}/></inertial>"
        geoms = np.flatnonzero(shapes & (model.geom_bodyid == body)).tolist()
        collisions = "".join(_collision(model, geom, meshes) for geom in geoms)
        yield f"<link {_written(name=tree.body_names[body])}>{inertial}{collisions}</link>"


def _collision(model: CompiledMjcf, geom: int, meshes: Mapping[int, str]) -> str:
    kinds = model.constants
    kind = int(model.geom_type[geom])
    size = model.geom_size[geom]
    placement = _placement(model.geom_pos[geom], model.geom_quat[geom])
    mesh = int(model.geom_dataid[geom])
    if kind == kinds["mjGEOM_MESH"]:
        shape = f"mesh {_written(filename=meshes[mesh], scale=model.mesh_scale[mesh])}"
        placement = (
            placement * _placement(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()
        )  # from its placement in MuJoCo
    else:
        shape = {
            kinds["mjGEOM_SPHERE"]: f"sphere {_written(radius=size[0])}",
            kinds["mjGEOM_CAPSULE"]: f"capsule {_written(radius=size[0], length=2 * size[1])}",
            kinds["mjGEOM_CYLINDER"]: f"cylinder {_written(radius=size[0], length=2 * size[1])}",
            kinds["mjGEOM_BOX"]: f"box {_written(size=2 * size)}",
            kinds["mjGEOM_ELLIPSOID"]: f"ellipsoid {_written(radii=size)}",
        }.get(kind, model.constant(kind, "mjGEOM_"))
    return f"<collision>{_origin(placement)}<geometry><{shape}/></geometry></collision>"


def _joints(tree: MjcfTree, motors: Mapping[int, Mapping[str, float]]) -> Iterator[str]:
    """The joints that carry each body, one after the other, and a fixed one to the body's own frame where necessary."""
    model = tree.model
    links = set(tree.body_names.values())
    for body in tree.bodies[1:]:
        own = tree.body_names[body]
        carrier = tree.body_names[int(model.body_parentid[body])]
        placement = _placement(model.body_pos[body], model.body_quat[body])
        for joint in tree.joints[body]:
            slides = tree.slides(joint)
            axis = model.jnt_axis[joint]
            anchor = np.zeros(3) if slides else model.jnt_pos[joint]
            back = -model.qpos0[model.jnt_qposadr[joint]]
            rotation = np.eye(3) if slides else pin.AngleAxis(back, axis).matrix()
            placement = placement * _placement(anchor) * pin.SE3(rotation, back * axis if slides else np.zeros(3))
            child = own
            if anchor.any() or joint != tree.joints[body][-1]:
                child = new_name(f"{own}/{tree.joint_names[joint]}", links)
                yield f"<link {_written(name=child, type='frame')}/>"
            limited = bool(model.jnt_limited[joint])
            motor = motors[joint]
            kind = "prismatic" if slides else "revolute" if limited else "continuous"
            lower, upper = model.jnt_range[joint] if limited else (0.0, 0.0)  # zeros are no limits
            limit = _written(lower=lower, upper=upper, effort=motor["effort"], velocity=0.0)
            losses = without(motor, [key for key, value in motor.items() if key == "effort" or not value])
            content = f"<axis {_written(xyz=axis)}/><limit {limit}/><dynamics {_written(**losses)}/>"
            yield _joint(tree.joint_names[joint], kind, (carrier, child), placement, content)
            carrier = child
            placement = _placement(-anchor)
        if carrier != own:
            name = new_name(f"{own}/", set(tree.joint_names.values()))
            yield _joint(name, "fixed", (carrier, own), placement)


def _joint(name: str, kind: str, links: tuple[str, str], placement: Any, content: str = "") -> str:
    parent = _written(link=links[0])
    child = _written(link=links[1])
    ends = f"{_origin(placement)}<parent {parent}/><child {child}/>"
    return f"<joint {_written(name=name, type=kind)}>{ends}{content}</joint>"
