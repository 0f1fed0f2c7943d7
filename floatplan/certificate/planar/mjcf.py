"""The robot as the certificate reads it from MJCF: bodies, inertias and joints straight from the XML, in Arb.

No code is shared with ``floatplan.robot``, and MuJoCo's compiler has no part in it: what a file means is in MuJoCo's
"XML Reference". What could change masses, inertias or joints and is not read here is refused by name
(:class:`NotReadError`), so that a plan is undecided rather than proved of another robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any, NamedTuple, TypeAlias
from xml.etree.ElementTree import Element

import flint

from floatplan.certificate.enclosure import PRECISION
from floatplan.certificate.planar.solids import (
    SOLIDS,
    cross,
    diagonal,
    dot,
    of_axes,
    of_quaternion,
    of_z,
    principal,
    unit,
)
from floatplan.certificate.planar.urdf import Joint, Link, Placement, Urdf, number, turn
from floatplan.errors import FloatplanError, InputError
from floatplan.files import LARGEST_URDF, check_depth, check_hash, parsed_xml, read_regular

Given: TypeAlias = Mapping[str, str]

SMALLEST = 1e-14  # [kg, m^3] MuJoCo takes a smaller mass or volume of a geom for none
SKEW = 1e-9  # [-] between axes of unit length that are at right angles but for rounding
TURNED = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}  # numbers of each form of an orientation
PLACED = f"name pos childclass class user {' '.join(TURNED)}"
KNOWN = {  # attributes that are read here, or change neither masses nor joints
    "compiler": "angle eulerseq inertiafromgeom inertiagrouprange settotalmass boundmass boundinertia balanceinertia "
    "coordinate autolimits strippath assetdir meshdir texturedir fitaabb discardvisual usethread saveinertial "
    "alignfree",
    "frame": PLACED,
    "body": f"{PLACED} sleep simple",
    "inertial": f"{PLACED} mass diaginertia fullinertia",
    "freejoint": "name group align",
    "joint": "name class type pos axis ref range limited armature damping stiffness frictionloss margin springref "
    "springdamper springyield actuatorfrcrange actuatorfrclimited actuatorgravcomp group user solreflimit solimplimit "
    "solreffriction solimpfriction",
    "geom": f"{PLACED} type fromto size mass density shellinertia group mesh fitscale hfield contype conaffinity "
    "condim priority friction solmix solref solimp margin gap adhesion surfacevel fluidshape fluidcoef material rgba "
    "castshadow",
}
PASSED_OVER = ("site", "camera", "light")  # as are all sections but four
SECTIONS = "compiler option size statistic visual default custom asset worldbody contact actuator sensor keyframe"


class NotReadError(FloatplanError):
    """Something of a robot that the certificate has no way of its own to read, so that it decides nothing."""

    def __init__(self, element: str, what: str = "") -> None:
        super().__init__(f"{element} is not read{what}")


class _Solid(NamedTuple):
    """A mass, and its inertia (3, 3) about ``center`` in the axes of that."""

    mass: Any
    center: Placement
    inertia: Any


def whole_mjcf(content: bytes, path: Path, hashes: Mapping[str, str]) -> Element:
    """Return the root element of an MJCF file, and in it what it includes: files by their paths from its folder.

    Raises
    ------
    InputError
        A file is missing, is not MJCF, or has another SHA-256 than that of its name in ``hashes``.
    NotReadError
        A file has no hash there.
    """
    root = _mjcf(content, path)
    waiting, names = [root], set[str]()
    while waiting:
        parent = waiting.pop()
        for place in reversed(range(len(parent))):
            if parent[place].tag == "include":
                name = PurePath(parent[place].get("file", "")).as_posix()
                if name not in hashes or name in names:
                    raise NotReadError(f'the included "{name}"', ": it has no hash of its own in the plan")
                names.add(name)
                included = read_regular(path.parent / name, LARGEST_URDF, "an MJCF file")
                check_hash(included, hashes[name], path.parent / name)
                parent[place : place + 1] = list(_mjcf(included, path.parent / name))
                waiting.append(parent)
        waiting += [child for child in parent if len(child)]
    check_depth(root, Element)
    return root


def _mjcf(content: bytes, path: Path) -> Element:
    root = parsed_xml(content, path)
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise InputError(f"is not MJCF: its root element is <{root.tag}>, not <mujoco>", source=path)
    return root


def read_mjcf(root: Element, path: Path) -> Urdf:
    """Read a whole MJCF file; the path is for messages.

    The root link is the one body of the world that moves: by a free joint, or by two slides and a hinge in a plane. A
    joint moves a link that stands at its anchor, to which the next one or the body is fixed.

    Raises
    ------
    InputError
        It is no MJCF of a robot that flies.
    NotReadError
        It has what is not read here.
    """
    try:
        with flint.ctx.workprec(PRECISION):
            return _Reading(root).world()
    except InputError as error:
        raise error.within(path) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"is no MJCF: {error}", source=path) from None


class _Reading:
    """The settings and classes of a file, and what is read with them."""

    def __init__(self, root: Element) -> None:
        for section in root:
            if section.tag not in SECTIONS.split():
                raise NotReadError(f"<{section.tag}>")
        self.root = root
        self.settings: dict[str, str] = {}
        for section in root.findall("compiler"):
            self.settings |= _known(section)
        if self.settings.get("coordinate", "local") != "local":
            raise NotReadError("<compiler>: coordinate")
        self.per_angle = flint.arb.pi() / 180 if self.settings.get("angle", "degree") == "degree" else flint.arb(1)
        self.from_geoms = self.settings.get("inertiafromgeom", "auto")
        self.classes: dict[str, dict[str, Given]] = {"main": {}}
        for section in root.findall("default"):
            self.read_class(section, "main")
        worlds = root.findall("worldbody")
        everything = [element for world in worlds for element in world.iter()]
        self.bodies = {element.get("name") for element in everything if element.tag == "body"} | {"world"}
        self.hinges = {element.get("name") for element in everything if element.tag in ("joint", "freejoint")}
        self.count = 0

    def read_class(self, section: Element, name: str) -> None:
        """Read defaults, then those of the classes within, which begin with them."""
        own = self.classes[name]
        for element in section:
            if element.tag in ("joint", "geom"):
                own[element.tag] = _over(own.get(element.tag, {}), _known(element))
        for element in section.findall("default"):
            self.classes[element.attrib["class"]] = dict(own)
            self.read_class(element, element.attrib["class"])

    def setting(self, key: str, default: str = "0") -> Any:
        """A number of ``<compiler>``."""
        return number(self.settings.get(key, default))

    def world(self) -> Urdf:
        """The body at the top that moves, with those below it; the masses of all bodies add up to what is asked."""
        tops = []
        self.links: dict[str, Link]
        self.joints: list[Joint]
        for section in self.root.findall("worldbody"):
            for element, name, frame in self.contents(section, "main", Placement()):
                if element.tag == "body":
                    self.links, self.joints, self.moves = {}, [], False
                    tops.append((self.body(element, name, frame), self.links, tuple(self.joints), self.moves))
        asked = self.setting("settotalmass", "-1")
        scale = flint.arb(1)
        if asked > 0:
            scale = asked / sum(link.mass for _, links, _, _ in tops for link in links.values())
        moving = [(root, links, joints) for root, links, joints, moves in tops if moves]
        if len(moving) != 1:
            raise InputError(f"has {len(moving)} bodies at the top that move, where one robot flies")
        ((root, links, joints),) = moving
        scaled = {
            name: replace(link, mass=link.mass * scale, inertia=link.inertia * scale) for name, link in links.items()
        }
        return Urdf(scaled, joints, root)

    def contents(self, element: Element, name: str, frame: Placement) -> Iterator[tuple[Element, str, Placement]]:
        """What is in a body, in frames too: each with its class, and the frame around it in the body's."""
        for inner in element:
            if inner.tag in PASSED_OVER:
                continue
            if inner.tag not in KNOWN or (inner.tag == "inertial" and element.tag == "frame"):
                raise NotReadError(f"<{inner.tag}> in a <{element.tag}>")
            own = inner.get("childclass") or inner.get("class") or name
            if own not in self.classes:
                raise InputError("there is no such class", element=f'class "{own}"')
            if inner.tag == "frame":
                yield from self.contents(inner, own, frame * self.placement(_known(inner)))
            else:
                yield inner, own, frame

    def body(self, element: Element, name: str, frame: Placement, parent: str = "") -> str:
        """Read a body and those below it, and return its name."""
        self.count += 1
        own, place = _named(element.attrib, f"body{self.count}", self.bodies), self.placement(_known(element))
        parts = list(self.contents(element, name, Placement()))
        joints: list[tuple[Joint, Any]] = []
        shapes: list[tuple[Given, Placement]] = []
        solid = _Solid(flint.arb(0), place, flint.arb_mat(3, 3))  # MuJoCo puts a mass there that boundmass asks for
        weighed = False
        for inner, kind, around in parts:
            given = _over(self.classes[kind].get(inner.tag, {}), _known(inner))
            if inner.tag in ("joint", "freejoint"):
                free = {"type": "free"} if inner.tag == "freejoint" else {}
                called = _named(inner.attrib, f"{own}_joint", self.hinges)
                joints.append(self.joint({**given, **free, "name": called}, around))
            elif inner.tag == "geom":
                shapes.append((given, around))
            elif inner.tag == "inertial":
                solid, weighed = self.inertial(given), True
        if self.from_geoms == "true" or (self.from_geoms == "auto" and not weighed):
            solid = _together([geom for shape in shapes for geom in self.geom(*shape, own)]) or solid
        solid = self.bounded(solid, own)
        if parent:
            self.hold(own, parent, frame * place, joints)
        else:
            _check_base([joint for joint, _ in joints], own)
        self.add(Link(own, solid.mass, solid.center, solid.inertia, bool(solid.mass > 0), bool(shapes)))
        for inner, kind, around in parts:
            if inner.tag == "body":
                self.body(inner, kind, around, own)
        return own

    def hold(self, body: str, parent: str, place: Placement, joints: list[tuple[Joint, Any]]) -> None:
        """Add a body's joints, each with a link at its anchor, to the last of which it is fixed."""
        for joint, anchor in joints:
            if joint.kind == "free":
                raise InputError("only a body at the top can be free", element=f'joint "{joint.name}"')
            link = f"{body}/{joint.name}"
            self.add(Link(link, flint.arb(0), Placement(), flint.arb_mat(3, 3), False, False))
            self.joints.append(replace(joint, parent=parent, child=link, origin=place * joint.origin))
            parent, place = link, Placement(translation=-1 * anchor)
        self.joints.append(Joint(f"{body}/", "fixed", parent, body, place, flint.arb_mat(3, 1), None, 0.0))

    def add(self, link: Link) -> None:
        """Add a link, which has a name of its own."""
        if link.name in self.links:
            raise InputError("there are two of this name", element=f'body "{link.name}"')
        self.links[link.name] = link

    def joint(self, given: Given, frame: Placement) -> tuple[Joint, Any]:
        """A joint, whose parent and child are not known yet, and its anchor; ``ref`` is in its origin."""
        kind, reference = given.get("type", "hinge"), number(given.get("ref", "0"))
        self.moves = True
        kinds = {"hinge": "revolute", "slide": "prismatic", "free": "free"}
        if kind not in kinds:
            raise NotReadError(f'joint "{given["name"]}", of type "{kind}",')
        anchor = frame.point(_column(given.get("pos", "0 0 0")))
        axis = frame.rotation * unit(_column(given.get("axis", "0 0 1")))
        armature = float(number(given.get("armature", "0")))
        joint = Joint(given["name"], kinds[kind], "", "", Placement(translation=anchor), axis, None, armature)
        back = joint.motion(-reference * self.per_angle if kind == "hinge" else -reference)
        return replace(joint, origin=joint.origin * back), anchor

    def placement(self, given: Given) -> Placement:
        """A place and an orientation, in any of MuJoCo's forms."""
        form = next((form for form in TURNED if form in given), "quat")
        parts = _numbers(given.get(form, "1 0 0 0"), TURNED[form])
        first, last = (flint.arb_mat(3, 1, three) for three in (parts[:3], parts[-3:]))
        if form == "quat":
            rotation = of_quaternion(*parts)
        elif form == "axisangle":
            rotation = turn(unit(first), parts[3] * self.per_angle)
        elif form == "euler":
            rotation = Placement().rotation
            for letter, angle in zip(self.settings.get("eulerseq", "xyz"), parts, strict=True):
                axis = flint.arb_mat(3, 1, [float(letter.lower() == each) for each in "xyz"])
                step = turn(unit(axis), angle * self.per_angle)
                rotation = rotation * step if letter.islower() else step * rotation
        else:
            rotation = of_z(first) if form == "zaxis" else of_axes(first, last)
        return Placement(rotation, _column(given.get("pos", "0 0 0")))

    def inertial(self, given: Given) -> _Solid:
        """Mass, centre and inertia as written; the full one is in the body's axes."""
        mass, center = number(given.get("mass")), self.placement(given)
        if "fullinertia" not in given:
            return _Solid(mass, center, diagonal(_numbers(given.get("diaginertia", "0 0 0"), 3)))
        xx, yy, zz, xy, xz, yz = _numbers(given["fullinertia"], 6)
        inertia = flint.arb_mat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return _Solid(mass, Placement(translation=center.translation), inertia)

    def geom(self, given: Given, frame: Placement, body: str) -> list[_Solid]:
        """What a geom adds to a body, where it counts."""
        low, high = map(int, self.settings.get("inertiagrouprange", "0 5").split())
        counts = low <= int(given.get("group", "0")) <= high
        kind, weight = given.get("type", "sphere"), number(given.get("mass", given.get("density", "1000")))
        if not counts or weight.is_zero() or kind in ("plane", "hfield"):
            return []
        if kind not in SOLIDS or "mesh" in given:
            raise NotReadError(f'body "{body}": inertia from a mesh')
        size = [number(word) for word in given.get("size", "").split()]
        size += [flint.arb(0)] * (3 - len(size))
        if "fromto" in given:
            ends = _numbers(given["fromto"], 6)
            first, last = flint.arb_mat(3, 1, ends[:3]), flint.arb_mat(3, 1, ends[3:])
            placed, half = Placement(of_z(first - last), (first + last) / 2), dot(first - last, first - last).sqrt() / 2
            size = [size[0], half, half] if kind in ("capsule", "cylinder") else [size[0], size[0], half]
        else:
            placed = self.placement(given)
        volume, squares = SOLIDS[kind](size[0], size[1], size[2], given.get("shellinertia") == "true")
        mass = weight if "mass" in given else weight * volume
        solid = _Solid(mass, frame * placed, diagonal([mass * (sum(squares) - square) for square in squares]))
        return [solid] if volume > SMALLEST and mass > SMALLEST else []

    def bounded(self, solid: _Solid, body: str) -> _Solid:
        """Mass and moments at least as large as asked, and equal moments where no body has them, if that is asked."""
        least, balanced = self.setting("boundinertia"), self.settings.get("balanceinertia") == "true"
        mass, inertia = solid.mass.max(self.setting("boundmass")), solid.inertia
        if least > 0 or balanced:
            axes, moments = principal(inertia)
            moments = [moment.max(least) for moment in moments]
            beyond = min((sum(moments) - 2 * moment for moment in moments), key=float)
            if balanced and not beyond >= 0:
                if not beyond < 0:
                    raise NotReadError(f'body "{body}": inertia', ": it is on the edge of what balanceinertia changes")
                moments = [sum(moments) / 3] * 3
            inertia = axes * diagonal(moments) * axes.transpose()
        return _Solid(mass, solid.center, inertia)


