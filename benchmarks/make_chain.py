"""Write the chain robots of ``urdf/`` from a small table: l, r, m and I of each body.

Usage: ``python benchmarks/make_chain.py [FOLDER]`` (default: the repository's ``urdf/``).

Links lie along their frame's +x axis in the xz plane; the joint axes are -y, so that a positive angle turns x towards
z. Body 0 starts at the foot, the last body ends at the hand.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from yourdfpy import URDF
from yourdfpy.urdf import Inertial, Joint, Limit, Link, Robot

AXIS = (0, -1, 0)
SLENDERNESS = 0.02  # [-] inertia about the link's own axis, as a share of I: a rod, and a physically possible body


@dataclass(frozen=True)
class Body:
    """One row of the table (the paper's Table I): a link and, from body 1 on, its joint's limits."""

    name: str
    l: float  # [m] from the inboard joint (body 0: the foot) to the centre of mass  # noqa: E741
    r: float  # [m] from the centre of mass to the outboard joint (last body: the hand)
    m: float  # [kg]
    I: float  # [kg m^2] about the centre of mass and the plane's normal  # noqa: E741
    lower: float = -math.pi  # [rad]
    upper: float = math.pi  # [rad]
    effort: float = 0.0  # [N m]; 0 where not given
    velocity: float = 0.0  # [rad/s]; 0 where not given


GYMNAST = (
    Body("body0", l=0.2, r=0.2, m=3.0, I=0.16),
    Body("body1", l=0.2, r=0.2, m=2.5, I=0.107),
    Body("body2", l=0.15, r=0.15, m=1.0, I=0.053),
)
ACROBAT = (
    Body("legs", l=0.25, r=0.25, m=4.0, I=0.0833),
    Body("trunk", l=0.25, r=0.25, m=6.0, I=0.125, lower=-2.6, upper=2.6),
)
# A person of 75 kg and 1.80 m who faces +x when upright: masses, centres and radii of gyration of the segments after
# D. A. Winter, Biomechanics and Motor Control of Human Movement, Table 4.1 (both legs and both arms as one); ranges are
# anatomical, rates and torques those of an athlete.
HIGH_JUMPER = (
    Body("shank", l=0.177, r=0.273, m=9.15, I=0.321),
    Body("thigh", l=0.249, r=0.191, m=15.0, I=0.303, lower=-0.05, upper=2.5, effort=450.0, velocity=18.0),
    Body("trunk", l=0.343, r=0.177, m=43.35, I=2.97, lower=-2.2, upper=0.6, effort=500.0, velocity=12.0),
    Body("arms", l=0.307, r=0.393, m=7.5, I=0.342, lower=-3.4, upper=0.6, effort=160.0, velocity=20.0),
)
CHAIN10 = tuple(Body(f"body{i}", l=0.1, r=0.1, m=1.0, I=0.0033) for i in range(11))

CHAINS = {"gymnast": GYMNAST, "acrobat": ACROBAT, "high_jumper": HIGH_JUMPER, "chain10": CHAIN10}


def chain_urdf(name: str, bodies: Sequence[Body]) -> str:
    """Return the URDF text of a chain with the end frames ``foot`` and ``hand``."""
    lengths = [body.l + body.r for body in bodies]
    moving = [
        Joint(
            name=f"q{i}",
            type="revolute",
            parent=bodies[i - 1].name,
            child=bodies[i].name,
            origin=_along_x(lengths[i - 1]),
            axis=np.array(AXIS),
            limit=Limit(effort=body.effort, velocity=body.velocity, lower=body.lower, upper=body.upper),
        )
        for i, body in enumerate(bodies)
        if i > 0
    ]
    ends = [
        Joint(name="to_foot", type="fixed", parent=bodies[0].name, child="foot", origin=_along_x(0.0)),
        Joint(name="to_hand", type="fixed", parent=bodies[-1].name, child="hand", origin=_along_x(lengths[-1])),
    ]
    links = [Link(body.name, _inertial(body)) for body in bodies] + [Link("foot"), Link("hand")]
    urdf = URDF(Robot(name, links=links, joints=moving + ends), build_scene_graph=False, load_meshes=False)
    document = urdf.write_xml()
    etree.indent(document)
    return f"{etree.tostring(document, encoding='unicode')}\n"


def _inertial(body: Body) -> Inertial:
    return Inertial(_along_x(body.l), body.m, np.diag([SLENDERNESS * body.I, body.I, body.I]))


def _along_x(distance: float) -> np.ndarray:
    placement = np.eye(4)
    placement[0, 3] = distance
    return placement


def write_chains(folder: Path) -> None:
    """Write every chain of the table into ``folder``."""
    for name, bodies in CHAINS.items():
        (folder / f"{name}.urdf").write_text(chain_urdf(name, bodies), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    write_chains(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent.parent / "urdf")
