"""A page on loopback with events. Only its address opens it, with a random token.

The page hears events of the server (Server-Sent Events, WHATWG HTML, 9.2) and sends requests (POST). Any other page
in a browser of this machine could ask for both, also by another name for 127.0.0.1, so each request is checked.
"""

from __future__ import annotations

import json
import os
import queue
import secrets
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from vdfmu.base.errors import UsageError
from vdfmu.base.text import to_json

HOST = "127.0.0.1"
PERIOD = 1.0 / 30.0
"""Time between two pictures [s]."""
LOOPBACK = (HOST, "localhost", "::1")
"""Names of the host in requests of this machine, also through a tunnel."""
_TOKEN = 16
"""Random bytes of a token."""
_LARGEST = 1 << 16
"""Bytes of the largest request that is read."""
_WAITING = 1000
"""Events that may wait for a browser. A slower browser is cut off, reconnects, and hears the newest state."""
_TICK = 1.0
"""Time without events after which an empty line checks the connection of a browser [s]."""
_SOCKET = 60.0
"""Time that a browser has for a request, or to take an event [s]."""


class PageServer:
    """Serves one page at a time to all browsers that have its address, on a free port of loopback or the given one.

    `take` is called with each request of the page, an object of JSON whose numbers are floats, in a thread of the
    request; it raises ValueError to refuse it. UsageError if the port is taken.
    """

    def __init__(self, port: int | None = None, take: Callable[[dict[str, Any]], None] = lambda request: None) -> None:
        self.token, self.take = secrets.token_urlsafe(_TOKEN), take
        self.content, self._number = b"", 0
        self._first: Callable[[], Any] = lambda: None
        self._clients: set[queue.Queue[bytes | None]] = set()
        self._lock = threading.Lock()
        try:
            self._server = _Loopback((HOST, port or 0), _handler(self))
        except (OSError, OverflowError) as error:
            text = f"--port {port}: expected a free port of {HOST}, got: {error}. Without it, one is chosen."
            raise UsageError(text) from None
        self.port = self._server.server_address[1]
        self.address = f"http://{HOST}:{self.port}/{self.token}/"
        """Address for a browser."""
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """Number of connected pages."""
        return len(self._clients)

    def show(self, page: bytes, words: str = "", first: Callable[[], Any] = lambda: None) -> None:
        """Serve another page; connected browsers load it at once.

        Its line of the state has `words`. `first` returns the first event of a page, or None, under the lock of
        :meth:`send`.
        """
        with self._lock:
            self._number, self._first = self._number + 1, first
            tag = f'<meta name="live" content="{self._number}" data-words="{escape(words)}">'.encode()
            page = page.replace(b"default-src 'none';", b"default-src 'none'; connect-src 'self';", 1)
            self.content = page.replace(b"</head>", tag + b"</head>", 1)
            self._tell({"page": self._number})

    def send(self, change: Callable[[], Any]) -> None:
        """Send the event that `change` returns to all pages. Meanwhile no page connects, and no other event is sent."""
        with self._lock:
            self._tell(change())

    def _tell(self, event: Any) -> None:
        line = _line(event)
        for client in list(self._clients):
            try:
                client.put_nowait(line)
            except queue.Full:
                self._clients.discard(client)
                with suppress(queue.Empty):
                    client.get_nowait()
                client.put_nowait(None)

    def hear(self, number: str) -> queue.Queue[bytes | None]:
        """Return the events for the page of a number; None ends them."""
        client: queue.Queue[bytes | None] = queue.Queue(_WAITING)
        with self._lock:
            first = self._first() if number == str(self._number) else {"page": self._number}
            if first is not None:
                client.put_nowait(_line(first))
            self._clients.add(client)
        return client

    def leave(self, client: queue.Queue[bytes | None]) -> None:
        """Remove a closed page."""
        with self._lock:
            self._clients.discard(client)

    def refusal(self, path: str, hosts: list[str], origins: list[str]) -> str | None:
        """Return the reason to refuse a request, or None."""
        if len(hosts) != 1 or _name(hosts[0]) not in LOOPBACK:
            return f"Host: expected a name of this machine, such as {HOST}."
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return "Origin: expected the view itself: other pages may not read it."
        token = path.removeprefix("/").partition("?")[0].partition("/")[0]
        if not secrets.compare_digest(token.encode(errors="replace"), self.token.encode()):
            return "Token: expected the whole address that was printed."
        return None

    def close(self) -> None:
        """End the server."""
        with self._lock:
            for client in self._clients:
                with suppress(queue.Full):
                    client.put_nowait(None)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Loopback(ThreadingTCPServer):
    daemon_threads, block_on_close = True, False
    allow_reuse_address = os.name == "posix"  # Windows would take the port of another program

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report errors of the server, but not a closed connection."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