def _check_base(joints: list[Joint], body: str) -> None:
    """Refuse a body at the top that neither floats nor moves in a plane by two slides and a hinge."""
    slides = [joint.axis for joint in joints if joint.kind == "prismatic"]
    turns = [joint.axis for joint in joints if joint.kind == "revolute"]
    if not joints or [joint.kind for joint in joints] == ["free"]:
        return
    if len(slides) != 2 or len(turns) != 1 or len(joints) != 3:
        raise InputError("its joints to the world let it not fly", element=f'body "{body}"')
    normal = cross(*slides)
    if not dot(normal, normal) > SKEW or any(not abs(dot(slide, turns[0])) < SKEW for slide in slides):
        raise InputError("its slides do not span the plane in which its hinge turns", element=f'body "{body}"')


def _together(solids: list[_Solid]) -> _Solid | None:
    """All of them as one, None of none."""
    if not solids:
        return None
    mass = sum((solid.mass for solid in solids), start=flint.arb(0))
    center = sum((solid.center.translation * solid.mass for solid in solids), start=flint.arb_mat(3, 1)) * (1 / mass)
    inertia = flint.arb_mat(3, 3)
    for solid in solids:
        arm, turned = solid.center.translation - center, solid.center.rotation
        inertia += turned * solid.inertia * turned.transpose()
        inertia += (diagonal([dot(arm, arm)] * 3) - arm * arm.transpose()) * solid.mass
    return _Solid(mass, Placement(translation=center), inertia)


def _over(base: Given, own: Given) -> dict[str, str]:
    """Attributes over those of a class: one form of an orientation for another, and the first numbers of a size."""
    turned = any(form in own for form in TURNED)
    kept = {key: value for key, value in base.items() if not (turned and key in TURNED)}
    first, size = own.get("size", "").split(), base.get("size", "").split()
    return {**kept, **own, "size": " ".join([*first, *size[len(first) :]])}


def _named(given: Given, otherwise: str, taken: set[str | None]) -> str:
    """The name of an element, or one that it is given here, which no other has."""
    name = given.get("name") or otherwise
    while not given.get("name") and name in taken:
        name += "_"
    taken.add(name)
    return name


def _known(element: Element) -> Given:
    """The attributes of an element, all of which are known."""
    for key in element.attrib:
        if key not in KNOWN[element.tag].split():
            raise NotReadError(f"<{element.tag}>: {key}")
    return element.attrib


def _numbers(text: str, count: int) -> list[Any]:
    words = text.split()
    if len(words) != count:
        raise InputError(f'"{text}" is not {count} numbers')
    return [number(word) for word in words]


def _column(text: str) -> Any:
    return flint.arb_mat(3, 1, _numbers(text, 3))
