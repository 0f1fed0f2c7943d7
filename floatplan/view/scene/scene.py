"""The scene: a flight or a jump in three dimensions, with the robot's meshes, one page that works without a network.

The page is viser's player. World axes are those of the root link at orientation zero; the plane of the motion contains
the base's origin. The robot has one node for each body of the tree, and all that is shown of the body hangs from it.
"""

from __future__ import annotations

import contextlib
import html
import io
import math
import re
import threading
from collections.abc import Iterable, Iterator
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from floatplan.arrays import Array, ComplexArray
from floatplan.errors import import_optional
from floatplan.files import write_atomically
from floatplan.jumps.jump_motion import JumpMotion
from floatplan.plans.plan import Plan
from floatplan.plans.trajectory import Trajectory
from floatplan.problem.parts import HalfPlane, Obstacle
from floatplan.robot import Plane
from floatplan.robot.robot import Robot
from floatplan.robot.shapes.solids import frame_position
from floatplan.view import outlines
from floatplan.view.jumps import flies_in_space, footing
from floatplan.view.scene import meshes
from floatplan.view.solids import CAMERA, obstacle_solid, rendered_solids
from floatplan.view.style import PALETTE, palette, rgb_bytes

if TYPE_CHECKING:
    from floatplan.motion.spatial.bodies import BodyPoses

Colour = tuple[int, int, int]
ARROW = {"shaft_radius": 0.012, "head_radius": 0.03, "head_length": 0.07}  # [-] in greatest heights of the CM
_STDOUT_LOCK = threading.Lock()  # Python's standard output is one for all threads
LINES: dict[str, Any] = {"thickness": 2.0, "thickness_units": "screen"}
GRID: dict[str, Any] = {"cell_size": 0.25, "cell_color": (236, 236, 236), "section_color": (214, 214, 214)}


def write_scene(plan: Trajectory, path: str | Path) -> Path:
    """Write the scene of a plan or a jump as one HTML file, whole or not at all.

    Raises
    ------
    InputError
        viser is not installed, or a mesh of the robot cannot be read.
    """
    return write_atomically(path, scene(plan))


def scene(plan: Trajectory) -> str:
    """Return the scene of a plan or a jump as HTML; errors as :func:`write_scene`."""
    viser = import_optional("viser", name="viser", element="scene", extra="view")
    frames = int(np.ceil(plan.duration * 60.0)) + 1  # at 60 Hz, as screens show
    times = np.linspace(0.0, plan.duration, frames)
    poses = outlines.moving_bodies(plan, times)
    with silence():  # a local server: viser records what is sent to it
        server = viser.ViserServer(host="127.0.0.1", verbose=False)
    try:
        bodies = RobotNodes(server, "/robot", plan.robot)
        if not bodies.add_meshes():
            bodies.add_solids()
        obstacles: list[tuple[Any, Plane | None, Obstacle]] = []
        momentum = None
        if flies_in_space(plan):
            _add_space(server, plan)
            if isinstance(plan, Plan):
                momentum = _add_momentum(server, plan)
            for index, obstacle in enumerate(plan.whole_problem.obstacles):
                if obstacle.bounded:
                    obstacles.append((add_obstacle(server, index, obstacle, obstacle_solid(obstacle)), None, obstacle))
        else:
            obstacles = _add_plane(server, plan)
        forces = ForceNodes(server, plan, times) if isinstance(plan, JumpMotion) else None
        serializer = server.get_scene_serializer()
        for index, time in enumerate(times.tolist()):
            if index:  # the page's clock is the motion's
                serializer.insert_sleep(plan.duration / (frames - 1))
            bodies.put(poses, index)
            if forces is not None:
                forces.put(index)
            if momentum is not None:
                momentum.position = plan.state(time).com_position
            for node, plane, obstacle in obstacles:
                move_obstacle(node, plane, obstacle, time)
        return headed(
            serializer.as_html(),
            f"floatplan: {plan.problem.name}",
            """@media (max-aspect-ratio: 4/5) {
  div:has(> canvas) { height: 125vw !important; margin-top: calc(50vh - 70vw); position: relative; }
  div:has(> canvas) div:has(> canvas) { height: 100% !important; margin-top: 0; }
}""",
        )
    finally:
        with silence():
            server.stop()


