"""The scene: a flight in three dimensions, with the robot's own meshes, as one page that works without a network.

The page is viser's player. World axes are those of the root link at orientation zero; the plane of the motion is drawn
where the base is.
"""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

from floatplan.arrays import Array
from floatplan.files import write_atomically
from floatplan.motion.flight_state import FlightState
from floatplan.optional import import_optional
from floatplan.plans.plan import Plan
from floatplan.problem.parts import Obstacle
from floatplan.view.figures.snapshots import picture_box, snapshot_times
from floatplan.view.postures import postures
from floatplan.view.scene.moving_robot import Mover, capsule_robot, mesh_robot, visual_model
from floatplan.view.scene.solids import obstacle_slab, point_in_space
from floatplan.view.style import GREY, rgb
from floatplan.view.surroundings import ground_lines

_STDOUT_LOCK = threading.Lock()  # Python's standard output is one for all threads
POSE_RATE = 60.0  # [Hz] of the page
TRAILS = (GREY, "#8b5e00", "#6a3d9a")  # of the centre of mass, and of the frames that take off and land
STONE, SAND = (150, 150, 150), (226, 222, 212)
GRID: dict[str, Any] = {"cell_size": 0.25, "cell_color": (236, 236, 236), "section_color": (214, 214, 214)}

Update: TypeAlias = Callable[[int], None]


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
    state = plan.at(np.linspace(0.0, plan.duration, frames))
    with _server(viser) as server:
        updates = [_add_robot(server, plan, state), *_add_obstacles(server, plan, state.times)]
        _add_surroundings(server, plan)
        serializer = server.get_scene_serializer()
        for index in range(frames):
            for update in updates:
                update(index)
            if index < frames - 1:  # the page's clock is the flight's: from takeoff to landing
                serializer.insert_sleep(plan.duration / (frames - 1))
        return str(serializer.as_html())


@contextlib.contextmanager
def _server(viser: ModuleType) -> Iterator[Any]:
    """A local server that prints nothing: viser records what is sent to it."""
    with _silence():
        server = viser.ViserServer(host="127.0.0.1", verbose=False)
    try:
        yield server
    finally:
        with _silence():
            server.stop()


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Print nothing; one thread at a time, or the last would not give back what the first took."""
    with _STDOUT_LOCK, contextlib.redirect_stdout(io.StringIO()):
        yield


def _add_robot(server: Any, plan: Plan, state: FlightState) -> Update:
    model = visual_model(plan.robot)
    move: Mover = capsule_robot(server, plan) if model is None else mesh_robot(server, plan, model)
    move(state, 0)
    return lambda index: move(state, index)


def _add_obstacles(server: Any, plan: Plan, times: Array) -> list[Update]:
    """Obstacles as slabs across the plane; return the updates of those that move, come or go."""
    updates = []
    low, high = picture_box(plan, postures(plan, snapshot_times(plan)))
    for number, obstacle in enumerate(plan.problem.obstacles):
        vertices, faces = obstacle_slab(plan, obstacle, low, high)
        name, flat = f"/obstacles/{number}", not obstacle.bounded
        material: dict[str, Any] = {"color": SAND if flat else STONE, "opacity": 0.85, "flat_shading": True}
        node = server.scene.add_mesh_simple(name, vertices, faces, cast_shadow=not flat, **material)
        if obstacle.window is not None or any(obstacle.velocity):
            updates.append(_obstacle_update(node, plan, obstacle, times))
    return updates


def _obstacle_update(node: Any, plan: Plan, obstacle: Obstacle, times: Array) -> Update:
    low, high = obstacle.window or (-np.inf, np.inf)
    velocity = point_in_space(plan.robot.plane, complex(*obstacle.velocity))

    def update(index: int) -> None:
        node.position = velocity * times[index]
        node.visible = bool(low <= times[index] <= high)

    return update


def _add_surroundings(server: Any, plan: Plan) -> None:
    """Light, ground, trails, and a camera that sees the whole flight from the side and a little from above."""
    plane = plan.robot.plane
    low, high = picture_box(plan, postures(plan, snapshot_times(plan)))
    size, middle = abs(high - low), point_in_space(plane, (low + high) / 2)
    aside = np.cross(plane.horizontal, plane.vertical)
    server.scene.set_up_direction(tuple(plane.vertical))
    server.scene.configure_environment_map(None)
    server.scene.add_light_ambient("/lights/ambient", intensity=1.6)
    server.initial_camera.position = tuple(middle + size * (0.72 * aside + 0.12 * plane.vertical))
    server.initial_camera.look_at = tuple(middle)
    for index, (level, *_) in enumerate(ground_lines(postures(plan, snapshot_times(plan)))):
        place = point_in_space(plane, complex((low.real + high.real) / 2, level))
        letters = "xyz"[int(np.argmax(np.abs(plane.horizontal)))] + "xyz"[int(np.argmax(np.abs(aside)))]
        server.scene.add_grid(f"/ground/{index}", 3 * size, 2 * size, plane=letters, position=place, **GRID)
    _add_trails(server, plan)


def _add_trails(server: Any, plan: Plan) -> None:
    placed = postures(plan, np.linspace(0.0, plan.duration, 121))
    names = dict.fromkeys((plan.problem.takeoff.frame, plan.problem.landing.frame))
    paths = placed.com, placed.takeoff, placed.landing
    for index, (name, path, colour) in enumerate(zip(("CM", *names), paths, TRAILS, strict=False)):
        points = np.array([point_in_space(plan.robot.plane, complex(place)) for place in path])
        pairs = np.stack((points[:-1], points[1:]), axis=1)
        colours = tuple(int(255 * part) for part in rgb(colour))
        server.scene.add_line_segments(f"/trails/{index}", pairs, colours, thickness=2.0, thickness_units="screen")
        server.scene.add_label(f"/trails/{index}/name", name, position=points[0])
