"""Forces on the feet of a jump in the scene, with their friction cones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.robot import Plane
from floatplan.view.jumps import JumpView
from floatplan.view.scene.meshes import Mesh
from floatplan.view.style import rgb_bytes

SHAFT, HEAD, HEAD_LENGTH = 0.012, 0.03, 0.07  # [-] of arrows, in greatest heights of the centre of mass
CORNERS = 32  # [-] of a cone's rim
CONE: dict[str, Any] = {"opacity": 0.3, "side": "double", "cast_shadow": False}


class ForceNodes:
    """An arrow and a cone in a scene for each point that stands, left and right, at instants (N,) of a jump."""

    def __init__(self, server: Any, view: JumpView, times: Array) -> None:
        plane, (height, _) = view.robot.plane, view.largest
        axes = np.stack((plane.horizontal, plane.vertical))
        sizes = {"shaft_radius": SHAFT, "head_radius": HEAD, "head_length": HEAD_LENGTH}
        look = {name: size * height for name, size in sizes.items()}
        self._nodes: list[tuple[Any, Any, Array]] = []
        self._shortest = HEAD_LENGTH * height
        pushes = view.forces(view.jump.at(times)).values()
        for contact, colour, feet, force in zip(
            view.contacts.values(), map(rgb_bytes, view.colours), view.feet(times), pushes, strict=True
        ):
            for name in contact.names:
                places = np.stack((feet.real, feet.imag), axis=1) @ axes + across(view, name) * plane.normal
                own = view.metres_per_newton / len(contact.names) * force
                tips = places + np.stack((own.real, own.imag), axis=1) @ axes
                node = f"/forces/{len(self._nodes)}"
                arrow = server.scene.add_arrows(f"{node}/arrow", np.zeros((1, 2, 3)), colour, **look)
                cone = server.scene.add_mesh_simple(
                    f"{node}/cone", *cone_mesh(plane, view.cone[1]), color=colour, **CONE
                )
                self._nodes.append((arrow, cone, np.stack((places, tips), axis=1)))

    def put(self, index: int) -> None:
        """Show what acts at an instant."""
        for arrow, cone, ends in self._nodes:
            place, tip = ends[index]
            stands = bool(np.isfinite(tip).all())
            _show(cone, stands)
            _show(arrow, stands and float(np.linalg.norm(tip - place)) > self._shortest)
            if stands:
                cone.position, arrow.points = place, ends[index : index + 1].astype(np.float32)


def _show(node: Any, seen: bool) -> None:
    if node.visible != seen:
        node.visible = seen


def across(view: JumpView, name: str) -> float:
    """How far out of the plane a point that stands is, m, along the plane's normal."""
    joint, local = next(stance.points[name] for stance in view.jump.stances if name in stance.points)
    model = view.robot.model
    data = model.createData()
    pin.forwardKinematics(model, data, view.robot.reference.copy())
    return float(data.oMi[joint].act(local) @ view.robot.plane.normal)


def cone_mesh(plane: Plane, edge: complex) -> Mesh:
    """Return corners (k, 3) and triangles (f, 3) of a cone that stands on its tip, m; ``edge`` is one of its sides."""
    angles = np.linspace(0.0, 2 * np.pi, CORNERS, endpoint=False)
    rim = edge.real * (np.cos(angles)[:, None] * plane.horizontal + np.sin(angles)[:, None] * plane.normal)
    here = np.arange(1, CORNERS + 1)
    faces = np.stack((np.zeros_like(here), here, np.roll(here, -1)), axis=1)
    return np.concatenate((np.zeros((1, 3)), rim + edge.imag * plane.vertical)), faces