def _add_plane(server: Any, plan: Trajectory) -> list[tuple[Any, Plane | None, Obstacle]]:
    """Add the surroundings of a flight in a plane; return nodes of obstacles."""
    plane = plan.robot.plane
    placed = outlines.postures(plan, outlines.snapshot_times(plan))
    low, high = outlines.picture_box(plan, placed)
    obstacles: list[tuple[Any, Plane | None, Obstacle]] = []
    for index, obstacle in enumerate(plan.whole_problem.obstacles):
        slab = obstacle_slab(plan, obstacle, low, high)
        obstacles.append((add_obstacle(server, index, obstacle, slab), plane, obstacle))
    look(server, plane, low, high, aside=0.72, above=0.12)
    add_grounds(server, plane, low, high, outlines.ground_lines(plan, placed))
    placed = outlines.postures(plan, np.linspace(0.0, plan.duration, 361 if isinstance(plan, JumpMotion) else 121))
    _add_trails(server, plan, [world_points(plane, path) for path in (placed.com, placed.takeoff, placed.landing)])
    return obstacles


def _add_space(server: Any, plan: Trajectory) -> None:
    """Add the surroundings of a motion in space."""
    look_in_space(server, plan)
    for index, line in enumerate(outlines.grids(plan)):
        server.scene.add_line_segments(f"/ground/{index}", line[None], GRID["section_color"], **LINES)
    times = np.linspace(0.0, plan.duration, 361 if isinstance(plan, JumpMotion) else 121)
    _add_trails(server, plan, outlines.paths_in_space(plan, times))


def _add_momentum(server: Any, plan: Plan) -> Any:
    """Add the angular momentum of a flight in space, an arrow at the CM; return its node."""
    h = np.asarray(plan.angular_momentum)
    size = outlines.robot_size(plan)
    tip = 0.5 * size * h / (np.linalg.norm(h) or 1.0)  # half as long as the robot
    ends = np.stack((np.zeros(3), tip))[None].astype(np.float32)
    look = {name: size * length / 2 for name, length in ARROW.items()}
    return server.scene.add_arrows("/momentum", ends, rgb_bytes(PALETTE.ink), visible=bool(h.any()), **look)


