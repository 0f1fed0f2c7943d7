"""An MJCF as the URDF that the rest of the house knows, of the same links, joints, masses, shapes and motors.

Every body is a link with its own frame, every joint keeps its name and the zero of its position. A joint whose anchor
is not the body's origin, or that is not the last of its body, moves a link that is a frame alone.
"""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.robot.mjcf.compiled import compiled_mjcf, import_mujoco
from floatplan.robot.mjcf.motors import JointMotor, joint_motors
from floatplan.robot.mjcf.text import whole_mjcf
from floatplan.robot.mjcf.tree import MjcfTree, new_name
from floatplan.robot.urdf.tree import UrdfText


def read_mjcf(path: Path, content: bytes, root: Element) -> UrdfText:
    """Return the URDF of an MJCF file, from its content and root element.

    Raises
    ------
    InputError
        As of :func:`~floatplan.robot.mjcf.text.whole_mjcf`, :func:`~floatplan.robot.mjcf.compiled.compiled_mjcf` and
        :class:`~floatplan.robot.mjcf.tree.MjcfTree`.
    """
    name = (root.get("model") or "").strip() or path.stem
    text = whole_mjcf(root, path)
    model = compiled_mjcf(text)
    tree = MjcfTree(model)
    motors, of_motors = joint_motors(tree)
    urdf = Element("robot", name=name)
    touching = (model.geom_contype | model.geom_conaffinity).astype(bool)
    touching[[*model.pair_geom1, *model.pair_geom2]] = True
    of_robot = np.isin(model.geom_bodyid, tree.bodies)
    shapes = touching & of_robot if (touching & of_robot).any() else of_robot
    meshes = {number: text.meshes[model.mesh(number).name] for number in range(model.nmesh)}
    links = set(tree.body_names.values())
    for body in tree.bodies:
        link = _link(urdf, tree, body)
        for geom in np.flatnonzero(shapes & (model.geom_bodyid == body)).tolist():
            _add_collision(link, model, geom, meshes)
        if body != tree.bodies[0]:
            _add_joints(urdf, tree, body, motors, links)
    keys = {model.key(number).name: model.key_qpos[number] for number in range(model.nkey)}
    entries = {tree.joint_names[joint]: int(model.jnt_qposadr[joint]) for joint in tree.moving}
    return UrdfText(
        path=path,
        xml=tostring(urdf, encoding="unicode"),
        sha256=hashlib.sha256(content).hexdigest(),
        root=urdf,
        kind="mjcf",
        files={name: hashlib.sha256(each).hexdigest() for name, each in text.files.items()},
        keyframes={key: {name: float(q[entry]) for name, entry in entries.items()} for key, q in keys.items() if key},
        warnings=(*tree.warnings, *of_motors),
    )


def _add(parent: Element, tag: str, **values: Any) -> Element:
    """Add an element with attributes that are texts, numbers with all digits, or several of these."""
    written = {
        key: value if isinstance(value, str) else " ".join(repr(float(each)) for each in np.atleast_1d(value))
        for key, value in values.items()
    }
    return SubElement(parent, tag, written)


def _add_origin(element: Element, place: Any) -> None:
    _add(element, "origin", xyz=place.translation, rpy=pin.rpy.matrixToRpy(place.rotation))


