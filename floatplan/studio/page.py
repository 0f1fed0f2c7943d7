"""The page as a whole: a local server, the scene, the panel, and a thread that renders what changes.

Only the studio's own page may connect, and no other that a browser on this machine shows; nobody may have viser open a
way to it from elsewhere. Where a version of viser offers no place to see to that, the studio does not start.
"""

import logging
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

HOST = "127.0.0.1"  # of this machine and no other
PATIENCE = 60.0  # [s] for the first result


class Studio:
    """A session with its page.

    Raises
    ------
    InputError
        viser is not installed, the port is taken, the problem is of a flight in space that is no whole jump, or it has
        no result at all.
    """

    def __init__(
        self, problem: fp.Problem, folder: str = "runs/studio", port: int = 8080, with_map: bool = True
    ) -> None:
        viser = import_optional("viser", name="viser", element="studio", extra="view")
        if problem.robot.base == "free-flyer" and problem.jump is None:
            reason = "in space the studio is for whole jumps, not yet for single flights"
            raise fp.InputError(reason, element="jump", advice="add a table [jump], or use floatplan plan and show")
        self.session = Session(problem, with_map)
        self.server: Any = None
        try:
            self._open(viser, folder, port)
        except BaseException:
            self.session.close()
            if self.server is not None:
                with silence(), suppress(Exception):
                    self.server.stop()
            raise

    def _open(self, viser: Any, folder: str, port: int) -> None:
        self.session.wait(lambda view: view.result is not None or bool(view.fault), PATIENCE)
        first = self.session.view.result
        if first is None:
            raise fp.InputError(self.session.view.fault or "no answer came", element="studio")
        with silence(), only_own_page(f"floatplan: {self.session.view.problem.name}"):
            self.server = unshared(viser)(host=HOST, port=port, label="floatplan studio", verbose=False)
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", brand_color=(31, 95, 191))
        gui.set_panel_label(self.session.view.problem.name)
        gui.main_panel.dock_right()
        self.actions = Actions("actions")
        self.stage = Stage(self.server, self.session, self.actions, first)
        self.player = Player(self.server, self._tick)
        self.panel = Controls(self.server, self.session, self.actions, self.stage, self.player, folder)
        self._ticked = 0.0
        self._again = threading.Timer(0.0, self._repaint)  # the next call of it, where there is one
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
        with self.player.held():
            self.stage.draw(view)
            self.player.show(self.stage.shows(view))
        self.server.flush()
        if self.panel.draw(view) and not self._again.is_alive():
            self._again = threading.Timer(0.3, self._repaint)  # [s] until an input that the user moves is shown again
            self._again.daemon = True
            self._again.start()

    def _tick(self, instant: float) -> None:
        self.stage.at(instant)
        if abs(instant - self._ticked) > 0.1:  # [s] the clock of the panel changes no more often
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
        return page.hostname in ("localhost", HOST, "::1") and page.netloc == host
    except ValueError:
        return False


def titled(response: Any, title: str) -> Any:
    """Give viser's page a title and the studio's style; return any other response as it is."""
    if response is not None and response.headers.get("Content-Type", "").startswith("text/html"):
        folder = files("floatplan.studio")
        style = folder.joinpath("page.css").read_text("utf-8")
        script = folder.joinpath("page.js").read_text("utf-8")
        response.body = headed(response.body.decode(), title, style, script).encode()
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
    return response


def unshared(viser: Any) -> Any:
    """Return viser's class of servers, without its way to give a server a public address.

    viser opens a tunnel to a server of its makers for any client that sends the message for it, whatever the page
    shows.

    Raises
    ------
    InputError
        viser has no method ``request_share_url``, so that nobody can tell how to prevent that.
    """
    if not callable(getattr(viser.ViserServer, "request_share_url", None)):
        raise unknown_viser("gives out public addresses")

    class Server(viser.ViserServer):  # type: ignore[misc]
        def request_share_url(self, verbose: bool = True) -> None:
            """Open no tunnel, whoever asks for one."""

    return Server


def unknown_viser(what: str) -> fp.InputError:
    """The refusal of a version of viser whose server other machines might reach."""
    reason = f"this version of viser {what} in a way that is not known, and is not started"
    return fp.InputError(reason, element="studio", advice="install viser 1.1.1")


def single(headers: Any, name: str) -> str | None:
    """The value of a header of a request; None where it is missing, or there more than once."""
    values = headers.get_all(name)
    return values[0] if len(values) == 1 else None


class FaultsOfClients(logging.Filter):
    """Leaves out what the server says of improper requests: whoever runs the studio did not make them."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is about something else."""
        return not record.getMessage().startswith(("opening handshake failed", "connection rejected"))


@contextmanager
def only_own_page(title: str) -> Iterator[None]:
    """Let a viser server that is started meanwhile refuse the websockets of other pages, and title its own.

    viser does not ask where a page comes from, and any web page can open a websocket to this machine. It hands over a
    function that answers requests, ``process_request``, when it calls ``websockets.asyncio.server.serve``: the question
    is called before it.

    Raises
    ------
    InputError
        viser starts its server in another way.
    """
    from websockets.asyncio import server

    serve = server.serve
    calls = []
    log = logging.getLogger("floatplan.studio.server")
    log.addFilter(FaultsOfClients())

    def guarded(*arguments: Any, process_request: Callable[[Any, Any], Any] | None = None, **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            if "Upgrade" in headers and not is_own_page(single(headers, "Origin"), single(headers, "Host")):
                return connection.respond(HTTPStatus.FORBIDDEN, "Only the studio's own page may connect.\n")
            if process_request is None:
                return None
            if "Upgrade" not in headers and "Accept-Encoding" in headers:
                del headers["Accept-Encoding"]  # what follows is text
            try:
                return titled(process_request(connection, request), title)
            except Exception as error:  # of a path that no file can have, or headers that are no proper ones
                log.debug("request refused: %r", error)
                return connection.respond(HTTPStatus.NOT_FOUND, "There is no such page.\n")

        calls.append(options)
        return serve(*arguments, process_request=process, **{**options, "logger": log})

    server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not calls:
        raise unknown_viser("starts its server")
