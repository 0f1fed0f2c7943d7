"""The scene: a flight in three dimensions, with the robot's own meshes, as one page that works without a network.

The page is viser's player. World axes are those of the root link at orientation zero; the plane of the motion is drawn
where the base is.
"""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from floatplan.arrays import Array, ComplexArray, IntArray
from floatplan.errors import import_optional
from floatplan.files import write_atomically
from floatplan.plans.plan import Plan
from floatplan.problem.parts import HalfPlane, Obstacle
from floatplan.robot import Plane
from floatplan.view.figures.snapshots import picture_box, snapshot_times
from floatplan.view.postures import body_poses, com_path, postures, robot_size
from floatplan.view.scene.bodies import FINE_SECTIONS, Bodies, in_space
from floatplan.view.style import TRAILS, rgb_bytes
from floatplan.view.surroundings import ground_lines, obstacle_outlines

_STDOUT_LOCK = threading.Lock()  # Python's standard output is one for all threads
POSE_RATE = 60.0  # [Hz] of the page
SLAB = 0.016  # [-] thickness of a half-plane as drawn, in sizes of the robot; it is one size wide
WIDTH = 0.4  # [-] width of other obstacles, in sizes of the robot
STONE, SAND = (150, 150, 150), (226, 222, 212)
GRID: dict[str, Any] = {"cell_size": 0.25, "cell_color": (236, 236, 236), "section_color": (214, 214, 214)}


def write_scene(plan: Plan, path: str | Path) -> Path:
    """Write the scene of a plan as one HTML file, whole or not at all.

    Raises
    ------
    InputError
        viser is not installed, or a mesh of the robot cannot be read.
    """
    return write_atomically(path, scene(plan))


def scene(plan: Plan) -> str:
    """Return the scene of a plan as HTML; errors as :func:`write_scene`."""
    viser = import_optional("viser", name="viser", element="scene", extra="view")
    frames = int(np.ceil(plan.duration * POSE_RATE)) + 1
    times = np.linspace(0.0, plan.duration, frames)
    poses = body_poses(plan.robot, plan.orientation(times), plan.joint_motion(times)[0], com_path(plan, times))
    placed = postures(plan, snapshot_times(plan))
    low, high = picture_box(plan, placed)
    with _server(viser) as server:
        bodies = Bodies(server, "/robot", plan.robot)
        if not bodies.add_meshes():
            bodies.add_capsules(placed, sections=FINE_SECTIONS)
        obstacles = plan.problem.obstacles
        slabs = [obstacle_slab(plan, obstacle, low, high) for obstacle in obstacles]
        nodes = [add_obstacle(server, index, *each) for index, each in enumerate(zip(obstacles, slabs, strict=True))]
        look(server, plan.robot.plane, low, high, aside=0.72, above=0.12)
        add_grounds(server, plan.robot.plane, low, high, ground_lines(placed))
        _add_trails(server, plan)
        serializer = server.get_scene_serializer()
        for index in range(frames):
            bodies.put(poses, index)
            for node, obstacle in zip(nodes, obstacles, strict=True):
                move_obstacle(node, plan.robot.plane, obstacle, float(times[index]))
            if index < frames - 1:  # the page's clock is the flight's: from takeoff to landing
                serializer.insert_sleep(plan.duration / (frames - 1))
        return str(serializer.as_html())


