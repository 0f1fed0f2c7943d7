"""The same robot written in another way flies the same plan: planes, axes, base frames, fixed links, split links."""

from __future__ import annotations

import cmath
from dataclasses import dataclass

import numpy as np
import pytest

import floatplan as fp

TIMES = np.linspace(0.0, 0.8, 41)
START, GOAL = {"j1": 0.4, "j2": -0.7, "j3": 0.5}, {"j1": -0.3, "j2": 0.6, "j3": 1.1}
TURN, FINAL = 0.2, 1.7
EFFORT = 2.6  # N m, less than the plan takes without limits


@dataclass(frozen=True)
class Link:
    """A link of the sample: places are complex, horizontal + i vertical, in its own frame, m, kg, kg m^2."""

    name: str
    parent: str | None
    joint: complex
    mass: float
    center: complex
    moment: float


LINKS = (
    Link("trunk", None, 0j, 4.0, 0.05 + 0.02j, 0.06),
    Link("thigh", "trunk", 0.2 - 0.1j, 2.0, -0.15j, 0.02),
    Link("shank", "thigh", 0.05 - 0.3j, 1.0, 0.02 - 0.12j, 0.008),
    Link("arm", "trunk", -0.1 + 0.2j, 1.5, 0.2 + 0j, 0.015),
)
JOINTS = {"thigh": "j1", "shank": "j2", "arm": "j3"}


@dataclass(frozen=True)
class Writing:
    """How the sample is written: everything here leaves the robot what it is."""

    plane: str = "xz"
    flipped: tuple[str, ...] = ()
    base_angle: float = 0.0
    fixed_links: bool = False
    split: bool = False

    def vector(self, place: complex, across: float = 0.0) -> np.ndarray:
        """Return the (3,) vector of a place in the plane, and of a length along the plane's third axis."""
        vector = np.zeros(3)
        horizontal, vertical = ("xyz".index(letter) for letter in self.plane)
        vector[[horizontal, vertical, 3 - horizontal - vertical]] = place.real, place.imag, across
        return vector

    def normal(self, joint: str) -> np.ndarray:
        """Return the axis that turns the horizontal towards the vertical, or the opposite one."""
        axis = np.cross(self.vector(1.0), self.vector(1j))
        return -axis if joint in self.flipped else axis

    def text(self) -> str:
        """Return the URDF."""
        lines = []
        for link in LINKS:
            back = cmath.exp(-1j * self.base_angle) if link.parent is None else 1.0
            lines += self.link(link.name, link.mass, link.center * back, link.moment)
            if link.parent is not None:
                lines.append(self.joint(link))
        return f'<robot name="sample">{"".join(lines)}</robot>'

    def link(self, name: str, mass: float, center: complex, moment: float) -> list[str]:
        if not self.split:
            return [self.body(name, mass, center, moment), *self.marker(name)]
        ends = [center + step for step in (0.3 * (0.1 + 0.04j), -0.7 * (0.1 + 0.04j))]
        masses = (0.7 * mass, 0.3 * mass)
        rest = moment - sum(m * abs(end - center) ** 2 for m, end in zip(masses, ends, strict=True))
        at = 0.03 - 0.05j
        half = self.body(f"{name}_half", masses[1], ends[1] - at, 0.4 * rest)
        return [self.body(name, masses[0], ends[0], 0.6 * rest), half, self.weld(name, f"{name}_half", at)]

    def marker(self, name: str) -> list[str]:
        fixed = [f'<link name="{name}_marker"/>', self.weld(name, f"{name}_marker", 0.07 + 0.1j)]
        return fixed if self.fixed_links else []

    def body(self, name: str, mass: float, center: complex, moment: float) -> str:
        moments = np.diag(moment * (self.vector(0.6 + 0.6j) + np.abs(self.vector(0j, 1.0)))).tolist()
        inertia = f'ixx="{moments[0][0]}" iyy="{moments[1][1]}" izz="{moments[2][2]}" ixy="0" ixz="0" iyz="0"'
        origin = f'<origin xyz="{words(self.vector(center))}"/>'
        return f'<link name="{name}"><inertial>{origin}<mass value="{mass}"/><inertia {inertia}/></inertial></link>'

    def weld(self, parent: str, child: str, at: complex) -> str:
        ends = f'<parent link="{parent}"/><child link="{child}"/>'
        origin = f'<origin xyz="{words(self.vector(at))}"/>'
        return f'<joint name="{child}_weld" type="fixed">{ends}{origin}</joint>'

    def joint(self, link: Link) -> str:
        name, place, turned = JOINTS[link.name], link.joint, 0.0
        if link.parent == "trunk":
            place, turned = place * cmath.exp(-1j * self.base_angle), -self.base_angle
        rotation = words(turned * np.cross(self.vector(1.0), self.vector(1j)))
        ends = f'<parent link="{link.parent}"/><child link="{link.name}"/>'
        limits = f'<limit lower="-2" upper="2" effort="{EFFORT}" velocity="15"/>'
        origin = f'<origin xyz="{words(self.vector(place))}" rpy="{rotation}"/>'
        axis = f'<axis xyz="{words(self.normal(name))}"/>'
        return f'<joint name="{name}" type="revolute">{ends}{origin}{axis}{limits}</joint>'


def words(vector: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in vector)


def flown(tmp_path, writing: Writing) -> dict[str, np.ndarray]:
    """Plan for the sample; return what does not depend on how it is written."""
    path = tmp_path / "robot.urdf"
    path.write_text(writing.text())
    robot = fp.Robot.from_urdf(path, plane=writing.plane)
    flip = np.array([-1.0 if name in writing.flipped else 1.0 for name in robot.joints])
    side = float(np.sign(writing.normal("") @ robot.plane.normal))

    def posture(orientation: float, positions: dict[str, float]) -> fp.Posture:
        own = {name: sign * positions[name] for name, sign in zip(robot.joints, flip, strict=True)}
        return fp.Posture(side * (orientation + writing.base_angle), own)

    problem = fp.Problem(
        robot,
        start=posture(TURN, START),
        goal=posture(FINAL, GOAL),
        flight=fp.Flight(duration=0.8, takeoff=fp.Takeoff("shank"), horizontal_velocity=1.0),
        limits=fp.Limits(torque="urdf"),
    )
    plan = fp.plan(problem)
    assert plan.ok, plan.explanation
    state = plan.at(TIMES)
    return {
        "orientation": side * state.orientation - writing.base_angle,
        "positions": flip * state.positions,
        "torques": flip * state.torques,
        "com": state.com_position,
        "momentum": np.array([side * plan.angular_momentum]),
    }


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("plain"), Writing())


def test_the_torque_limit_is_felt(plain):
    assert 0.99 * EFFORT < np.abs(plain["torques"]).max() <= EFFORT


@pytest.mark.parametrize(
    "writing",
    [
        Writing(plane="yz"),
        Writing(plane="xy"),
        Writing(plane="zx"),
        Writing(flipped=("j2",)),
        Writing(flipped=("j1", "j2", "j3")),
        Writing(base_angle=0.7),
        Writing(fixed_links=True),
        Writing(split=True),
        Writing(plane="zy", flipped=("j3",), base_angle=-2.0, split=True),
    ],
    ids=str,
)
def test_the_same_robot_flies_the_same_plan(tmp_path, plain, writing):
    found = flown(tmp_path, writing)
    for name, expected in plain.items():
        scale = max(1.0, float(np.abs(expected).max()))
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=1e-9 * scale, err_msg=name)
