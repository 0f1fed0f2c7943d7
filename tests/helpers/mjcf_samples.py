"""Random MJCF models, small, with many features crossed: what the reader is compared with MuJoCo on."""

from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
import numpy.typing as npt

SOLIDS = ("sphere", "capsule", "cylinder", "box", "ellipsoid")


def words(numbers: npt.ArrayLike) -> str:
    return " ".join(repr(round(float(number), 4)) for number in np.atleast_1d(numbers))


class RandomModel:
    """A robot with a floating base, of bodies with several joints, geoms of all kinds, classes and frames."""

    def __init__(self, seed: int, *, planar: bool = False, features: float = 0.5) -> None:
        self.rng = np.random.default_rng(seed)
        self.planar, self.features = planar, features
        self.count = 0
        self.root = Element("mujoco")
        self.classes = ["main"]
        self._compiler()
        self._defaults(SubElement(self.root, "default"), 0)
        world = SubElement(self.root, "worldbody")
        if self.maybe():
            scenery = SubElement(world, "body", name="scenery", pos=self.vector(1.0))
            SubElement(scenery, "geom", type="box", size="0.2 0.3 0.4", group="0")
        if self.maybe():
            world = SubElement(world, "frame", self.placement(planar))
        self._body(world, 0)

    @property
    def xml(self) -> bytes:
        content: bytes = tostring(self.root)
        return content

    def maybe(self, probability: float | None = None) -> bool:
        return bool(self.rng.random() < (self.features if probability is None else probability))

    def vector(self, scale: float, count: int = 3) -> str:
        return words(self.rng.uniform(-scale, scale, count))

    def angle(self) -> float:
        return float(self.rng.uniform(-2, 2) * (180 / np.pi if self.degrees else 1.0))

    def _compiler(self) -> None:
        rng, given = self.rng, {}
        self.degrees = True
        if self.maybe():
            given["angle"] = str(rng.choice(["degree", "radian"]))
            self.degrees = given["angle"] == "degree"
        self.sequence = "xyz"
        if self.maybe():
            self.sequence = given["eulerseq"] = "".join(rng.choice(list("xyzXYZ"), 3))
        if self.maybe(0.3):
            given["inertiafromgeom"] = str(rng.choice(["true", "auto"]))
        if self.maybe(0.3):
            given["inertiagrouprange"] = "0 3"
        if self.maybe(0.3):
            given["boundmass"], given["boundinertia"] = words(rng.uniform(0, 1, 1)), words(rng.uniform(0, 0.05, 1))
        if self.maybe(0.3):
            given["balanceinertia"] = "true"
        if self.maybe(0.3):
            given["settotalmass"] = words(rng.uniform(1, 30, 1))
        self.balanced = "balanceinertia" in given
        SubElement(self.root, "compiler", given)

    def _defaults(self, element: Element, depth: int) -> None:
        for _ in range(int(self.rng.integers(0, 2))):
            given = self.solid()
            given.pop("fromto", None)
            if self.maybe(0.3):
                given |= self.orientation()
            SubElement(element, "geom", given)
        if self.maybe():
            SubElement(element, "joint", {"armature": words(self.rng.uniform(0, 1, 1)), "damping": "1"})
        for _ in range(int(self.rng.integers(0, 3 - depth))):
            self.classes.append(f"class{len(self.classes)}")
            self._defaults(SubElement(element, "default", {"class": self.classes[-1]}), depth + 1)

    def orientation(self) -> dict[str, str]:
        rng = self.rng
        form = rng.choice(["quat", "axisangle", "xyaxes", "zaxis", "euler"])
        angles = [self.angle() for _ in range(3)]
        numbers = {
            "quat": rng.normal(size=4),
            "axisangle": [*rng.normal(size=3), angles[0]],
            "xyaxes": rng.normal(size=6),
            "zaxis": rng.choice([rng.normal(size=3), np.array([0, 0, -2.0]), np.array([0, 0, 1.0])]),
            "euler": angles,
        }
        return {str(form): words(numbers[str(form)])}

    def placement(self, level: bool = False) -> dict[str, str]:
        given = {"pos": self.vector(0.5)} if self.maybe(0.8) else {}
        if level:
            return given | ({"axisangle": words([0, 1, 0, self.angle()])} if self.maybe() else {})
        return given | (self.orientation() if self.maybe() else {})

    def solid(self) -> dict[str, str]:
        rng = self.rng
        given = {"type": str(rng.choice(SOLIDS)), "size": words(rng.uniform(0.05, 0.3, 3))}
        if self.maybe():
            given["mass"] = words(rng.uniform(0.1, 3, 1))
        elif self.maybe():
            given["density"] = words(rng.uniform(100, 2000, 1))
        if self.maybe(0.3):
            given["shellinertia"] = "true"
        if self.maybe(0.3):
            given["group"] = str(rng.integers(0, 6))
        return given

    def _geom(self, body: Element, **more: str) -> None:
        given = self.solid() | more | ({"class": str(self.rng.choice(self.classes))} if self.maybe() else {})
        if self.maybe(0.3):
            given.pop("mass", None)
        if given["type"] != "sphere" and self.maybe(0.4):
            given["fromto"] = self.vector(0.4, 6)
        else:
            given |= self.placement()
        SubElement(body, "geom", given)

    def _joints(self, body: Element, depth: int) -> None:
        if depth == 0:
            if not self.planar or self.maybe():
                SubElement(body, "freejoint", name="root")
                return
            for name, kind, axis in (("x", "slide", "1 0 0"), ("z", "slide", "0 0 1"), ("turn", "hinge", "0 1 0")):
                SubElement(body, "joint", name=name, type=kind, axis=axis, ref=words(self.rng.uniform(-2, 2, 1)))
            return
        for _ in range(int(self.rng.integers(0, 4))):
            self.count += 1
            given = {"name": f"joint{self.count}"}
            given["axis"] = str(self.rng.choice(["0 1 0", "0 -2 0"])) if self.planar else self.vector(1.0)
            if self.maybe(0.8):
                given["pos"] = self.vector(0.3)
            if self.maybe():
                given["ref"] = words([self.angle()])
            if not self.planar and self.maybe(0.3):
                given["type"] = "slide"
            if self.maybe():
                given["class"] = str(self.rng.choice(self.classes))
            SubElement(body, "joint", given)

    def _inertial(self, body: Element) -> None:
        rng, given = self.rng, {"mass": words(self.rng.uniform(0.1, 3, 1)), "pos": self.vector(0.2)}
        moments = rng.uniform(0.1, 0.18, 3) * (rng.choice([1, 3], 3) if self.balanced else 1)
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        full = turned @ np.diag(moments) @ turned.T
        if self.maybe():
            given["fullinertia"] = words(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        else:
            given |= {"diaginertia": words(moments)} | (self.orientation() if self.maybe() else {})
        SubElement(body, "inertial", given)

    def _body(self, parent: Element, depth: int) -> None:
        given = {"name": f"body{len(self.root.findall('.//body'))}"} | self.placement(self.planar)
        if self.maybe():
            given["childclass"] = str(self.rng.choice(self.classes))
        body = SubElement(parent, "body", given)
        self._joints(body, depth)
        if self.maybe(0.4):
            self._inertial(body)
        around = SubElement(body, "frame", self.placement(self.planar)) if self.maybe() else body
        if around is not body and self.maybe():
            around.set("childclass", str(self.rng.choice(self.classes)))
            around = SubElement(around, "frame", self.placement(self.planar)) if self.maybe() else around
        if depth and around is not body:
            self._joints(around, depth)
        self._geom(body, group="0")  # MuJoCo takes no body that moves and has no mass
        for _ in range(int(self.rng.integers(0, 3))):
            self._geom(around if self.maybe() else body)
        if depth < 3:
            for _ in range(int(self.rng.integers(1, 3))):
                self._body(around if self.maybe() else body, depth + 1)
