"""Access to a view: only by its address, which holds a random token, and not from other pages in a browser.

viser answers whoever reaches its port. Any page that is open in a browser of this machine does, over a websocket or
with its own name for 127.0.0.1, so its requests are checked before viser sees them.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names by which a browser on this machine, or at the other end of a tunnel, asks for the view."""
_TOKEN = 16
"""Random bytes of a token."""
_lock = threading.Lock()


class Guard:
    """Conditions on a request: the token as first part of its path, a name of loopback, no foreign origin."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(_TOKEN)
        self.placed = False
        """Whether a server uses it."""

    def refusal(self, request: Request) -> tuple[HTTPStatus, str] | None:
        """Return why a request is refused, if it is; remove the token from the path of others."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or _name(hosts[0]) not in LOOPBACK:
            return HTTPStatus.FORBIDDEN, f"Host: expected a name of this machine, such as {LOOPBACK[0]}."
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return HTTPStatus.FORBIDDEN, "Origin: expected the view itself: other pages may not read it."
        path, question, query = request.path.partition("?")
        token, _, rest = path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(errors="replace"), self.token.encode()):
            return HTTPStatus.FORBIDDEN, "Token: expected the whole address that was printed."
        request.path = f"/{rest}{question}{query}"
        return None

    @contextmanager
    def placed_before(self, module: str) -> Generator[None]:
        """Make servers that a module starts meanwhile ask this guard first.

        viser has no hook for it; the library of its websockets has one, which is set here as the server starts.
        """
        plain = websocket_server.serve

        def serve(handler: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
            if handler.__module__ == module:
                options["process_request"] = self._before(options.get("process_request"))
                self.placed = True
            return plain(handler, *arguments, **options)

        with _lock:
            websocket_server.serve = serve  # type: ignore[assignment]
            try:
                yield
            finally:
                websocket_server.serve = plain

    def _before(self, process: Callable[[ServerConnection, Request], Any] | None) -> Callable[..., Any]:
        def asked(connection: ServerConnection, request: Request) -> Response | Any:
            refused = self.refusal(request)
            if refused is not None:
                status, why = refused
                return connection.respond(status, f"{why}\n")
            return None if process is None else process(connection, request)

        return asked


def _name(host: str) -> str | None:
    """Return the name of a header Host, without its port; None if it has none."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
