"""Who may connect: the studio's own page, and no other that a browser on this machine shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import floatplan as fp

THIS_MACHINE = frozenset({"localhost", "127.0.0.1", "::1"})


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


@contextmanager
def own_page_alone() -> Iterator[None]:
    """Let a viser server that is started meanwhile refuse the websockets of other pages.

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

    def guarded(*arguments: Any, **options: Any) -> Any:
        calls.append(options)
        return serve(*arguments, **{**options, "process_request": guard(options.get("process_request"))})

    server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not calls:
        raise fp.InputError("this version of viser starts its server in a way that is not known", element="studio")


def guard(process_request: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
    """Answer requests as before, but forbid websockets of other pages."""

    def process(connection: Any, request: Any) -> Any:
        headers = request.headers
        if "Upgrade" in headers and not is_own_page(headers.get("Origin"), headers.get("Host")):
            return connection.respond(HTTPStatus.FORBIDDEN, "Only the studio's own page may connect.\n")
        return None if process_request is None else process_request(connection, request)

    return process
