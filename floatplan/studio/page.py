"""The page as a whole: a local server, the scene, the panel, and a thread that draws what changes.

Only the studio's own page may connect, and no other that a browser on this machine shows.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from importlib.resources import files
from typing import Any
from urllib.parse import urlsplit

import floatplan as fp
from floatplan.errors import import_optional
from floatplan.studio.panel import Controls
from floatplan.studio.planning import Actions
from floatplan.studio.session import Session
from floatplan.studio.stage import Player, Stage
from floatplan.view.scene.scene import headed, silence

HOST = "127.0.0.1"  # of this machine alone
THIS_MACHINE = frozenset({"localhost", HOST, "::1"})
PATIENCE = 60.0  # [s] for the first answer
AGAIN = 0.3  # [s] until what the user held is drawn again
CLOCK = 0.1  # [s] between two changes of the time that is shown


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
        self.session.wait(lambda view: view.answer is not None or bool(view.fault), PATIENCE)
        first = self.session.view.answer
        if first is None:
            raise fp.InputError(self.session.view.fault or "no answer came", element="studio")
        with silence(), own_page_alone(f"floatplan: {self.session.view.problem.name}"):
            self.server = viser.ViserServer(host=HOST, port=port, label="floatplan studio", verbose=False)
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", brand_color=(31, 95, 191))
        gui.set_panel_label(self.session.view.problem.name)
        gui.main_panel.dock_right()
        self.actions = Actions("actions")
        self.stage = Stage(self.server, self.session, self.actions, first)
        self.player = Player(self.server, self._tick)
        self.panel = Controls(self.server, self.session, self.actions, self.stage, self.player, folder)
        self._ticked = 0.0
        self._again = threading.Timer(AGAIN, self._repaint)
        self.painter = Actions("painter")
        self.session.listen(self._repaint)
        self._repaint()

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://localhost:{self.server.get_port()}"

    def close(self) -> None:
        """End the page and the planning."""
        self.session.close()
        self.player.close()
        self.painter.close()
        self.actions.close()
        with silence(), suppress(Exception):
            self.server.stop()

    def _repaint(self) -> None:
        self.painter.do("view", self._paint)

    def _paint(self) -> None:
        view = self.session.view
        self.stage.draw(view)
        self.player.show(self.stage.shows(view))
        self.server.flush()
        if self.panel.draw(view) and not self._again.is_alive():
            self._again = threading.Timer(AGAIN, self._repaint)
            self._again.daemon = True
            self._again.start()

    def _tick(self, instant: float) -> None:
        self.stage.at(instant)
        if abs(instant - self._ticked) > CLOCK:
            self._ticked = instant
            self.panel.at(instant)


def is_own_page(origin: str | None, host: str | None) -> bool:
    """Whether a page comes from the address that it asks, and that address is of this machine.

    Parameters
    ----------
    origin, host : str or None
        The headers of those names. A page elsewhere has another origin; one whose name was made to lead here has
        another host.
    """
    try:
        page = urlsplit(origin or "")
        return page.hostname in THIS_MACHINE and page.netloc == host
    except ValueError:
        return False


def titled(response: Any, title: str) -> Any:
    """Give viser's page a title and the studio's style; return any other response as it is."""
    if response is not None and response.headers.get("Content-Type", "").startswith("text/html"):
        style = files("floatplan.studio").joinpath("page.css").read_text("utf-8")
        response.body = headed(response.body.decode(), title, style).encode()
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
    return response


@contextmanager
def own_page_alone(title: str) -> Iterator[None]:
    """Let a viser server that is started meanwhile refuse the websockets of other pages, and give its own a title.

    viser does not ask where a page comes from, and any web page can open a websocket to this machine. It hands over a
    function that answers requests, ``process_request``, when it calls ``websockets.asyncio.server.serve``: the question
    is asked before it.

    Raises
    ------
    InputError
        viser starts its server in another way.
    """
    from websockets.asyncio import server

    serve, calls = server.serve, []

    def guarded(*arguments: Any, process_request: Callable[[Any, Any], Any] | None = None, **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            if "Upgrade" in headers and not is_own_page(headers.get("Origin"), headers.get("Host")):
                return connection.respond(HTTPStatus.FORBIDDEN, "Only the studio's own page may connect.\n")
            if process_request is None:
                return None
            if "Upgrade" not in headers:
                del headers["Accept-Encoding"]  # what follows is text
            return titled(process_request(connection, request), title)

        calls.append(options)
        return serve(*arguments, process_request=process, **options)

    server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not calls:
        raise fp.InputError("this version of viser starts its server in a way that is not known", element="studio")
