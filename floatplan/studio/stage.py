"""The scene: the robot in flight, its start and goal, obstacles, paths; dragging these; and the clock of the flight.

In space nothing is dragged: start and goal are no ghosts there, and obstacles stand where the file has them.
"""

import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.problem.parts import Obstacle
from floatplan.studio.edits import end_state, moved, put_obstacle
from floatplan.studio.inputs import on
from floatplan.studio.planning import Actions
from floatplan.studio.session import Session, View
from floatplan.studio.tasks import ShownPlan, pose_times
from floatplan.view import outlines
from floatplan.view.jumps import flies_in_space
from floatplan.view.scene import scene
from floatplan.view.solids import obstacle_solid
from floatplan.view.style import PALETTE, rgb_bytes

Show = tuple[scene.RobotNodes, tuple[scene.ForceNodes, ...], ShownPlan]


def end_poses(view: View, end: str) -> outlines.Poses:
    """Poses of the bodies at "start" or "goal", with the centre of mass as the flight, or a jump, has it then."""
    problem = view.problem
    solved = problem if view.result is None or view.result.solved_jump is None else view.result.plan.problem
    state = end_state(problem, end)
    time = 0.0 if end == "start" else solved.flight.duration
    path = solved.path.positions(np.array([time]))
    com = path[:, 0] + 1j * path[:, 1]
    return outlines.body_poses(problem.robot, np.array([state.orientation]), state.positions[None], com)


@dataclass
class Drag:
    """A drag of a segment: its pivot, the pointer's last position, the angle so far, and the value at the beginning."""

    pivot: complex
    last: complex
    angle: float
    value: float


