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
    diagonal,
    dot,
    of_axes,
    of_quaternion,
    of_z,
    principal,
    unit,
)
from floatplan.certificate.planar.urdf import Joint, Link, Placement, Urdf, number, numbers, turn
from floatplan.errors import FloatplanError, InputError
from floatplan.files import LARGEST_URDF, check_depth, check_hash, parsed_xml, read_regular

Given: TypeAlias = Mapping[str, str]

SMALLEST = 1e-14  # [kg, m^3] MuJoCo takes a smaller mass or volume of a geom for none
FLAGS = {"true": True, "false": False}
KINDS = {"hinge": "revolute", "slide": "prismatic"}
TURNS = {"revolute", "ball"}
TURNED = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}  # numbers of each form of an orientation
PLACED = f"name pos childclass class user {' '.join(TURNED)}"
KNOWN = {  # attributes that are read here, or change neither masses nor joints, as those of solvers do, "sol.."
    "compiler": "angle eulerseq inertiafromgeom inertiagrouprange settotalmass boundmass boundinertia balanceinertia "
    "fusestatic coordinate autolimits strippath assetdir meshdir texturedir fitaabb discardvisual usethread "
    "saveinertial alignfree",
    "frame": PLACED,
    "body": f"{PLACED} sleep simple gravcomp",
    "inertial": f"{PLACED} mass diaginertia fullinertia",
    "freejoint": "name group align",
    "joint": "name class type pos axis ref range limited armature damping stiffness frictionloss margin springref "
    "springdamper springyield actuatorfrcrange actuatorfrclimited actuatorgravcomp group user",
    "geom": f"{PLACED} type fromto size mass density shellinertia group mesh fitscale hfield contype conaffinity "
    "condim priority friction margin gap adhesion surfacevel fluidshape fluidcoef material rgba castshadow",
    "tendon": "name class group width rgba material springlength springyield margin user",  # others pull or hold
}
KNOWN |= dict.fromkeys(("fixed", "spatial"), KNOWN["tendon"])
PASSED_OVER = ("site", "camera", "light")  # as are all sections but four
SECTIONS = "compiler option size statistic visual default custom asset worldbody contact actuator sensor keyframe"
SECTIONS += " tendon deformable equality"  # of which only what does nothing


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
        A file is missing, is not XML, or has another SHA-256 than that of its name in ``hashes``.
    NotReadError
        A file has no hash there.
    """
    root, names = parsed_xml(content, path), set[str]()
    while (parent := root.find(".//include/..")) is not None:
        place, include = next((place, each) for place, each in enumerate(parent) if each.tag == "include")
        name = PurePath(include.get("file", "")).as_posix()
        if name not in hashes or name in names:
            raise NotReadError(f'the included "{name}"', ": it has no hash of its own in the plan")
        names.add(name)
        included = read_regular(path.parent / name, LARGEST_URDF, "an MJCF file")
        check_hash(included, hashes[name], path.parent / name)
        parent[place : place + 1] = list(parsed_xml(included, path.parent / name))
    check_depth(root, Element)
    return root


def read_mjcf(root: Element, path: Path, balance_inertias: bool = False) -> Urdf:
    """Read a whole MJCF file; the path is for messages.

    With ``balance_inertias`` they are balanced, whatever the file says.
    The root link is the body of the world that floats: by a free joint, or by joints that slide and turn; else the one
    that moves, or that has a mass.

    Raises
    ------
    InputError
        It is no MJCF of a robot that flies.
    NotReadError
        It has what is not read here.
    """
    try:
        with flint.ctx.workprec(PRECISION):
            return _Reading(root, balance_inertias).world()
    except InputError as error:
        raise error.within(path) from None
    except (ValueError, LookupError) as error:
        raise InputError(f"is no MJCF: {error}", source=path) from None


class _Reading:
    """The settings and classes of a file, and what is read with them."""

    def __init__(self, root: Element, balance_inertias: bool) -> None:
        if root.tag != "mujoco":
            raise InputError(f"is not MJCF: its root element is <{root.tag}>, not <mujoco>")
        for section in root:
            if section.tag not in SECTIONS.split():
                raise NotReadError(f"<{section.tag}>")
        for tendon in root.iterfind("tendon/*"):
            _known(tendon)
        acting = [each for each in root.iterfind("equality/*") if each.get("active") != "false"]
        acting += [each for each in root.iterfind("deformable/*") if each.tag != "skin"]
        acting += [each for each in root.iterfind("actuator/*") if {"tendon", "armature"} & each.attrib.keys()]
        if acting:
            raise NotReadError(f'<{acting[0].tag}> "{acting[0].get("name", "")}"')
        self.root = root
        self.settings: dict[str, str] = {}
        for section in root.findall("compiler"):
            self.settings |= _known(section)
        if balance_inertias:
            self.settings["balanceinertia"] = "true"
        if self.settings.get("coordinate", "local") != "local":
            raise NotReadError("<compiler>: coordinate")
        units = {"degree": flint.arb.pi() / 180, "radian": flint.arb(1)}
        self.per_angle = units[self.settings.get("angle", "degree")]
        self.from_geoms = {"auto": None, **FLAGS}[self.settings.get("inertiafromgeom", "auto")]
        self.classes: dict[str, dict[str, Given]] = {"main": {}}
        for section in root.findall("default"):
            self.read_class(section, "main")
        worlds = root.findall("worldbody")
        self.bodies = {"world", *(body.get("name") for world in worlds for body in world.iter("body"))}
        tags = ("joint", "freejoint")
        self.hinges = {joint.get("name") for world in worlds for tag in tags for joint in world.iter(tag)}
        self.paired = {pair.get(end) for pair in root.iterfind("contact/pair") for end in ("geom1", "geom2")}
        self.links: dict[str, Link] = {}
        self.joints: list[Joint] = []
        self.held: list[str] = []
        self.count = 0

    def read_class(self, section: Element, name: str) -> None:
        """Read defaults, then those of the classes within, which begin with them."""
        own = self.classes[name]
        for element in section:
            if element.tag in ("joint", "geom", "tendon"):
                own[element.tag] = _over(own.get(element.tag, {}), _known(element))
            elif "armature" in element.attrib:
                raise NotReadError(f'<{element.tag}> in class "{name}": armature')
        for element in section.findall("default"):
            self.classes[element.attrib["class"]] = dict(own)
            self.read_class(element, element.attrib["class"])

    def setting(self, key: str, default: str = "0") -> Any:
        """A number of ``<compiler>``."""
        return number(self.settings.get(key, default))

    def world(self) -> Urdf:
        """The robot in the world; the masses of all bodies add up to what is asked."""
        tops = []
        for section in self.root.findall("worldbody"):
            for element, name, frame in self.contents(section, "main", Placement()):
                if element.tag == "body":
                    self.links, self.joints, self.held = {}, [], []
                    self.body(element, name, frame)
                    tops.append((self.links, self.joints, self.held))
        asked, scale = self.setting("settotalmass", "-1"), flint.arb(1)
        if asked > 0:
            scale = asked / sum(link.mass for links, _, _ in tops for link in links.values())
        floating = [top for top in tops if "free" in top[2] or (top[2].count("prismatic") > 1 and {*top[2]} & TURNS)]
        moving = [top for top in tops if top[2] or any(joint.kind != "fixed" for joint in top[1])]
        robots = floating or moving or [top for top in tops if any(link.mass > 0 for link in top[0].values())]
        if len(robots) != 1 or len(moving) > 1:
            raise InputError(f"has {len(robots)} bodies that could be the robot, and {len(moving)} that move")
        links, joints, _ = robots[0]
        scaled = [replace(link, mass=link.mass * scale, inertia=link.inertia * scale) for link in links.values()]
        return Urdf({link.name: link for link in scaled}, tuple(joints), next(iter(links)))

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

    def body(self, element: Element, name: str, frame: Placement, parent: str = "") -> None:
        """Read a body and those below it; without a parent it is the base, whose joints to the world do not count."""
        self.count += 1
        own, place = _named(element.attrib, f"body{self.count}", self.bodies), self.placement(_known(element))
        parts = [
            (inner, kind, around, _over(self.classes[kind].get(inner.tag, {}), _known(inner)))
            for inner, kind, around in self.contents(element, name, Placement())
        ]
        geoms = [(given, around) for inner, _, around, given in parts if inner.tag == "geom"]
        solid = _Solid(flint.arb(0), place, flint.arb_mat(3, 3))  # MuJoCo puts a mass there that boundmass asks for
        written = [self.inertial(given) for inner, _, _, given in parts if inner.tag == "inertial"]
        counted = not written if self.from_geoms is None else self.from_geoms
        solids = [each for given, around in geoms if counted for each in self.geom(given, around, own)]
        solid = self.bounded(_together(solids) if solids else [solid, *written][-1], own)
        if own in self.links:
            raise InputError("there are two of this name", element=f'body "{own}"')
        touches = any(  # so that the link has a shape
            given.get("name") in self.paired or any(int(given.get(key, "1")) for key in ("contype", "conaffinity"))
            for given, _ in geoms
        )
        self.links[own] = Link(own, solid.mass, solid.center, solid.inertia, bool(solid.mass > 0), touches)
        joints = [self.joint(inner, given, around, own) for inner, _, around, given in parts if "joint" in inner.tag]
        if parent:
            self.carry(own, parent, frame * place, joints)
        else:
            self.held = [joint.kind for joint, _ in joints]
        for inner, kind, around, _ in parts:
            if inner.tag == "body":
                self.body(inner, kind, around, own)

    def carry(self, body: str, parent: str, place: Placement, joints: list[tuple[Joint, Any]]) -> None:
        """Add what carries a body: its joints, each with a link at its anchor where that is not the body's frame."""
        for joint, anchor in joints:
            if joint.kind not in ("revolute", "prismatic"):
                raise NotReadError(f'joint "{joint.name}", of kind {joint.kind},')
            child = body
            if joint is not joints[-1][0] or any(not part.is_zero() for part in anchor.entries()):
                child = _named({}, f"{body}/{joint.name}", self.bodies)
                self.links[child] = Link(child, flint.arb(0), Placement(), flint.arb_mat(3, 3), False, False, True)
            self.joints.append(replace(joint, parent=parent, child=child, origin=place * joint.origin))
            parent, place = child, Placement(translation=-1 * anchor)
        if parent != body:
            fixed = _named({}, f"{body}/", self.hinges)
            self.joints.append(Joint(fixed, "fixed", parent, body, place, flint.arb_mat(3, 1), None, 0.0))

    def joint(self, element: Element, given: Given, frame: Placement, body: str) -> tuple[Joint, Any]:
        """A joint, whose parent and child are not known yet, and its anchor; ``ref`` is in its origin."""
        name = _named(element.attrib, f"{body}_joint", self.hinges)
        kind = "free" if element.tag == "freejoint" else given.get("type", "hinge")
        slides, reference = kind == "slide", number(given.get("ref", "0"))
        anchor = flint.arb_mat(3, 1) if slides else frame.point(_column(given.get("pos", "0 0 0")))
        axis = frame.rotation * unit(_column(given.get("axis", "0 0 1")))
        armature = float(number(given.get("armature", "0")))
        joint = Joint(name, KINDS.get(kind, kind), "", "", Placement(translation=anchor), axis, None, armature)
        back = joint.motion(-reference * (1 if slides else self.per_angle))
        return replace(joint, origin=joint.origin * back), anchor

    def placement(self, given: Given) -> Placement:
        """A place and an orientation, in any of MuJoCo's forms."""
        form = next((form for form in TURNED if form in given), "quat")
        parts = numbers(given.get(form, "1 0 0 0"), TURNED[form])
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
            return _Solid(mass, center, diagonal(numbers(given.get("diaginertia", "0 0 0"), 3)))
        xx, yy, zz, xy, xz, yz = numbers(given["fullinertia"], 6)
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
            ends = numbers(given["fromto"], 6)
            first, last = flint.arb_mat(3, 1, ends[:3]), flint.arb_mat(3, 1, ends[3:])
            placed, half = Placement(of_z(first - last), (first + last) / 2), dot(first - last, first - last).sqrt() / 2
            size = [size[0], half, half] if kind in ("capsule", "cylinder") else [size[0], size[0], half]
        else:
            placed = self.placement(given)
        volume, squares = SOLIDS[kind](size[0], size[1], size[2], FLAGS[given.get("shellinertia", "false")])
        mass = weight if "mass" in given else weight * volume
        solid = _Solid(mass, frame * placed, diagonal([mass * (sum(squares) - square) for square in squares]))
        return [solid] if volume > SMALLEST and mass > SMALLEST else []

    def bounded(self, solid: _Solid, body: str) -> _Solid:
        """Mass and moments at least as large as asked, and equal moments where no body has them, if that is asked."""
        least, balanced = self.setting("boundinertia"), FLAGS[self.settings.get("balanceinertia", "false")]
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


def _together(solids: list[_Solid]) -> _Solid:
    """All of them as one."""
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
        if key not in KNOWN[element.tag].split() and not key.startswith("sol"):
            raise NotReadError(f"<{element.tag}>: {key}")
    return element.attrib


def _column(text: str) -> Any:
    return flint.arb_mat(3, 1, numbers(text, 3))