def _place(position: Array, quaternion: Sequence[float] = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """``pinocchio.SE3`` of a place and a quaternion w x y z."""
    return pin.SE3(pin.Quaternion(*quaternion).normalized().matrix(), np.array(position))


def _link(urdf: Element, tree: MjcfTree, body: int) -> Element:
    """A body as a link with its mass."""
    model, link = tree.model, _add(urdf, "link", name=tree.body_names[body])
    if model.body_mass[body] > 0.0:
        inertial = _add(link, "inertial")
        _add_origin(inertial, _place(model.body_ipos[body], model.body_iquat[body]))
        _add(inertial, "mass", value=model.body_mass[body])
        xx, yy, zz = model.body_inertia[body]
        _add(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy=0.0, ixz=0.0, iyz=0.0)
    return link


def _add_collision(link: Element, model: Any, geom: int, meshes: Mapping[int, str]) -> None:
    kinds, kind, size = import_mujoco().mjtGeom, int(model.geom_type[geom]), model.geom_size[geom]
    place, mesh = _place(model.geom_pos[geom], model.geom_quat[geom]), int(model.geom_dataid[geom])
    shape: dict[str, Any]
    tag, shape = {
        int(kinds.mjGEOM_SPHERE): ("sphere", {"radius": size[0]}),
        int(kinds.mjGEOM_CAPSULE): ("capsule", {"radius": size[0], "length": 2 * size[1]}),
        int(kinds.mjGEOM_CYLINDER): ("cylinder", {"radius": size[0], "length": 2 * size[1]}),
        int(kinds.mjGEOM_BOX): ("box", {"size": 2 * size}),
        int(kinds.mjGEOM_ELLIPSOID): ("ellipsoid", {"radii": size}),
    }.get(kind, ("mesh", {}))
    if tag == "mesh":
        shape = {"filename": meshes[mesh], "scale": model.mesh_scale[mesh]}
        place = place * _place(model.mesh_pos[mesh], model.mesh_quat[mesh]).inverse()  # from where MuJoCo has it
    collision = _add(link, "collision")
    _add_origin(collision, place)
    _add(_add(collision, "geometry"), tag, **shape)


def _add_joints(urdf: Element, tree: MjcfTree, body: int, motors: Mapping[int, JointMotor], links: set[str]) -> None:
    """Add what carries a body: its joints one after the other, and what then leads to the body's own frame."""
    model, own = tree.model, tree.body_names[body]
    carrier, place = (
        tree.body_names[int(model.body_parentid[body])],
        _place(model.body_pos[body], model.body_quat[body]),
    )
    for joint in tree.joints[body]:
        slides = model.jnt_type[joint] == import_mujoco().mjtJoint.mjJNT_SLIDE
        anchor, axis = np.zeros(3) if slides else model.jnt_pos[joint], model.jnt_axis[joint]
        back = -float(model.qpos0[model.jnt_qposadr[joint]])
        turned = np.eye(3) if slides else pin.AngleAxis(back, axis).matrix()
        place = place * _place(anchor) * pin.SE3(turned, back * axis if slides else np.zeros(3))
        child = own
        if anchor.any() or joint != tree.joints[body][-1]:
            child = new_name(f"{own}/{tree.joint_names[joint]}", links)
            _add(urdf, "link", name=child, type="frame")
        _add_joint(urdf, tree, joint, motors[joint], (carrier, child, place))
        carrier, place = child, _place(-anchor)
    if carrier != own:
        fixed = _add(urdf, "joint", name=new_name(f"{own}/", set(tree.joint_names.values())), type="fixed")
        _add_ends(fixed, carrier, own, place)


def _add_joint(urdf: Element, tree: MjcfTree, joint: int, motor: JointMotor, ends: tuple[str, str, Any]) -> None:
    model, limited = tree.model, bool(tree.model.jnt_limited[joint])
    slides = model.jnt_type[joint] == import_mujoco().mjtJoint.mjJNT_SLIDE
    kind = "prismatic" if slides else "revolute" if limited else "continuous"
    element = _add(urdf, "joint", name=tree.joint_names[joint], type=kind)
    _add_ends(element, *ends)
    _add(element, "axis", xyz=model.jnt_axis[joint])
    lower, upper = model.jnt_range[joint] if limited else (0.0, 0.0)  # zeros are no limits
    effort = motor.effort if np.isfinite(motor.effort) else 0.0
    _add(element, "limit", lower=lower, upper=upper, effort=effort, velocity=0.0)
    losses = {key: value for key in ("armature", "damping", "friction") if (value := getattr(motor, key))}
    if losses:
        _add(element, "dynamics", **losses)


def _add_ends(joint: Element, parent: str, child: str, place: Any) -> None:
    _add_origin(joint, place)
    _add(joint, "parent", link=parent)
    _add(joint, "child", link=child)
