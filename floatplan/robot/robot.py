"""The robot that flies: a checked URDF, its model on a planar free-flyer, and the choice of planned joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypedDict, Unpack, get_args
from xml.etree.ElementTree import fromstring, tostring

import numpy as np
import pinocchio as pin

from floatplan.arguments import (
    FINITE,
    Check,
    by_name,
    flag,
    for_all,
    made,
    many,
    number,
    one_of,
    optional,
    text,
    without_none,
)
from floatplan.arguments import path as as_path
from floatplan.arrays import Array, read_only
from floatplan.errors import InputError, naming
from floatplan.pool import one_thread
from floatplan.robot.planar import model as planar
from floatplan.robot.planar.choice import (
    Choice,
    Coupling,
    Plane,
    against_gravity,
    choose_joints,
    in_radians,
    with_motors,
)
from floatplan.robot.planar.mirror import mirror_couplings
from floatplan.robot.planar.tree import Frame, PlanarTree, TreeLayout
from floatplan.robot.shapes import links
from floatplan.robot.shapes.capsules import Outline
from floatplan.robot.shapes.links import LinkCapsule
from floatplan.robot.shapes.solids import LinkSolid, SolidCapsule, link_solids
from floatplan.robot.source import read_source
from floatplan.robot.urdf.check import Changes, check_urdf, taken_urdf
from floatplan.robot.urdf.inertias import Payload, payloads
from floatplan.robot.urdf.srdf import reference_posture, with_rotors
from floatplan.robot.urdf.tree import UrdfText, UrdfTree, urdf_path
from floatplan.tables import Base, RobotKind, Unit

ROOT_JOINT = "root_joint"  # Pinocchio's name of the free flyer


def _coupled(value: Any, element: str) -> Any:
    """Check followers and leaders, or the word for pairs left and right."""
    if isinstance(value, str) and value != "mirror":
        raise InputError(f'must be a table of joints, or "mirror", not "{value}"', element=element)
    return value if isinstance(value, str) else by_name(made(str, Coupling))(value, element)


def _named(choices: Mapping[str, Any]) -> set[str]:
    """Joints that choices of a robot name, other than as leaders."""
    coupled = choices["coupled"]
    return {*(choices["joints"] or ()), *(choices["locked"] or ()), *(coupled if isinstance(coupled, Mapping) else ())}


class Choices(TypedDict, total=False):
    """Settings that a robot's file leaves open, see :meth:`Robot.from_urdf`."""

    plane: str | None
    joints: Sequence[str] | None
    coupled: Mapping[str, str | Coupling] | Literal["mirror"] | None
    locked: Mapping[str, float] | None
    reference: str | None
    armature: float | Mapping[str, float] | None
    damping: float | Mapping[str, float] | None
    balance_inertias: bool | None
    payload: Payload | Mapping[str, Any] | Sequence[Payload | Mapping[str, Any]] | None
    base: Base
    angles: Unit