@contextlib.contextmanager
def _server(viser: ModuleType) -> Iterator[Any]:
    """A local server that prints nothing: viser records what is sent to it."""
    with silence():
        server = viser.ViserServer(host="127.0.0.1", verbose=False)
    try:
        yield server
    finally:
        with silence():
            server.stop()


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Print nothing; one thread at a time, or the last would not give back what the first took."""
    with _STDOUT_LOCK, contextlib.redirect_stdout(io.StringIO()):
        yield


def look(server: Any, plane: Plane, low: complex, high: complex, aside: float, above: float) -> None:
    """Light the scene, and look at a box, m, from beside the plane and from above, in sizes of the box."""
    size, middle = abs(high - low), in_space(plane, (low + high) / 2)
    across = np.cross(plane.horizontal, plane.vertical)
    server.scene.set_up_direction(tuple(plane.vertical))
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/lights/ambient", intensity=1.6)
    server.initial_camera.position = tuple(middle + size * (aside * across + above * plane.vertical))
    server.initial_camera.look_at = tuple(middle)


def add_grounds(
    server: Any, plane: Plane, low: complex, high: complex, lines: list[tuple[float, complex, complex]]
) -> None:
    """Add the ground of :func:`ground_lines` as grids around a box, m."""
    size, across = abs(high - low), np.cross(plane.horizontal, plane.vertical)
    letters = "".join("xyz"[int(np.argmax(np.abs(axis)))] for axis in (plane.horizontal, across))
    for index, (level, *_) in enumerate(lines):
        place = in_space(plane, complex((low.real + high.real) / 2, level))
        server.scene.add_grid(f"/ground/{index}", 3 * size, 2 * size, plane=letters, position=place, **GRID)


def add_obstacle(server: Any, index: int, obstacle: Obstacle, slab: tuple[Array, IntArray]) -> Any:
    """Add an obstacle as the solid of :func:`obstacle_slab`; return its node."""
    flat = not obstacle.bounded
    look: dict[str, Any] = {"color": SAND if flat else STONE, "opacity": 0.85, "flat_shading": True}
    return server.scene.add_mesh_simple(f"/obstacles/{index}", *slab, cast_shadow=not flat, **look)


def move_obstacle(node: Any, plane: Plane, obstacle: Obstacle, instant: float) -> None:
    """Put an obstacle that moves, comes or goes where it is at an instant of the flight, s."""
    if obstacle.window is not None or any(obstacle.velocity):
        low, high = obstacle.window or (-np.inf, np.inf)
        node.position = in_space(plane, complex(*obstacle.velocity) * instant)
        node.visible = bool(low <= instant <= high)


def _add_trails(server: Any, plan: Plan) -> None:
    placed = postures(plan, np.linspace(0.0, plan.duration, 121))
    names = dict.fromkeys((plan.problem.takeoff.frame, plan.problem.landing.frame))
    paths = placed.com, placed.takeoff, placed.landing
    for index, (name, path, colour) in enumerate(zip(("CM", *names), paths, TRAILS, strict=False)):
        points = in_space(plan.robot.plane, path)
        pairs, colours = np.stack((points[:-1], points[1:]), axis=1), rgb_bytes(colour)
        server.scene.add_line_segments(f"/trails/{index}", pairs, colours, thickness=2.0, thickness_units="screen")
        server.scene.add_label(f"/trails/{index}/name", name, position=points[0])


def obstacle_slab(plan: Plan, obstacle: Obstacle, low: complex, high: complex) -> tuple[Array, IntArray]:
    """Return corners (k, 3) and triangles (f, 3) of an obstacle at t = 0, drawn out across the plane, m.

    A half-plane reaches beside all of the box from ``low`` to ``high``.
    """
    solids = [_piece_slab(plan, piece, low, high) for piece in obstacle.pieces]
    firsts = np.cumsum([0, *(len(corners) for corners, _ in solids)])
    triangles = [first + part for first, (_, part) in zip(firsts[:-1], solids, strict=True)]
    return np.concatenate([corners for corners, _ in solids]), np.concatenate(triangles)


def _piece_slab(plan: Plan, obstacle: Obstacle, low: complex, high: complex) -> tuple[Array, IntArray]:
    size = robot_size(plan)
    if not isinstance(obstacle, HalfPlane):
        outline = obstacle_outlines(obstacle, 0.0, 0.0)[0]
        return prism(plan.robot.plane, outline[:, 0] + 1j * outline[:, 1], WIDTH * size)
    normal = complex(*obstacle.normal) / abs(complex(*obstacle.normal))
    point, reach, below = complex(*obstacle.point), abs(high - low) / 2, -SLAB * size * normal
    beside = ((low + high) / 2 - point) / (1j * normal)
    ends = point + 1j * normal * (beside.real + reach * np.array([1.0, -1.0]))
    return prism(plan.robot.plane, np.concatenate((ends, ends[::-1] + below)), size)


def prism(plane: Plane, corners: ComplexArray, width: float) -> tuple[Array, IntArray]:
    """Return corners (2 k, 3) and triangles of a convex polygon (k,) drawn out across the plane, m."""
    count = len(corners)
    aside = 0.5 * width * plane.normal
    points = in_space(plane, corners)
    here = np.arange(count)
    on = (here + 1) % count
    sides = [np.stack((here, on, here + count), axis=1), np.stack((on, on + count, here + count), axis=1)]
    fan = np.stack((np.zeros(count - 2, dtype=np.int64), here[1:-1], here[2:]), axis=1)
    faces = np.concatenate((*sides, fan[:, ::-1], fan + count))
    both = np.concatenate((faces, faces[:, ::-1]))  # whichever way round the polygon goes, it is seen from outside
    return np.concatenate((points - aside, points + aside)), both
