"""The scene: the robot in flight, its start and goal, obstacles, paths; dragging these; and the clock of the flight."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import floatplan as fp
from floatplan.problem.parts import Obstacle
from floatplan.studio.answers import ShownPlan, pose_times
from floatplan.studio.edits import end_state, moved, put_obstacle
from floatplan.studio.inputs import on
from floatplan.studio.planning import Actions
from floatplan.studio.session import Session, View
from floatplan.view import outlines
from floatplan.view.scene import scene
from floatplan.view.scene.meshes import bends
from floatplan.view.style import TRAILS, rgb_bytes

LOG = logging.getLogger(__name__)
RATE = 40.0  # [Hz] of poses: the flight loops, they are sent as often as the page draws them
REST = 0.5  # [s] at landing, before it begins again
Show = tuple[scene.RobotNodes, tuple[scene.ForceNodes, ...], ShownPlan]
START = (0, 130, 130)
GOAL = (213, 94, 0)
KEPT = (150, 90, 200)
ASTRAY = (192, 24, 43)  # the same of a motion that is no plan
BEND = 0.05  # [rad] of a path, after which it has another point
GHOST = 0.28  # [-] opacity


def end_poses(view: View, end: str) -> outlines.Poses:
    """The bodies of the posture at "start" or "goal", its centre of mass where the flight, or a jump, has it then."""
    problem = view.problem
    flown = problem if view.answer is None or view.answer.found_jump is None else view.answer.plan.problem
    state = end_state(problem, end)
    time = 0.0 if end == "start" else flown.flight.duration
    path = flown.path.positions(np.array([time]))
    com = path[:, 0] + 1j * path[:, 1]
    return outlines.body_poses(problem.robot, np.array([state.orientation]), state.positions[None], com)


@dataclass
class Grabbed:
    """What is dragged: where it began, and what it was then."""

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
        self._plane = problem.robot.plane
        self._size = outlines.robot_size(plan)
        placed = outlines.postures(plan, outlines.snapshot_times(plan))
        self._box = outlines.picture_box(plan, placed)
        self._plan = plan
        self._shapes = outlines.posture_at(plan, plan.problem.initial, 0.0)
        self._drawn: View | None = None
        self._forces: tuple[scene.ForceNodes, ...] = ()
        self._lock = threading.Lock()  # the player moves obstacles too
        self._look()
        scene.add_grounds(server, self._plane, *self._box, outlines.ground_lines(placed))
        self.flier = scene.RobotNodes(server, "/robot", self._robot)
        if not self.flier.add_meshes(self._size):
            self.flier.add_solids()
        self.kept = scene.RobotNodes(server, "/kept", self._robot)
        self.kept.add_solids(KEPT, 0.4)
        self.kept.root.visible = False
        self.grips: dict[str, dict[int, Any]] = {}
        self.ghosts = {"start": self._ghost("start", START), "goal": self._ghost("goal", GOAL)}
        nothing = np.zeros((1, 2, 3), dtype=np.float32)
        self._paths = server.scene.add_line_segments("/paths", nothing, rgb_bytes(TRAILS[0]), **scene.LINES)
        self._obstacles: list[Any] = []
        self._grabbed: dict[str, Grabbed] = {}
        self._carried: dict[int, tuple[complex, Obstacle]] = {}

    def draw(self, view: View) -> None:
        """Draw what has changed."""
        before = self._drawn
        with self._lock, self._server.atomic():
            if before is None or before.problem is not view.problem:
                self._draw_problem(view.problem)
            for end, ghost in self.ghosts.items():
                ghost.put(end_poses(view, end), 0)
            if view.answer is not None and (before is None or before.answer is not view.answer):
                self._draw_paths(view.answer)
                self._draw_forces(view.answer)
            if before is None or before.kept is not view.kept:
                self.kept.root.visible = view.kept is not None
            self._drawn = view

    def shows(self, view: View) -> list[Show]:
        """What flies."""
        flying = ((self.flier, self._forces, view.answer), (self.kept, (), view.kept))
        return [(bodies, forces, shown) for bodies, forces, shown in flying if shown is not None]

    def at(self, instant: float) -> None:
        """Move obstacles that move to where they are at an instant of the motion, s."""
        with self._lock:
            obstacles = self._drawn.problem.obstacles if self._drawn else ()
            jump = self._drawn.answer.found_jump if self._drawn and self._drawn.answer else None
            instant -= jump.takeoff_time if jump else 0.0  # their clock begins with the flight
            for node, obstacle in zip(self._obstacles, obstacles, strict=False):
                scene.move_obstacle(node, self._plane, obstacle, instant)

    def _look(self) -> None:
        scene.look(self._server, self._plane, *self._box, aside=0.85, above=0.1)
        self._server.scene.configure_default_lights(cast_shadow=False)  # they take as long to draw as all the rest

    def _ghost(self, end: str, colour: tuple[int, int, int]) -> scene.RobotNodes:
        ghost = scene.RobotNodes(self._server, f"/{end}", self._robot)
        jump = self._session.view.problem.jump
        ghost.root.visible = jump is None or end in jump.fixed  # else a guess
        parts = ghost.add_solids(colour, GHOST)
        grips = ghost.add_grips(self._shapes, self._size, colour)
        for part, node in [*parts, *grips.items()]:
            self._on_drag(node, f"{end} {part}", partial(self.turn, end, part))
        self.grips[end] = grips
        return ghost

    def _on_drag(self, node: Any, about: str, move: Callable[[complex, bool], None]) -> None:
        """Call ``move`` with where the pointer is in the plane, and whether the drag begins there."""

        def drag(event: Any) -> None:
            eye = event.client.camera.position
            pointer = event.end_position
            begins = event.phase == "start"
            place = scene.plane_position(self._plane, np.asarray(eye), np.asarray(pointer))
            if place is not None:
                self._actions.do(f"{begins} {about}", lambda: move(place, begins))

        on(node.on_drag("left"), drag)

    def turn(self, end: str, part: int, place: complex, begins: bool) -> None:
        """Turn a part of the posture at an end towards a place of the plane: the base is part 0, joint i is i + 1."""
        view = self._session.view
        key = f"{end} {part}"
        if begins or key not in self._grabbed:
            pivot, value = self.pivot(view, end, part)
            self._grabbed[key] = Grabbed(pivot, place, 0.0, value)
            return
        held = self._grabbed[key]
        if abs(place - held.pivot) < 1e-9 or abs(held.last - held.pivot) < 1e-9:
            return
        held.angle += float(np.angle((place - held.pivot) / (held.last - held.pivot)))
        held.last = place
        turn = held.angle * self._robot.tree.turn
        if part == 0:
            self._session.set(f"{end}.orientation", held.value + turn)
            return
        joint = part - 1
        body = self._body(part)
        tree = self._robot.tree
        share = float(tree.turns[body, joint] - tree.turns[tree.parent[body], joint])
        low, high = view.problem.position_limits[joint]
        value = float(np.clip(held.value + turn / share, low, high))
        self._session.set(f"{end}.positions.{self._robot.joints[joint]}", value)

    def _body(self, part: int) -> int:
        """The first body of a part."""
        shapes = zip(outlines.rendered_capsules(self._robot), self._shapes.segment.tolist(), strict=True)
        return min((shape.body for shape, of in shapes if of == part), default=0)

    def pivot(self, view: View, end: str, part: int) -> tuple[complex, float]:
        """Where a part of the posture at an end turns, and its angle, rad: the base about the centre of mass."""
        poses = end_poses(view, end)
        state = end_state(view.problem, end)
        tree = self._robot.tree
        if part:
            return complex(poses.places[0, self._body(part)]), float(state.positions[part - 1])
        centers = poses.points(range(len(tree.mass)), tree.center)[0]
        return complex(tree.mass @ centers / tree.mass.sum()), float(state.orientation)

    def _draw_problem(self, problem: fp.Problem) -> None:
        while len(self._obstacles) > len(problem.obstacles):
            self._obstacles.pop().remove()
        before = self._drawn.problem.obstacles if self._drawn else ()
        for index, obstacle in enumerate(problem.obstacles):
            slab = scene.obstacle_slab(self._plan, obstacle, *self._box)
            if index < len(self._obstacles) and before[index].kind == obstacle.kind:
                self._obstacles[index].vertices = slab[0].astype(np.float32)
                continue
            node = scene.add_obstacle(self._server, index, obstacle, slab)
            self._on_drag(node, f"obstacle {index}", partial(self.carry, index))
            self._obstacles[index : index + 1] = [node]

    def carry(self, index: int, place: complex, begins: bool) -> None:
        """Carry an obstacle to a place of the plane."""
        obstacles = self._session.view.problem.obstacles
        if index >= len(obstacles):
            return
        if begins or index not in self._carried:
            self._carried[index] = place, obstacles[index]
            return
        first, obstacle = self._carried[index]
        self._session.edit(put_obstacle(index, moved(obstacle, place - first)), f"carry {index}")

    def _draw_paths(self, shown: ShownPlan) -> None:
        pairs = []
        colours = []
        for places, colour in zip(shown.paths, TRAILS, strict=True):
            pairs.append(scene.segments(self._plane, places[bends(places, BEND)]))
            colours.append(np.broadcast_to(rgb_bytes(colour) if shown.plan.ok else ASTRAY, pairs[-1].shape))
        self._paths.points = np.concatenate(pairs).astype(np.float32)
        self._paths.colors = np.concatenate(colours).astype(np.uint8)

    def _draw_forces(self, shown: ShownPlan) -> None:
        """Arrows of the forces on the feet of a jump, in the place of those of the one before."""
        if self._forces:
            self._server.scene.remove_by_name("/forces")
        jump = shown.found_jump
        self._forces = () if jump is None else (scene.ForceNodes(self._server, jump, pose_times(jump.duration)),)

    def free_place(self) -> tuple[complex, float]:
        """A place beside the flight for something new, and the robot's size, m."""
        low, high = self._box
        return complex((low.real + high.real) / 2, high.imag + 0.2 * self._size), self._size


class Player:
    """Moves robots along their flights, all from the same instant on."""

    def __init__(self, server: Any, on_time: Callable[[float], None]) -> None:
        self._server = server
        self._on_time = on_time
        self._shows: list[Show] = []
        self._lock = threading.Lock()
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
            due = max(due + 1 / RATE, now)
            with self._lock:
                if self.playing:
                    self._time += (now - last) * self.speed
                shows = self._shows
                instant = self._time
                moving = self.playing or self._dirty
                longest = max((shown.motion.duration for *_, shown in shows), default=0.0)
                if self.playing and instant > longest + REST * self.speed:
                    self._time = 0.0
                self._dirty = False
            last = now
            if moving and shows:
                try:
                    self._send(shows, min(instant, longest))
                except Exception:  # the next pose is another chance; it is an error of the program
                    LOG.exception("player")

    def _send(self, shows: list[Show], instant: float) -> None:
        with self._server.atomic():
            for bodies, forces, shown in shows:
                count = len(shown.poses.places)
                index = round(min(instant / shown.motion.duration, 1.0) * (count - 1))
                bodies.put(shown.poses, index)
                for each in forces:
                    each.put(index)
        self.frames += 1
        self._on_time(instant)