def headed(page: str, title: str, style: str, script: str = "") -> str:
    """Return viser's page with a title, a style, a script, and names for screen readers, which few elements have.

    They replace its own title; of a page without one they are at its head.
    """
    names = files("floatplan.view.scene").joinpath("names.js").read_text("utf-8")
    head = f"<title>{html.escape(title)}</title>\n<style>{style}</style><script>{names}{script}</script>"
    page, replaced = re.subn("<title>[^<]*</title>", lambda _: head, page, count=1)
    return page if replaced else re.sub("<head[^>]*>", lambda tag: tag[0] + head, page, count=1)


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Print nothing; one thread at a time, or the last would not give back what the first took."""
    with _STDOUT_LOCK, contextlib.redirect_stdout(io.StringIO()):
        yield


def look(server: Any, plane: Plane, low: complex, high: complex, aside: float, above: float) -> None:
    """Light the scene, and look at a box, m, from one side of the plane and from above, in sizes of the box."""
    size = abs(high - low)
    middle = world_points(plane, (low + high) / 2)
    across = np.cross(plane.horizontal, plane.vertical)
    _view(server, plane.vertical, middle, middle + size * (aside * across + above * plane.vertical))


def look_in_space(server: Any, plan: Trajectory, distance: float = 1.7) -> None:
    """Light the scene, and look at a motion in space from where pictures do, on open pages too.

    The eye is at a distance, in radii of the ball around all of the motion, from its centre.
    """
    centre, radius = outlines.ball(plan)
    eye = centre + distance * radius * CAMERA.toward
    _view(server, np.array([0.0, 0.0, 1.0]), centre, eye, 1.2)
    for client in server.get_clients().values():
        client.camera.position = tuple(eye)
        client.camera.look_at = tuple(centre)


def _view(server: Any, up: Array, middle: Array, eye: Array, ambient: float = 1.6) -> None:
    server.scene.set_up_direction(tuple(up))
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/lights/ambient", intensity=ambient)
    server.initial_camera.position = tuple(eye)
    server.initial_camera.look_at = tuple(middle)


def add_grounds(
    server: Any, plane: Plane, low: complex, high: complex, lines: list[tuple[float, complex, complex]]
) -> None:
    """Add the ground of :func:`ground_lines` as grids around a box, m."""
    size = abs(high - low)
    across = np.cross(plane.horizontal, plane.vertical)
    letters = "".join("xyz"[int(np.argmax(np.abs(axis)))] for axis in (plane.horizontal, across))
    for index, (level, *_) in enumerate(lines):
        position = world_points(plane, complex((low.real + high.real) / 2, level))
        server.scene.add_grid(f"/ground/{index}", 3 * size, 2 * size, plane=letters, position=position, **GRID)


def add_obstacle(server: Any, index: int, obstacle: Obstacle, slab: meshes.Mesh) -> Any:
    """Add an obstacle as a solid: that of :func:`obstacle_slab`, or in space its own; return its node."""
    flat = not obstacle.bounded
    colour = (226, 222, 212) if flat else (150, 150, 150)  # sand and stone
    look: dict[str, Any] = {"color": colour, "opacity": 0.85, "flat_shading": True}
    return server.scene.add_mesh_simple(f"/obstacles/{index}", *slab, cast_shadow=not flat, **look)


def move_obstacle(node: Any, plane: Plane | None, obstacle: Obstacle, instant: float) -> None:
    """Put an obstacle that moves, comes or goes where it is at an instant of the flight, s; no plane is in space."""
    if obstacle.window is not None or any(obstacle.velocity):
        low, high = obstacle.window or (-np.inf, np.inf)
        if plane is None:
            node.position = instant * np.array(obstacle.velocity)
        else:
            node.position = world_points(plane, complex(*obstacle.velocity) * instant)
        node.visible = bool(low <= instant <= high)


def _add_trails(server: Any, plan: Trajectory, paths: Iterable[Array]) -> None:
    """Add paths (N, 3) of the centre of mass, and of the frames that take off and land."""
    names = dict.fromkeys((plan.whole_problem.takeoff.frame, plan.whole_problem.landing.frame))
    for index, (name, path, colour) in enumerate(zip(("CM", *names), paths, PALETTE.trails, strict=False)):
        pairs = np.stack((path[:-1], path[1:]), axis=1)
        server.scene.add_line_segments(f"/trails/{index}", pairs, rgb_bytes(colour), **LINES)
        server.scene.add_label(f"/trails/{index}/name", name, position=pairs[0, 0])


def obstacle_slab(plan: Trajectory, obstacle: Obstacle, low: complex, high: complex) -> meshes.Mesh:
    """Return corners (k, 3) and triangles (f, 3) of an obstacle at t = 0, extruded across the plane, m.

    A half-plane is as long as the box from ``low`` to ``high`` and longer, and as wide as the robot is large.
    """
    size = outlines.robot_size(plan)
    plane = plan.robot.plane
    slabs: list[meshes.Mesh] = []
    for piece in obstacle.pieces:
        if not isinstance(piece, HalfPlane):
            outline = outlines.obstacle_outlines(piece, 0.0, 0.0)[0]
            slabs.append(prism(plane, outline, 0.4 * size))  # narrower than the robot, which stays visible behind it
            continue
        normal = complex(*piece.normal) / abs(complex(*piece.normal))
        point = complex(*piece.point)
        reach = abs(high - low) / 2
        below = -0.016 * size * normal  # a thin slab
        middle = (((low + high) / 2 - point) / (1j * normal)).real  # of the box along the edge
        ends = point + 1j * normal * (middle + reach * np.array([1.0, -1.0]))
        slabs.append(prism(plane, np.concatenate((ends, ends[::-1] + below)), size))
    return meshes.joined(slabs)


def prism(plane: Plane, corners: ComplexArray, width: float) -> meshes.Mesh:
    """Return corners (2 k, 3) and triangles of a convex polygon (k,) extruded across the plane, m."""
    count = len(corners)
    aside = 0.5 * width * plane.normal
    points = world_points(plane, corners)
    here = np.arange(count)
    there = (here + 1) % count
    sides = [
        np.stack((here, there, here + count), axis=1),
        np.stack((there, there + count, here + count), axis=1),
    ]
    fan = np.stack((np.zeros(count - 2, dtype=np.int64), here[1:-1], here[2:]), axis=1)
    faces = np.concatenate((*sides, fan[:, ::-1], fan + count))
    both = np.concatenate((faces, faces[:, ::-1]))  # whichever way round the polygon goes, it is seen from outside
    return np.concatenate((points - aside, points + aside)), both


def world_points(plane: Plane, positions: ComplexArray | complex) -> Array:
    """Positions (...) in the plane, horizontal + i vertical, as points (..., 3)."""
    positions = np.asarray(positions)
    return np.asarray(positions.real[..., None] * plane.horizontal + positions.imag[..., None] * plane.vertical)


def plane_position(plane: Plane, eye: Array, point: Array) -> complex | None:
    """Position where the line from an eye (3,) through a point (3,) meets the plane; None where it never does."""
    aside = np.cross(plane.horizontal, plane.vertical)
    ray = point - eye
    slope = float(ray @ aside)
    if abs(slope) < 1e-6 * float(np.linalg.norm(ray)):
        return None
    met = eye - (eye @ aside) / slope * ray
    return complex(met @ plane.horizontal, met @ plane.vertical)


def quaternions(plane: Plane, angles: Array) -> Array:
    """Quaternions (..., 4), w x y z, of angles (...) about the normal."""
    sines = np.sin(angles / 2)[..., None] * plane.normal
    return np.concatenate((np.cos(angles / 2)[..., None], sines), axis=-1)


class RobotNodes:
    """A robot in a scene: one node for each body, and on these what is shown of its links."""

    def __init__(self, server: Any, name: str, robot: Robot) -> None:
        self.name = name
        self._server = server
        self._robot = robot
        self._is_planar = robot.in_plane is not None
        self.root = server.scene.add_frame(name, show_axes=False)
        count = len(robot.tree.mass) if self._is_planar else robot.model.njoints - 1
        self.frames = [server.scene.add_frame(f"{name}/{body}", show_axes=False) for body in range(count)]
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, robot.reference)
        self._placements = data.oMi  # of the model's joints at zero

    def _resting(self, link: str) -> tuple[int, Array]:
        """Return the body of a link, and the transform (4, 4) into its frame from the root link's, joints at zero."""
        robot = self._robot
        if not self._is_planar:
            body, _ = frame_position(robot.model, robot.joint_tree, link)
            return body - 1, self._placements[body].inverse().homogeneous
        poses = self._resting_poses
        body = robot.layout.body_of[link]
        root = robot.frames[robot.tree.names[0]]
        origin = world_points(robot.plane, poses.places[0, body] - poses.points([0], [root.local])[0, 0])
        back = pin.exp3(-float(poses.angles[0, body]) * robot.plane.normal)
        return body, pin.SE3(back, -back @ origin).homogeneous

    @cached_property
    def _resting_poses(self) -> outlines.Poses:
        resting = np.zeros((1, len(self._robot.joints)))
        return outlines.body_poses(self._robot, np.zeros(1), resting, np.zeros(1, dtype=np.complex128))

    def add_solids(self, colour: Colour | None = None, opacity: float | None = None) -> list[tuple[int, Any]]:
        """Draw the links as solids, in one colour or in those of all pictures; return segments with their nodes.

        The solids of a segment on one body are one mesh.
        """
        colours = palette(len(self._robot.joints) + 1)
        groups = dict[tuple[int, int], list[meshes.Mesh]]()
        for solid in rendered_solids(self._robot):
            body, into_body = self._resting(solid.link)
            placed = into_body @ self._placements[solid.body].homogeneous
            points = solid.points @ placed[:3, :3].T + placed[:3, 3]
            groups.setdefault((body, solid.segment), []).append((points, solid.faces))
        nodes = []
        for (body, segment), solids in groups.items():
            look = {"color": colour or rgb_bytes(colours[segment]), "opacity": opacity, "flat_shading": True}
            name = f"{self.name}/{body}/solids{segment}"
            nodes.append((segment, self._server.scene.add_mesh_simple(name, *meshes.joined(solids), **look)))
        return nodes

    def add_meshes(self, size: float | None = None, share: float = 0.2) -> bool:
        """Draw the links as the URDF does, as fine as a robot of a size, m, shows it; return whether it does.

        The links of one body and one colour are one mesh, with a share of its triangles, fewest where it is flat, but
        at least 200. Without a size all are shown as they are.
        """
        robot = self._robot
        scene = self._server.scene
        model = meshes.visual_model(robot)
        if model is None:
            return False
        resting = np.zeros(len(robot.joints))
        angles = meshes.joint_angles(robot, resting)
        model.update_cfg(np.array([angles[name] for name in model.actuated_joint_names]))
        groups: dict[tuple[int, Colour], list[meshes.Mesh]] = {}
        for number, (geometry, mesh) in enumerate(model.scene.geometry.items()):
            link = model.scene.graph.transforms.parents[geometry]
            body, into_body = self._resting(link)
            placed = mesh.copy()
            placed.apply_transform(into_body @ model.get_transform(geometry))
            colour = meshes.uniform_colour(placed)
            if colour is None or size is None:
                scene.add_mesh_trimesh(f"{self.name}/{body}/mesh{number}", placed)
            else:
                groups.setdefault((body, colour), []).append((placed.vertices, placed.faces))
        for number, ((body, colour), links) in enumerate(groups.items()):
            # 0.005 of the robot's reach: a pixel of a flight that fills a small window
            vertices, faces = meshes.coarser(*meshes.joined(links), 0.005 * (size or 0.0))
            count = max(math.ceil(share * len(faces)), 200)
            name = f"{self.name}/{body}/links{number}"
            scene.add_mesh_simple(name, *meshes.fewer(vertices, faces, count), color=colour)
        return True

    def add_grips(self, shapes: outlines.Postures, reach: float, colour: Colour) -> dict[int, Any]:
        """Add handles to drag, by segments: nodes at that end of a link which is farthest from its joint."""
        robot = self._robot
        candidates = []
        capsules = outlines.rendered_capsules(robot)
        for capsule, segment in zip(capsules, shapes.segment.tolist(), strict=True):
            candidates.append((segment, capsule.body, capsule.start))
            candidates.append((segment, capsule.body, capsule.end))
        candidates.sort(key=lambda candidate: -abs(candidate[2]))
        grips: dict[int, Any] = {}
        for segment, body, end in candidates:
            if segment not in grips:
                look = {"color": colour, "position": world_points(robot.plane, end)}
                name = f"{self.name}/{body}/grip{segment}"
                radius = 0.035 * reach  # small next to the robot, large enough for a finger
                grips[segment] = self._server.scene.add_icosphere(name, radius, subdivisions=1, **look)
        return grips

    def put(self, poses: outlines.Poses | BodyPoses, index: int) -> None:
        """Put the bodies where they are at an instant."""
        if isinstance(poses, outlines.Poses):
            points = world_points(self._robot.plane, poses.places[index])
            rotations = quaternions(self._robot.plane, poses.angles[index])
        else:
            points = poses.places[index, 1:]
            rotations = Rotation.from_matrix(poses.rotations[index, 1:]).as_quat(scalar_first=True)
        for frame, point, rotation in zip(self.frames, points, rotations, strict=True):
            frame.position = point
            frame.wxyz = rotation


