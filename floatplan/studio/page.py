"""The page as a whole: a local server, the scene, the panel, and a thread that draws what changes."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Iterator
from contextlib import redirect_stdout
from typing import Any

import floatplan as fp
from floatplan.optional import import_optional
from floatplan.studio.panel.controls import Controls
from floatplan.studio.scene.player import Player
from floatplan.studio.scene.stage import Stage
from floatplan.studio.session.hands import Hands
from floatplan.studio.session.session import Session
from floatplan.studio.visitors import own_page_alone

HOST = "127.0.0.1"  # of this machine alone
PATIENCE = 60.0  # [s] for the first answer
AGAIN = 0.3  # [s] until what a hand was on is drawn again
CLOCK = 0.1  # [s] between two changes of the time that is told


class Studio:
    """A session with its page.

    Raises
    ------
    InputError
        viser is not installed, the port is taken, or the problem has no answer at all.
    """

    def __init__(
        self, problem: fp.Problem, folder: str = "runs/studio", port: int = 8080, with_map: bool = True
    ) -> None:
        viser = import_optional("viser", name="viser", element="studio", extra="view")
        self.session = Session(problem, with_map)
        try:
            self._open(viser, folder, port)
        except BaseException:
            self.session.close()
            raise

    def _open(self, viser: Any, folder: str, port: int) -> None:
        self.session.wait(lambda view: view.flown is not None or bool(view.fault), PATIENCE)
        first = self.session.view.flown
        if first is None:
            raise fp.InputError(self.session.view.fault or "no answer came", element="studio")
        with redirect_stdout(io.StringIO()), own_page_alone():
            self.server = viser.ViserServer(host=HOST, port=port, label="floatplan studio", verbose=False)
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", brand_color=(31, 95, 191))
        gui.set_panel_label(self.session.view.problem.name)
        gui.main_panel.dock_right()
        self.hands = Hands("hands")
        self.stage = Stage(self.server, self.session, self.hands, first)
        self.player = Player(self.server, self._tick)
        self.controls = Controls(self.server, self.session, self.hands, self.stage, self.player, folder)
        self._ticked = 0.0
        self._again = threading.Timer(AGAIN, self._repaint)
        self.painter = Hands("painter")
        self.session.listen(self._repaint)
        self._repaint()

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://localhost:{self.server.get_port()}"

    @property
    def errors(self) -> list[BaseException]:
        """What went wrong in the program, and did not end it."""
        return [*self.hands.errors, *self.painter.errors, *self.player.errors]

    def close(self) -> None:
        """End the page and the planning."""
        self.session.close()
        self.player.close()
        self.painter.close()
        self.hands.close()
        with redirect_stdout(io.StringIO()), contextlib.suppress(Exception):
            self.server.stop()

    def _repaint(self) -> None:
        self.painter.do("view", self._paint)

    def _paint(self) -> None:
        view = self.session.view
        self.stage.draw(view)
        self.player.show(self.stage.shows(view))
        self.server.flush()
        if self.controls.draw(view) and not self._again.is_alive():
            self._again = threading.Timer(AGAIN, self._repaint)
            self._again.daemon = True
            self._again.start()

    def _tick(self, instant: float) -> None:
        self.stage.at(instant)
        if abs(instant - self._ticked) > CLOCK:
            self._ticked = instant
            self.controls.at(instant)


@contextlib.contextmanager
def opened(problem: fp.Problem, **options: Any) -> Iterator[Studio]:
    """A studio that is closed in the end."""
    studio = Studio(problem, **options)
    try:
        yield studio
    finally:
        studio.close()