def _handler(owner: PageServer) -> type[BaseHTTPRequestHandler]:
    """Return the class that answers the requests to a server."""

    class Handler(BaseHTTPRequestHandler):
        timeout = _SOCKET
        server_version, sys_version = "vdfmu", ""

        def log_message(self, format: str, *args: Any) -> None:
            """Print nothing."""

        def do_GET(self) -> None:
            """Answer with the page, or with events without end."""
            if self._refused():
                return
            path = urlsplit(self.path)
            match path.path.removeprefix(f"/{owner.token}").strip("/"):
                case "" | "index.html":
                    self._answer(HTTPStatus.OK, owner.content, "text/html; charset=utf-8")
                case "events":
                    self._stream(parse_qs(path.query).get("page", [""])[0])
                case _:
                    self._answer(HTTPStatus.NOT_FOUND, b"There is no such page.\n")

        def do_POST(self) -> None:
            """Take a request of the page."""
            if self._refused():
                return
            length = self.headers.get("Content-Length", "")
            try:
                if not length.isdecimal() or int(length) > _LARGEST:  # Python refuses too many digits
                    raise ValueError
                request = json.loads(self.rfile.read(int(length)), parse_int=float)
                if not isinstance(request, dict):
                    raise ValueError
                owner.take(request)
            except (ValueError, RecursionError):
                self._answer(HTTPStatus.BAD_REQUEST, b"The request must be an object of JSON that this page sends.\n")
            else:
                self._answer(HTTPStatus.NO_CONTENT)

        def _refused(self) -> bool:
            hosts, origins = (self.headers.get_all(name) or [] for name in ("Host", "Origin"))
            why = owner.refusal(self.path, hosts, origins)
            if why is not None:
                self._answer(HTTPStatus.FORBIDDEN, f"{why}\n".encode())
            return why is not None

        def _answer(self, status: HTTPStatus, content: bytes = b"", kind: str = "text/plain; charset=utf-8") -> None:
            self._head(status, kind, {"Content-Length": str(len(content))})
            with suppress(OSError):
                self.wfile.write(content)

        def _head(self, status: HTTPStatus, kind: str, more: dict[str, str]) -> None:
            self.send_response(status)
            facts = {"Content-Type": kind, "Cache-Control": "no-store", "Referrer-Policy": "no-referrer"}
            for name, value in (facts | more).items():
                self.send_header(name, value)
            with suppress(OSError):
                self.end_headers()

        def _stream(self, number: str) -> None:
            self._head(HTTPStatus.OK, "text/event-stream", {"X-Content-Type-Options": "nosniff"})
            client, line = owner.hear(number), b":\n\n"
            with suppress(OSError):
                while line is not None:
                    self.wfile.write(line)
                    try:
                        line = client.get(timeout=_TICK)
                    except queue.Empty:
                        line = b":\n\n"
            owner.leave(client)

    return Handler


def _line(event: Any) -> bytes:
    return f"data: {to_json(event, indent=None)}\n\n".encode()


def _name(host: str) -> str | None:
    """Return the name of a header Host, without its port; None without a name."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