class ForceNodes:
    """An arrow in a friction cone for each contact point, left and right, at instants (N,) of a jump."""

    def __init__(self, server: Any, jump: JumpMotion, times: Array) -> None:
        standing = footing(jump)
        contacts = standing.contacts.values()
        self._nodes = list[tuple[Any, Any, Array, Array]]()
        look = {name: size * jump.height for name, size in ARROW.items()}
        scale = standing.metres_per_newton * max(len(contact.names) for contact in contacts)
        state = jump.at(times)
        forces = jump.forces(times)
        vertices = standing.cone_in_world
        tip = len(vertices) - 1
        here = np.arange(tip - 1)
        faces = np.stack((here, here + 1, np.full_like(here, tip)), axis=1)
        nodes = server.scene
        for contact, colour in zip(contacts, standing.colours.values(), strict=True):
            rgb = rgb_bytes(colour)
            for name in contact.names:
                path = f"/forces/{name}"
                cone = nodes.add_mesh_simple(f"{path}/cone", vertices, faces, color=rgb, opacity=0.3, side="double")
                arrow = nodes.add_arrows(f"{path}/arrow", np.zeros((1, 2, 3)), rgb, **look)
                self._nodes.append((arrow, cone, state.points[name], scale * forces[name]))

    def put(self, index: int) -> None:
        """Show the forces at an instant; those shorter than an arrow's head are left out."""
        for arrow, cone, points, forces in self._nodes:
            point = points[index]
            force = forces[index]
            arrow.visible = bool(np.linalg.norm(force) > arrow.head_length)
            cone.visible = bool(np.isfinite(point).all())
            if cone.visible:
                cone.position = point
                arrow.position = point
                arrow.points = np.stack((np.zeros(3), force))[None].astype(np.float32)
