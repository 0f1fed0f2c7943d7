"""The flight, looping: poses are sent as often as the page draws them."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from floatplan.studio.answers import ShownPlan
from floatplan.view.scene.scene import RobotNodes

LOG = logging.getLogger(__name__)
RATE = 40.0  # [Hz] of poses
REST = 0.5  # [s] at landing, before it begins again
Show = tuple[RobotNodes, ShownPlan]


class Player:
    """Moves robots along their flights, all from the same instant on."""

    def __init__(self, server: Any, on_time: Callable[[float], None]) -> None:
        self._server, self._on_time = server, on_time
        self._shows: list[Show] = []
        self._lock = threading.Lock()
        self._time = 0.0  # [s] of the flight
        self._speed = 0.5  # [-] of real time
        self._playing = True
        self._closed = threading.Event()
        self._dirty = True
        self.frames = 0  # sent so far
        self.errors: list[BaseException] = []
        self._thread = threading.Thread(target=self._play, name="player", daemon=True)
        self._thread.start()

    @property
    def playing(self) -> bool:
        """Whether time goes on."""
        return self._playing

    def show(self, shows: list[Show]) -> None:
        """Fly these from now on."""
        with self._lock:
            self._shows, self._dirty = shows, True

    def play(self, playing: bool) -> None:
        """Let time go on, or stand still."""
        with self._lock:
            self._playing = playing

    def seek(self, instant: float) -> None:
        """Go to an instant, s, and stay there."""
        with self._lock:
            self._time, self._playing, self._dirty = instant, False, True

    def set_speed(self, speed: float) -> None:
        """Of real time: 0.5 is slow motion."""
        with self._lock:
            self._speed = speed

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
                if self._playing:
                    self._time += (now - last) * self._speed
                shows, instant, moving = self._shows, self._time, self._playing or self._dirty
                longest = max((shown.plan.duration for _, shown in shows), default=0.0)
                if self._playing and instant > longest + REST * self._speed:
                    self._time = 0.0
                self._dirty = False
            last = now
            if moving and shows:
                try:
                    self._send(shows, min(instant, longest))
                except Exception as error:  # the next pose is another chance; it is an error of the program
                    self.errors.append(error)
                    LOG.exception("player")

    def _send(self, shows: list[Show], instant: float) -> None:
        with self._server.atomic():
            for bodies, shown in shows:
                count = len(shown.poses.places)
                share = min(instant / shown.plan.duration, 1.0)
                bodies.put(shown.poses, round(share * (count - 1)))
        self.frames += 1
        self._on_time(instant)