class Stage:
    """Everything in the scene; :meth:`draw` follows the session's view, what the user does changes the session."""

    def __init__(self, server: Any, session: Session, actions: Actions, first: ShownPlan) -> None:
        self._server = server
        self._session = session
        self._actions = actions
        problem = session.view.problem
        plan = first.plan
        self._robot = problem.robot
        self._plane = None if flies_in_space(plan) else problem.robot.plane
        self._size = outlines.robot_size(plan)
        self._plan = plan
        self._shown: View | None = None
        self._forces: tuple[scene.ForceNodes, ...] = ()
        self._lock = threading.Lock()  # the player moves obstacles too
        self._sees_jump = first.solved_jump is not None
        if self._plane is None:
            self._look_in_space(first)
        else:
            placed = outlines.postures(plan, outlines.snapshot_times(plan))
            self._box = outlines.picture_box(plan, placed)
            self._shapes = outlines.posture_at(plan, plan.problem.initial, 0.0)
            scene.look(server, self._plane, *self._box, aside=0.85, above=0.1)
            scene.add_grounds(server, self._plane, *self._box, outlines.ground_lines(plan, placed))
        server.scene.configure_default_lights(cast_shadow=False)  # they take as long to draw as everything else
        self.flier = scene.RobotNodes(server, "/robot", self._robot)
        if not self.flier.add_meshes(self._size):
            self.flier.add_solids()
        self.compared = scene.RobotNodes(server, "/kept", self._robot)
        self.compared.add_solids((150, 90, 200), 0.4)  # violet, as the card of comparison says
        self.compared.root.visible = False
        self.grips: dict[str, dict[int, Any]] = {}
        self.ghosts: dict[str, scene.RobotNodes] = {}
        if self._plane is not None:
            self.ghosts = {"start": self._ghost("start", (0, 130, 130)), "goal": self._ghost("goal", (213, 94, 0))}
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._paths = server.scene.add_line_segments("/paths", nothing, rgb_bytes(PALETTE.trails[0]), **scene.LINES)
        self._grid: Any = None  # lines on the ground in space, where the newest motion has some
        if self._plane is None:
            self._grid = server.scene.add_line_segments("/grid", nothing, scene.GRID["section_color"], **scene.LINES)
        self._obstacles: list[Any] = []
        self._drags: dict[str, Drag] = {}
        self._carries: dict[int, tuple[complex, Obstacle]] = {}

    def draw(self, view: View) -> None:
        """Draw what has changed."""
        before = self._shown
        with self._lock, self._server.atomic():
            if before is None or before.problem is not view.problem:
                self._draw_problem(view.problem)
            for end, ghost in self.ghosts.items():
                ghost.put(end_poses(view, end), 0)
            if view.result is not None and (before is None or before.result is not view.result):
                if self._plane is None and view.result.solved_jump and not self._sees_jump:
                    self._look_in_space(view.result)  # which reaches further
                    self._sees_jump = True
                self._draw_paths(view.result)
                self._draw_forces(view.result)
            if before is None or before.compared is not view.compared:
                self.compared.root.visible = view.compared is not None
            self._shown = view

    def shows(self, view: View) -> list[Show]:
        """Return the nodes of all motions to play."""
        candidates = ((self.flier, self._forces, view.result), (self.compared, (), view.compared))
        return [(bodies, forces, shown) for bodies, forces, shown in candidates if shown is not None]

    def at(self, instant: float) -> None:
        """Move obstacles that move to where they are at an instant of the motion, s."""
        with self._lock:
            obstacles = self._shown.problem.obstacles if self._shown else ()
            if self._plane is None:
                obstacles = tuple(obstacle for obstacle in obstacles if obstacle.bounded)
            jump = self._shown.result.solved_jump if self._shown and self._shown.result else None
            instant -= jump.takeoff_time if jump else 0.0  # their clock begins with the flight
            for node, obstacle in zip(self._obstacles, obstacles, strict=False):
                scene.move_obstacle(node, self._plane, obstacle, instant)

    def _look_in_space(self, shown: ShownPlan) -> None:
        scene.look_in_space(self._server, shown.motion, 1.2)  # [-] radii: so near that it fills the scene

    def _ghost(self, end: str, colour: tuple[int, int, int]) -> scene.RobotNodes:
        ghost = scene.RobotNodes(self._server, f"/{end}", self._robot)
        jump = self._session.view.problem.jump
        ghost.root.visible = jump is None or end in jump.fixed  # else it is a guess
        segments = ghost.add_solids(colour, 0.28)  # transparent: the flight shows through
        grips = ghost.add_grips(self._shapes, self._size, colour)
        for segment, node in [*segments, *grips.items()]:
            self._on_drag(node, f"{end} {segment}", partial(self.rotate, end, segment))
        self.grips[end] = grips
        return ghost

    def _on_drag(self, node: Any, about: str, move: Callable[[complex, bool], None]) -> None:
        """Call ``move`` with where the pointer is in the plane, and whether the drag begins there."""

        def drag(event: Any) -> None:
            eye = event.client.camera.position
            pointer = event.end_position
            begins = event.phase == "start"
            assert self._plane is not None, "in space nothing is dragged"
            position = scene.plane_position(self._plane, np.asarray(eye), np.asarray(pointer))
            if position is not None:
                self._actions.do(f"{begins} {about}", lambda: move(position, begins))

        on(node.on_drag("left"), drag)

    def rotate(self, end: str, segment: int, position: complex, begins: bool) -> None:
        """Rotate a segment, 0 for the base and i + 1 of joint i, of the posture at an end towards a position."""
        view = self._session.view
        key = f"{end} {segment}"
        if begins or key not in self._drags:
            pivot, value = self.pivot(view, end, segment)
            self._drags[key] = Drag(pivot, position, 0.0, value)
            return
        drag = self._drags[key]
        if abs(position - drag.pivot) < 1e-9 or abs(drag.last - drag.pivot) < 1e-9:
            return
        drag.angle += float(np.angle((position - drag.pivot) / (drag.last - drag.pivot)))
        drag.last = position
        tree = self._robot.tree
        angle = drag.angle * tree.turn
        if segment == 0:
            self._session.set(f"{end}.orientation", drag.value + angle)
            return
        joint = segment - 1
        body = self._body(segment)
        ratio = float(tree.turns[body, joint] - tree.turns[tree.parent[body], joint])
        low, high = view.problem.position_limits[joint]
        value = float(np.clip(drag.value + angle / ratio, low, high))
        self._session.set(f"{end}.positions.{self._robot.joints[joint]}", value)

    def _body(self, segment: int) -> int:
        """The first body of a segment."""
        capsules = outlines.rendered_capsules(self._robot)
        own = np.flatnonzero(np.asarray(self._shapes.segment) == segment).tolist()
        return min((capsules[number].body for number in own), default=0)

    def pivot(self, view: View, end: str, segment: int) -> tuple[complex, float]:
        """Pivot of a segment of the posture at an end, m, and its angle, rad: the base's is the centre of mass."""
        poses = end_poses(view, end)
        state = end_state(view.problem, end)
        tree = self._robot.tree
        if segment:
            return complex(poses.places[0, self._body(segment)]), float(state.positions[segment - 1])
        centers = poses.points(range(len(tree.mass)), tree.center)[0]
        return complex(tree.mass @ centers / tree.mass.sum()), float(state.orientation)

    def _draw_problem(self, problem: fp.Problem) -> None:
        """Draw the obstacles; in space the bounded ones, of which there are no others than at first."""
        if self._plane is None:
            if not self._obstacles:
                for index, obstacle in enumerate(problem.obstacles):
                    if obstacle.bounded:
                        solid = obstacle_solid(obstacle)
                        self._obstacles.append(scene.add_obstacle(self._server, index, obstacle, solid))
            return
        while len(self._obstacles) > len(problem.obstacles):
            self._obstacles.pop().remove()
        before = self._shown.problem.obstacles if self._shown else ()
        for index, obstacle in enumerate(problem.obstacles):
            slab = scene.obstacle_slab(self._plan, obstacle, *self._box)
            if index < len(self._obstacles) and before[index].kind == obstacle.kind:
                self._obstacles[index].vertices = slab[0].astype(np.float32)
                continue
            node = scene.add_obstacle(self._server, index, obstacle, slab)
            self._on_drag(node, f"obstacle {index}", partial(self.carry, index))
            self._obstacles[index : index + 1] = [node]

    def carry(self, index: int, position: complex, begins: bool) -> None:
        """Move an obstacle as the pointer moves, which is at a position in the plane."""
        obstacles = self._session.view.problem.obstacles
        if index >= len(obstacles):
            return
        if begins or index not in self._carries:
            self._carries[index] = position, obstacles[index]
            return
        first, obstacle = self._carries[index]
        self._session.edit(put_obstacle(index, moved(obstacle, position - first)), f"carry {index}")

    def _draw_paths(self, shown: ShownPlan) -> None:
        pairs = []
        colours = []
        for path, colour in zip(shown.paths, PALETTE.trails, strict=True):
            pairs.append(np.stack((path[:-1], path[1:]), axis=1))
            # dark red: the paths of a motion that is no plan
            colours.append(np.broadcast_to(rgb_bytes(colour) if shown.plan.ok else (192, 24, 43), pairs[-1].shape))
        self._paths.points = np.concatenate(pairs).astype(np.float32)
        self._paths.colors = np.concatenate(colours).astype(np.uint8)
        if self._grid is not None and len(shown.grid):
            self._grid.points = shown.grid.astype(np.float32)

    def _draw_forces(self, shown: ShownPlan) -> None:
        """Draw the forces on the feet of a jump as arrows, and remove those of the one before."""
        if self._forces:
            self._server.scene.remove_by_name("/forces")
        jump = shown.solved_jump
        self._forces = () if jump is None else (scene.ForceNodes(self._server, jump, pose_times(jump.duration)),)

    def free_position(self) -> tuple[complex, float]:
        """A free position above the flight for a new obstacle, and the robot's size, m."""
        low, high = self._box
        return complex((low.real + high.real) / 2, high.imag + 0.2 * self._size), self._size