CHOICES: Mapping[str, Check] = {  # of settings that a robot's file leaves open: keyword arguments of all that read one
    "plane": optional(text),
    "reference": optional(text),
    "armature": optional(for_all(number("armature"))),
    "damping": optional(for_all(number("damping"))),
    "joints": optional(many(text, "names")),
    "locked": optional(by_name(FINITE)),
    "coupled": optional(_coupled),
    "balance_inertias": optional(flag),
    "payload": optional(payloads),
    "base": one_of(*get_args(Base)),
    "angles": one_of(*get_args(Unit)),
}
__all__ = ["Coupling", "Frame", "LinkCapsule", "Payload", "PlanarTree", "Plane", "Robot"]


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A robot of n planned joints that flies in a plane, or in space.

    The full configuration of ``model`` is ``reference + selection @ positions`` with the base's horizontal position,
    vertical position and orientation in its first three entries (zero in both arrays). In space the first seven are the
    base's position and its quaternion x, y, z, w, at the identity in ``reference``.

    Attributes
    ----------
    name, path, sha256, xml : of the file as read; ``xml`` is a URDF, of an MJCF the one that is the same robot
        Joints by which the file's own base floats are fixed in it, inertias are balanced where that is chosen, and the
        payload is added to its links.
    source : the file as the caller named it, such as ``example-robot-data:...``
    base : "planar", or "free-flyer" in space
    joints : (n) names of the planned joints, in the order of all arrays
    locked : joint name -> rad
    coupled : follower's joint name -> Coupling
    model : pinocchio.Model with nq = nv = 3 + joints that move (nv = 6 + these in space); gravity zero
    reference : (nq,) rad
    selection : (nv, n)
    position_limits : (n, 2) rad, infinite where the file has none
    velocity_limits : (n,) rad/s, infinite where the file has none
    torque_limits : (n,) N m, infinite where the file has none
        Of the generalised torques: of a leader with its followers, by their ratios.
    motors : (m) names
        The planned joints, then the followers; not those that the file itself gears to their leader by ``<mimic>``.
    motor_ratios : (m, n)
        Derivatives of the motors' positions by the planned positions.
    motor_torque_limits, motor_velocity_limits : (m,) N m, rad/s
        Of each motor's own joint; infinite where the file has none.
    transmission : (nv, m)
        Each motor's torque is ``transmission.T`` times the torques of all joints of ``model``.
    joint_tree : UrdfTree
        Links and joints as they are planned: in a plane the axes are along its normal.
    resting : (n,) rad, the planned joints' positions in the reference posture, or nearest to zero
    warnings : what the URDF leaves in doubt
    in_plane : how links are gathered into bodies; None in space
    reference_name : of the reference posture in an SRDF file, where one was named
    tilt : rad, the largest angle between a joint's axis in the file and the plane's normal
    kind : "urdf" or "mjcf", what its file is
    files : SHA-256 of the files that an MJCF includes or names, by their paths from its folder
    balance_inertias : whether inertias that no body can have are balanced
    payload : point masses that links carry
    gravity_direction : (3,) unit vector along gravity, where the file says which way it points
        In the root link's axes, in the posture of an MJCF's file. None of a URDF, which does not say it, and of an
        MJCF without gravity.
    rotor_file : the SRDF file whose ``<rotor_params>`` the rotors' inertias are from, None where none are
    """

    name: str
    path: Path
    sha256: str
    xml: str
    base: Base
    joints: tuple[str, ...]
    locked: Mapping[str, float]
    coupled: Mapping[str, Coupling]
    model: Any
    reference: Array
    selection: Array
    position_limits: Array
    velocity_limits: Array
    torque_limits: Array
    motors: tuple[str, ...]
    motor_ratios: Array
    motor_torque_limits: Array
    motor_velocity_limits: Array
    transmission: Array
    joint_tree: UrdfTree
    resting: Array
    warnings: tuple[str, ...]
    source: str
    in_plane: TreeLayout | None
    tilt: float
    reference_name: str | None = None
    kind: RobotKind = "urdf"
    files: Mapping[str, str] = field(default_factory=dict)
    balance_inertias: bool = False
    payload: tuple[Payload, ...] = ()
    rotor_file: Path | None = None
    gravity_direction: Array | None = None

    @classmethod
    def from_urdf(cls, source: str | Path, **choices: Unpack[Choices]) -> Robot:
        """Load a robot from a URDF file.

        Parameters
        ----------
        source : path
            The URDF file, or a xacro file, which makes one; or the text ``example-robot-data:`` and a file's path in
            that package; or ``package:``, the import name of another installed package, "/" and a path in its folder;
            or a name of robot_descriptions, such as "go2_description".
        plane : str, optional
            The plane's horizontal and vertical axis among the root link's, such as "xz". Chosen from the joints' axes
            where left out.
        joints : sequence of str, optional
            The joints to plan, in the order of all arrays. Left out: all that rotate about the plane's normal.
        coupled : mapping, optional
            Followers' names to their leaders: a :class:`Coupling`, or a name (ratio 1; with a minus sign, -1).
            Joints that the file has ``<mimic>`` a planned joint are coupled by themselves. ``"mirror"``
            couples the pairs of joints that are each other's mirror image left and right of the plane.
        locked : mapping, optional
            Names of joints that do not move to their positions: rad, or deg if ``angles="deg"``; m of what slides. All
            others that are neither planned nor coupled are locked at the position within their limits that is nearest
            to the reference posture's.
        reference : str, optional
            The reference posture: the name of a state in an SRDF file next to the URDF, such as "standing". Left out:
            all zero.
        armature : float or mapping, optional
            Inertia of the motors' rotors as the joints feel it (the rotor's own, times the gear's ratio squared),
            kg m^2: of every motor, or by joint. A joint that is left out has that of the file's ``<dynamics
            armature="..">``, or none. Where the argument is left out, joints without that have what ``<rotor_params>``
            of an SRDF file next to the URDF says; 0 is none. It counts in torques; the momentum does not count it.
        damping : float or mapping, optional
            Torque lost in a joint by its rate, N m s/rad; else the file's ``<dynamics damping="..">``, or zero.
            Only simulators use it, as the file's ``friction``.
        balance_inertias : bool, optional
            Whether an inertia that no body can have (a negative principal moment, or one larger than the sum of the
            other two) is taken with all three moments equal to their mean, as MuJoCo's ``balanceinertia`` does. Such
            files are refused otherwise.
        payload : Payload, mapping or a sequence of these, optional
            Point masses that links carry: ``{"link": "trunk", "mass": 2.0, "at": [0, 0, 0.05]}``, kg and m, in the
            link's frame.
        base : str, optional
            How the base moves: "planar", or "free-flyer" for flights in space, where there is no plane and all joints
            that rotate are planned unless they are locked or coupled.

        Raises
        ------
        InputError
            If the file is not a sound URDF, a name does not exist or is wrongly used, or the plane remains open.
        """
        return cls.from_file(source, "urdf", **choices)

    @classmethod
    def from_mjcf(cls, source: str | Path, **choices: Unpack[Choices]) -> Robot:
        """Load a robot from an MJCF file, which MuJoCo compiles.

        Bodies are links with their own frames; the base is the one body of the world that moves. Positions of joints
        are MuJoCo's. Torque limits are those of the actuators, by gear and range of control or of force, and the
        joint's ``actuatorfrcrange``. Shapes are around the geoms that can touch something.

        Parameters
        ----------
        source : path
            The file; or its address in a package, as of :meth:`from_urdf`.
        **choices
            As of :meth:`from_urdf`; ``reference`` names a keyframe.

        Raises
        ------
        InputError
            MuJoCo is not installed (extra ``mjcf``) or refuses the file; the robot cannot fly, or has what is no tree
            of joints with one motor each: ball joints, constraints, tendons with forces; or as of :meth:`from_urdf`.
        """
        return cls.from_file(source, "mjcf", **choices)

    @classmethod
    @one_thread
    def from_file(cls, source: str | Path, kind: RobotKind | None = None, **choices: Any) -> Robot:
        """Load a robot from a URDF or an MJCF, or a file of one kind; choices and errors as of the ones above."""
        if unknown := choices.keys() - CHOICES:
            raise TypeError(f"there is no keyword argument {min(unknown)!r}")
        source = source if isinstance(source, str) else as_path(source, "source")
        path = urdf_path(source, kind)
        with naming(path):
            defaults = {"base": "planar", "angles": "rad"}
            choices = {name: check(choices.get(name, defaults.get(name)), name) for name, check in CHOICES.items()}
            plane = choices["plane"]
            joints = choices["joints"]
            coupled = choices["coupled"]
            reference = choices["reference"]
            changes = Changes(
                balance_inertias=bool(choices["balance_inertias"]),
                payload=choices["payload"] or (),
                with_role=_named(choices),
            )
            text, tree = taken_urdf(read_source(path, kind, changes.balance_inertias), changes)
            tree = replace(tree, warnings=(*text.warnings, *tree.warnings))
            rotor_file = None
            if text.kind == "urdf" and choices["armature"] is None:
                tree, rotor_file = with_rotors(tree, text.path)
            posture = None if reference is None else reference_posture(reference, tree, text)
            locked = in_radians(tree, choices["locked"] or {}, choices["angles"])
            choose = partial(
                choose_joints,
                tree,
                base=choices["base"],
                locked=locked,
                posture=posture,
                gravity_direction=text.gravity_direction,
            )
            if coupled == "mirror":
                everything = choose(plane=plane, joints=None, coupled=None)
                plane = everything.required_plane.name
                coupled = mirror_couplings(tree, everything, joints)
            choice = choose(plane=plane, joints=joints, coupled=coupled)
            motors = {name: choices[name] for name in ("armature", "damping")}
            robot = cls._assemble(str(source), text, with_motors(tree, choice, motors), choice)
            contradiction = against_gravity(robot.up, text.gravity_direction)
            return replace(
                robot,
                reference_name=reference,
                balance_inertias=changes.balance_inertias,
                payload=changes.payload,
                rotor_file=rotor_file,
                gravity_direction=text.gravity_direction,
                warnings=(*robot.warnings, *filter(None, [contradiction])),
            )

    @classmethod
    def _assemble(cls, source: str, text: UrdfText, written: UrdfTree, choice: Choice) -> Robot:
        tree = written if choice.plane is None else planar.with_axes_in_plane(written, choice)
        model = planar.build_model(tree, choice)
        reference, selection, transmission = planar.coordinates(model, choice)
        position_limits, velocity_limits, torque_limits = planar.planned_limits(tree, choice)
        planar.check_model(model, reference, selection, choice.planned, position_limits)
        resting = [choice.resting[name] for name in choice.planned]
        left_out = 'link "{}": collision mesh "{}" not found; left out of its shape'
        missing = [left_out.format(*mesh) for mesh in links.missing_meshes(tree, text.path.parent)]
        return cls(
            name=tree.name,
            path=text.path,
            sha256=text.sha256,
            xml=text.xml,
            base="free-flyer" if choice.plane is None else "planar",
            joints=choice.planned,
            locked=MappingProxyType(dict(choice.locked)),
            coupled=MappingProxyType(dict(choice.coupled)),
            model=model,
            reference=reference,
            selection=selection,
            position_limits=position_limits,
            velocity_limits=velocity_limits,
            torque_limits=torque_limits,
            motors=choice.motors,
            motor_ratios=read_only([choice.ratios[name] for name in choice.motors]),
            motor_torque_limits=read_only([tree.joint[name].effort for name in choice.motors]),
            motor_velocity_limits=read_only([tree.joint[name].velocity for name in choice.motors]),
            transmission=transmission,
            joint_tree=tree,
            resting=read_only(np.clip(resting, position_limits[:, 0], position_limits[:, 1])),
            warnings=(*choice.warnings, *missing),
            source=source,
            in_plane=None if choice.plane is None else TreeLayout.of(tree, choice),
            tilt=planar.largest_tilt(written, tree),
            kind=text.kind,
            files=MappingProxyType(dict(text.files)),
        )

    @property
    def layout(self) -> TreeLayout:
        """How links are gathered into bodies of the plane; InputError in space, as of all that follows from it."""
        if self.in_plane is None:
            raise self.not_in_plane
        return self.in_plane

    @property
    def not_in_plane(self) -> InputError:
        """The refusal of a robot that flies in space by functions for flights in a plane."""
        reason = "the robot flies in space, and this is not yet for flights in space"
        advice = "leave base out"
        return InputError(reason, source=self.source, element="robot.base", advice=advice)

    @property
    def plane(self) -> Plane:
        """The plane in which it flies; refused in space."""
        return self.layout.plane

    @cached_property
    def tree(self) -> PlanarTree:
        """Bodies in the plane; refused in space."""
        return self.layout.planar_tree

    @cached_property
    def frames(self) -> Mapping[str, Frame]:
        """Links' and joints' origins by name, on the bodies of ``tree``; refused in space."""
        return MappingProxyType(dict(self.layout.frames))

    @cached_property
    def model_joints(self) -> tuple[str, ...]:
        """Names of the joints of ``model`` that move, in its order."""
        return tuple(self.model.names)[1 + len(set(self.model.names) - self.joint_tree.joint.keys() - {"universe"}) :]

    @property
    def up(self) -> Array:
        """Unit vector (3,) against gravity, in the root link's axes at orientation zero."""
        return read_only((0.0, 0.0, 1.0) if self.in_plane is None else self.in_plane.plane.vertical)

    def free_flyer(self) -> pin.Model:
        """Return the Pinocchio model in whose order :meth:`floatplan.Plan.q`, ``v``, ``a`` and ``tau`` are.

        It is the one of ``pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())``: a base that floats in
        space, and every joint that the file lets move. Joints by which the file lets its own base float are fixed in
        it. Each call returns a model of its own, whose ``gravity`` may be set.

        Raises
        ------
        InputError
            A joint is called ``root_joint``, as Pinocchio calls the free flyer.
        """
        return self._free_flyer.copy()

    @cached_property
    def _free_flyer(self) -> pin.Model:
        if ROOT_JOINT in self.joint_tree.joint:
            raise InputError(
                "Pinocchio gives this name to the free flyer, and so has no free-flyer model of the file",
                source=self.path,
                element=f'joint "{ROOT_JOINT}"',
                advice="rename it",
            )
        root = fromstring(self.xml)
        for link_or_joint in root:
            # Neither matters to the model, and Pinocchio's parser does not take all that files have here.
            for ignored in (*link_or_joint.findall("collision"), *link_or_joint.findall("dynamics")):
                link_or_joint.remove(ignored)
        return pin.buildModelFromXML(tostring(root, encoding="unicode"), pin.JointModelFreeFlyer())

    @property
    def nq(self) -> int:
        """Size of a configuration of :meth:`free_flyer`: position, quaternion, joints (``continuous`` ones twice)."""
        return int(self._free_flyer.nq)

    @property
    def nv(self) -> int:
        """Size of a velocity of :meth:`free_flyer`: six of the base, one of each joint."""
        return int(self._free_flyer.nv)

    @property
    def frame_names(self) -> list[str]:
        """Names of links and joints, whose origins are frames."""
        return [*self.joint_tree.links, *self.joint_tree.joint]

    @property
    def armature(self) -> Mapping[str, float]:
        """Inertia of rotors as their joints feel it, kg m^2, by joint, of the file or the caller."""
        return self._of_joints("armature")

    @property
    def damping(self) -> Mapping[str, float]:
        """Torque lost by the rate, N m s/rad, by joint, of the file or the caller."""
        return self._of_joints("damping")

    @property
    def friction(self) -> Mapping[str, float]:
        """Torque lost at any rate, N m, by joint, of the file."""
        return self._of_joints("friction")

    def _of_joints(self, key: str) -> Mapping[str, float]:
        values = {joint.name: getattr(joint, key) for joint in self.joint_tree.joints}
        return without_none(values)

    def check_shapes(self) -> None:
        """Refuse collision geometry that ``shapes`` leave out: the robot would be clear of what it hits.

        Raises
        ------
        InputError
            A mesh does not exist, or geometry is of a kind that is not read.
        """
        if self._left_out is not None:
            raise self._left_out.within(self.source)

    @cached_property
    def _left_out(self) -> InputError | None:
        return links.left_out(self.joint_tree, self.path.parent)

    @cached_property
    def file_tree(self) -> UrdfTree:
        """Links and joints as the file has them; the joints of ``layout.tree`` have axes along the plane's normal."""
        return check_urdf(fromstring(self.xml), self.locked)

    @cached_property
    def meshes(self) -> Mapping[str, str]:
        """SHA-256 of the collision meshes that ``shapes`` are around, by their names in the file, and of ``files``."""
        return MappingProxyType({**links.mesh_digests(self.joint_tree, self.path.parent), **self.files})

    @property
    def shapes(self) -> tuple[LinkCapsule, ...]:
        """The links' shapes in the plane, fitted when first used.

        Raises
        ------
        InputError
            If the geometry of a ``<collision>`` is wrong, or its file is not a mesh, or not the one of ``meshes``.
        """
        return self._shapes[0]

    @property
    def capsules(self) -> tuple[LinkCapsule, ...] | tuple[SolidCapsule, ...]:
        """The capsules by which distances are measured, where the robot flies; errors as of ``shapes``."""
        return self.shapes if self.in_plane else self.solid_capsules

    @property
    def has_shapes(self) -> bool:
        """Whether any link has collision geometry; else all are lines."""
        return any(link.collisions for link in self.joint_tree.links.values())

    @property
    def link_hulls(self) -> Mapping[str, Sequence[LinkCapsule]]:
        """Convex hulls of the links that have a shape: capsules whose ends are its corners; errors as of ``shapes``."""
        return self._shapes[1]

    @property
    def limb_ends(self) -> list[str]:
        """Links with a shape on bodies that carry no other: hands, feet, head."""
        carrying = set(self.tree.parent.tolist())
        return [link for link in self.link_hulls if self.layout.body_of[link] not in carrying]

    @cached_property
    def touching_links(self) -> list[str]:
        """Links that can touch the ground: those with collision geometry, and those of bodies where none has any.

        Links without geometry are lines to the origins of their children's joints. Such an origin may be anywhere in a
        foot that is fixed there, and below it: where a body has geometry, lines of its other links touch nothing.
        """
        links = [link for link, hull in self.link_hulls.items() if hull]
        with_geometry = {link for link in links if self.joint_tree.links[link].collisions}
        bodies = {self.layout.body_of[link] for link in with_geometry}
        return [link for link in links if link in with_geometry or self.layout.body_of[link] not in bodies]

    def contact_link(self, link: str) -> str | None:
        """Return the link with whose shapes another stands on the ground: itself, else one that it is fixed to.

        None where none of these has any; errors as of ``shapes``.
        """
        shaped = self.link_hulls if self.in_plane else {solid.link for solid in self.solids}
        for joint in self.joint_tree.path(link):
            if link in shaped or joint.moves:
                break
            link = joint.parent
        return link if link in shaped else None

    def stands_on_geometry(self, link: str) -> bool:
        """Whether a link stands on the ground with collision geometry, and not with a line between joints."""
        own = self.contact_link(link)
        return own is not None and bool(self.joint_tree.links[own].collisions)

    def hulls(self, frames: Iterable[str], touching: Iterable[str] = ()) -> tuple[LinkCapsule, ...]:
        """Shapes whose ends are as high over the ground as the links, where these frames stand on it.

        Those of the links that stand are all corners of their hulls. Bodies that rotate with one of them are exact too,
        and those of the links ``touching``; others reach up to a millimetre farther. Errors as of ``shapes``.
        """
        return self._hulls(tuple(frames), frozenset(touching))

    @lru_cache(maxsize=16)  # noqa: B019 - of few robots, as many problems of one have the same
    def _hulls(self, frames: tuple[str, ...], touching: frozenset[str]) -> tuple[LinkCapsule, ...]:
        turns = self.tree.turns
        bases = [self.frames[frame] for frame in frames]
        exact = {self.layout.body_of[link] for link in touching}
        standing: dict[str, None] = {}
        for base in bases:
            exact.update(np.flatnonzero((turns == turns[base.body]).all(axis=1)).tolist())
            link = self.contact_link(base.link)
            if link is not None:
                standing[link] = None
        hulls = {link: self.link_hulls[link] for link in dict.fromkeys((*self.touching_links, *standing))}
        return links.moving_hulls(self.tree, hulls, standing, exact)

    @cached_property
    @one_thread
    def _shapes(self) -> tuple[tuple[LinkCapsule, ...], dict[str, list[LinkCapsule]]]:
        with naming(self.path):
            return links.link_shapes(self.layout, self.path.parent, self.meshes)

    @cached_property
    @one_thread
    def solids(self) -> tuple[LinkSolid, ...]:
        """The links' shapes in space, each carried by a joint of ``model``; errors as of ``shapes``."""
        with naming(self.path):
            return link_solids(self.model, self.joint_tree, self.path.parent, self.meshes)

    @cached_property
    @one_thread
    def solid_capsules(self) -> tuple[SolidCapsule, ...]:
        """Capsules around the links' solids, by which distances in space are measured; errors as of ``shapes``."""
        from floatplan.robot.shapes.solid_capsules import solid_capsules  # here, since flights in a plane do without

        return solid_capsules(self.solids)

    @property
    @one_thread
    def outlines(self) -> list[tuple[int, Outline]]:
        """The collision geometry that ``shapes`` are around, each outline with its body; errors as of ``shapes``."""
        with naming(self.path):
            return links.link_outlines(self.layout, self.path.parent, self.meshes)

    @property
    def resting_configuration(self) -> Array:
        """Configuration (nq,) of ``model`` with joints and base in the reference posture."""
        return self.configuration(self.resting)

    def configuration(self, positions: Array) -> Array:
        """Configuration (nq,) of ``model`` at planned positions (n,), rad, with the base in the reference posture."""
        q = self.reference.copy()
        q[self.model.nq - self.model.nv :] += self.selection @ positions
        return q

    @cached_property
    @one_thread
    def rod_length(self) -> float:
        """Length, m, of a thin rod of the same mass and largest moment of inertia, in the reference posture."""
        data = self.model.createData()
        pin.ccrba(self.model, data, self.resting_configuration, np.zeros(self.model.nv))
        return math.sqrt(12 * float(np.linalg.eigvalsh(data.Ig.inertia).max()) / self.mass)

    @property
    def mass(self) -> float:
        """Mass of the whole robot, kg."""
        if self.in_plane is None:
            return float(pin.computeTotalMass(self.model))
        # Pinocchio's sum differs in the last bit from that of the bodies, by which flights in the plane are planned.
        return float(self.tree.mass.sum())

    def __getstate__(self) -> dict[str, Any]:
        """Everything as it is, but for read-only mappings, which cannot be pickled."""
        state = dict(self.__dict__)  # a copy, as another thread may be adding the shapes
        for name, value in state.items():
            if isinstance(value, MappingProxyType):
                state[name] = dict(value)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            self.__dict__[name] = MappingProxyType(value) if isinstance(value, dict) else value

    def __repr__(self) -> str:
        where = f"plane={self.plane.name!r}" if self.in_plane else f"base={self.base!r}"
        return f"Robot({self.name!r}, {where}, joints={list(self.joints)}, mass={self.mass:.4g} kg)"

    def _repr_html_(self) -> str:
        """A table and a drawing of the robot, as notebooks show it; no drawing where a shape cannot be read."""
        return str(import_module("floatplan.view.notebook").robot_html(self))
