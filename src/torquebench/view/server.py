"""The local server of the page: this machine alone, names of this machine alone, behind a token."""

from __future__ import annotations

import re
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from types import TracebackType
from typing import Any

from torquebench.view.feed import Feed

HOST = "127.0.0.1"
NAMES = ("127.0.0.1", "localhost")
"""Names that a browser may know this machine by; any other is a page elsewhere that had its name resolve to here."""
PATIENCE = 2.0
"""How long a request for messages waits for one [s]."""
PAGES = {
    "": ("index.html", "text/html; charset=utf-8"),
    "view.css": ("view.css", "text/css; charset=utf-8"),
    "geometry.js": ("geometry.js", "text/javascript; charset=utf-8"),
    "drawing.js": ("drawing.js", "text/javascript; charset=utf-8"),
    "view.js": ("view.js", "text/javascript; charset=utf-8"),
}
"""Path below the token -> file in ``page`` and its type."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Server:
    """Serves a `Feed` and its page until closed; a context manager.

    Every user of this machine can reach 127.0.0.1, hence the token: a path that only who started the server knows.

    Args:
        feed: What is served.
        token: Part of the path; letters, digits, ``-`` and ``_``.
        port: Port to use; 0 for a free one.

    Raises:
        OSError: the port is taken.
    """

    def __init__(self, feed: Feed, token: str, port: int = 0) -> None:
        self._http = _Http((HOST, port), _Handler, feed, token)
        self.port = int(self._http.server_address[1])
        self.address = f"http://{HOST}:{self.port}/{token}/"
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.1,), daemon=True)

    def __enter__(self) -> Server:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler], feed: Feed, token: str) -> None:
        self.feed, self.token = feed, token
        super().__init__(address, handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a browser that went away."""


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    server_version, sys_version = "torquebench", ""
    protocol_version = "HTTP/1.1"
    timeout = 60.0

    def do_GET(self) -> None:
        name = re.sub(r":\d+$", "", self.headers.get("Host", ""))
        if name not in NAMES:
            return self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"this server answers to 127.0.0.1 and localhost")
        begin, slash, wanted = self.path.removeprefix("/").partition("/")
        found = re.fullmatch(r"messages/(\d{1,9})", wanted)
        if begin != self.server.token or not slash or (found is None and wanted not in PAGES):
            return self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"nothing here")
        if found is not None:
            feed, first = self.server.feed, int(found[1])
            feed.told(first)
            return self._answer(HTTPStatus.OK, "application/json", feed.since(first, PATIENCE))
        file, kind = PAGES[wanted]
        return self._answer(HTTPStatus.OK, kind, (resources.files("torquebench.view") / "page" / file).read_bytes())

    def _answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in (HEADERS | {"Content-Type": kind, "Content-Length": str(len(content))}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Keep quiet: the terminal belongs to the command."""
