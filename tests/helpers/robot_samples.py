"""Robots for tests: URDF text of small chains, and random planar trees with every complication that URDF allows."""

from pathlib import Path

import numpy as np
import pinocchio as pin

URDF_FOLDER = Path(__file__).resolve().parents[2] / "urdf"
CHAIN_NAMES = ("gymnast", "acrobat", "high_jumper", "chain10")

TWO_LINKS = """<robot name="two">
  <link name="a">
    <inertial><origin xyz="0.2 0 0" rpy="0 0 0"/><mass value="2"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial>
  </link>
  <link name="b">
    <inertial><origin xyz="0.1 0 0" rpy="0 0 0"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
  </link>
  <joint name="j" type="revolute">
    <parent link="a"/><child link="b"/><origin xyz="0.4 0 0" rpy="0 0 0"/><axis xyz="0 -1 0"/>
    <limit lower="-2" upper="1.5" effort="10" velocity="20"/>
  </joint>
</robot>
"""


def inertial(mass: float = 1.0, center: str = "0.1 0 0") -> str:
    """Return an ``<inertial>`` element."""
    moments = 'ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"'
    return f'<inertial><origin xyz="{center}"/><mass value="{mass}"/><inertia {moments}/></inertial>'


def joint(name: str, parent: str, child: str, axis: str = "0 1 0", *, kind: str = "continuous", more: str = "") -> str:
    """Return a ``<joint>`` element at x = 0.3."""
    limits = "" if kind in ("continuous", "fixed") else '<limit lower="-1" upper="1" effort="5" velocity="7"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<origin xyz="0.3 0 0"/><axis xyz="{axis}"/>{limits}{more}</joint>'


def robot_text(*elements: str, links: str = "") -> str:
    """Return a robot of ``elements`` and of massive links with the one-letter names in ``links``."""
    bodies = "".join(f'<link name="{name}">{inertial()}</link>' for name in links)
    return f'<robot name="sample">{bodies}{"".join(elements)}</robot>'


def limb(side: str, way: float, name: str, parent: str) -> str:
    """A link half a metre further out, and its joint; left and right mirror each other."""
    origin = f'<origin xyz="{0.1 if parent == "body" else 0.3} {way if parent == "body" else 0} 0"/>'
    limits = '<limit lower="-2.5" upper="2.5" effort="50" velocity="30"/>'
    joint = f'<joint name="{side}_{name}" type="revolute"><parent link="{parent}"/><child link="{side}_{name}_link"/>'
    body = f'<link name="{side}_{name}_link">{inertial(0.6, "0.15 0 0")}</link>'
    return f'{body}{joint}{origin}<axis xyz="0 1 0"/>{limits}</joint>'


PAIR = "".join(
    limb(side, way, "hip", "body") + limb(side, way, "knee", f"{side}_hip_link")
    for side, way in (("left", 0.2), ("right", -0.2))
)


def _arm(name: str, link: str, way: float, effort: float, mass: float, inertia: float) -> str:
    moments = f'ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia / 3}"'
    body = f'<inertial><origin xyz="0 0 {-0.1 * mass}"/><mass value="{mass}"/><inertia {moments}/></inertial>'
    limits = f'<limit lower="-2" upper="2" effort="{effort}" velocity="30"/>'
    return (
        f'<link name="{link}">{body}</link><joint name="{name}" type="revolute"><origin xyz="{way} 0 0"/>'
        f'<parent link="base"/><child link="{link}"/><axis xyz="0 1 0"/>{limits}</joint>'
    )


# a strong motor on a light arm, and a weak one on a heavy arm that is to follow
WEAK_FOLLOWER = robot_text(
    f'<link name="base">{inertial(5.0, "0 0 0")}</link>',
    _arm("a", "light", 0.2, 50.0, 0.1, 0.001),
    _arm("b", "heavy", -0.2, 1.0, 2.0, 0.03),
)


class RandomTree:
    """A random tree in one plane: turned frames, both signs of axis; fixed, sliding and off-plane joints between."""

    def __init__(self, seed: int, normal: str = "y", joints: int = 6) -> None:
        self.generator = np.random.default_rng(seed)
        self.normal = np.eye(3)["xyz".index(normal)]
        self.placements = {"link0": pin.SE3.Identity()}
        self.locked: dict[str, float] = {}
        self.elements = [f'<link name="link0">{self._inertial()}</link>']
        for number in range(1, joints + 1):
            self._add_joint(number)

    @property
    def text(self) -> str:
        """The URDF; its posture with the locked joints at their positions and all others at zero is the reference."""
        return f'<robot name="random">{"".join(self.elements)}</robot>'

    def _add_joint(self, number: int) -> None:
        kinds = ("revolute", "revolute", "continuous", "fixed", "prismatic", "off-plane")
        kind = "revolute" if number <= 2 else str(self.generator.choice(kinds))
        parent = f"link{self.generator.integers(max(0, number - 3), number)}"
        rotation = pin.Quaternion(*_unit(self.generator.normal(size=4))).toRotationMatrix()
        frame = pin.SE3(rotation, self.generator.uniform(-0.4, 0.4, 3))  # of the joint, in the root link
        axis = frame.rotation.T @ (self.normal * self.generator.choice((-1.0, 1.0)))
        moved = pin.SE3.Identity()
        if kind in ("off-plane", "prismatic"):
            position = float(self.generator.uniform(-1.0, 1.0))
            self.locked[f"joint{number}"] = position
            axis = _unit(self.generator.normal(size=3))
            turned = pin.AngleAxis(position, axis).matrix()
            moved = pin.SE3(np.eye(3), position * axis) if kind == "prismatic" else pin.SE3(turned, np.zeros(3))
        self._write(number, kind, parent, self.placements[parent].actInv(frame), axis)
        self.placements[f"link{number}"] = frame * moved

    def _write(self, number: int, kind: str, parent: str, origin: pin.SE3, axis: np.ndarray) -> None:
        written = "revolute" if kind == "off-plane" else kind
        self.elements.append(
            f'<link name="link{number}">{self._inertial()}</link>'
            f'<joint name="joint{number}" type="{written}"><parent link="{parent}"/><child link="link{number}"/>'
            f'<origin xyz="{_words(origin.translation)}" rpy="{_words(pin.rpy.matrixToRpy(origin.rotation))}"/>'
            f'<axis xyz="{_words(axis)}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )

    def _inertial(self) -> str:
        mass, center = self.generator.uniform(0.5, 2.0), self.generator.uniform(-0.2, 0.2, 3)
        points = self.generator.uniform(-0.2, 0.2, (5, 3))
        xx, yy, zz = ((points**2).sum() - (points**2).sum(axis=0)) * mass / 5
        xy, xz, yz = (-(points[:, i] * points[:, j]).sum() * mass / 5 for i, j in ((0, 1), (0, 2), (1, 2)))
        moments = f'ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"'
        turned = f'xyz="{_words(center)}" rpy="{_words(self.generator.uniform(-3, 3, 3))}"'
        return f'<inertial><origin {turned}/><mass value="{mass}"/><inertia {moments}/></inertial>'


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _words(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


GYMNAST = (URDF_FOLDER / "gymnast.urdf").read_text()