class Player:
    """Moves robots along their flights, all from the same instant on."""

    def __init__(self, server: Any, on_time: Callable[[float], None]) -> None:
        self._server = server
        self._on_time = on_time
        self._shows: list[Show] = []
        self._lock = threading.Lock()
        self._sending = threading.Lock()  # held while nodes of a motion are moved
        self._time = 0.0  # [s] of the flight
        self.speed = 0.5  # [-] of real time
        self.playing = True  # whether time goes on
        self._closed = threading.Event()
        self._dirty = True
        self.frames = 0  # sent so far
        self._thread = threading.Thread(target=self._play, name="player", daemon=True)
        self._thread.start()

    def show(self, shows: list[Show]) -> None:
        """Fly these from now on."""
        with self._lock:
            self._shows = shows
            self._dirty = True

    def held(self) -> AbstractContextManager[Any]:
        """Move nothing while this is entered: nodes may be removed, if other motions are to be shown then."""
        return self._sending

    def seek(self, instant: float) -> None:
        """Go to an instant, s, and stay there."""
        with self._lock:
            self._time = instant
            self.playing = False
            self._dirty = True

    def close(self) -> None:
        """End."""
        self._closed.set()
        self._thread.join()

    def _play(self) -> None:
        last = due = time.monotonic()
        while not self._closed.wait(max(due - time.monotonic(), 0.0)):
            now = time.monotonic()
            due = max(due + 1 / 40.0, now)  # [Hz] poses are sent about as often as a page can draw them
            with self._sending:
                self._go_on(now - last)
            last = now

    def _go_on(self, passed: float) -> None:
        """Move all robots to where they are after so much time, s."""
        with self._lock:
            if self.playing:
                self._time += passed * self.speed
            shows = self._shows
            instant = self._time
            moving = self.playing or self._dirty
            longest = max((shown.motion.duration for *_, shown in shows), default=0.0)
            if self.playing and instant > longest + 0.5 * self.speed:  # [s] of pause at landing
                self._time = 0.0
            self._dirty = False
        if moving and shows:
            try:
                self._send(shows, min(instant, longest))
            except Exception:  # the next pose is another chance; it is an error of the program
                logging.getLogger(__name__).exception("player")

    def _send(self, shows: list[Show], instant: float) -> None:
        with self._server.atomic():
            for bodies, forces, shown in shows:
                count = len(shown.poses.places)
                index = round(min(instant / shown.motion.duration, 1.0) * (count - 1))
                bodies.put(shown.poses, index)
                for arrows in forces:
                    arrows.put(index)
        self.frames += 1
        self._on_time(instant)
