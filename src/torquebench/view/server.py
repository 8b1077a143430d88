"""The local web server of a run's page: it answers this machine alone, under its own names, below a secret path."""

from __future__ import annotations

import re
import secrets
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

HOST = "127.0.0.1"
NAMES = ("127.0.0.1", "localhost")
"""Host names that are answered; any other one was made to resolve to this machine by a page elsewhere."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; media-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
INERT = {"Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"}
"""Of files beside the page, in which nothing runs."""
KINDS = {
    ".json": "application/json",
    ".yaml": "text/plain; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".pdf": "application/pdf",
    ".mp4": "video/mp4",
}
"""Types of files by the ends of their names; others are offered for keeping."""


@contextmanager
def serve(page: bytes, port: int = 0, files: Mapping[str, Path] | None = None) -> Iterator[str]:
    """Serve a page while this context lasts; yield its address.

    Every user of this machine can reach 127.0.0.1, so the path begins with a random token that only the caller knows.

    Args:
        page: The page of a run, whose own policy names the scripts that may run.
        port: Port to listen on; 0 for a free one.
        files: What the page links, by its relative address; nothing else of any folder is shown.

    Raises:
        OSError: the port is taken.
    """
    token = secrets.token_urlsafe(16)
    paths = {f"/{token}/{name}": file for name, file in (files or {}).items()}
    server = _Server((HOST, port), partial(_Handler, f"/{token}/", page, paths))
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{server.server_address[1]}/{token}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: Any, client_address: Any) -> None:
        """Stay quiet when a browser closes its connection."""


class _Handler(BaseHTTPRequestHandler):
    server_version, sys_version = "torquebench", ""
    protocol_version = "HTTP/1.1"
    timeout = 60.0

    def __init__(self, path: str, page: bytes, files: Mapping[str, Path], *rest: Any) -> None:
        self._path, self._page, self._files = path, page, files
        super().__init__(*rest)  # answers the request

    def do_GET(self) -> None:
        if re.sub(r":\d+$", "", self.headers.get("Host", "")) not in NAMES:
            return self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"this server answers to 127.0.0.1 and localhost")
        if self.path == self._path:
            return self._answer(HTTPStatus.OK, "text/html; charset=utf-8", self._page)
        file = self._files.get(unquote(self.path))
        try:
            content = None if file is None else file.read_bytes()
        except OSError:
            content = None
        if file is None or content is None:
            return self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"nothing here")
        return self._answer(HTTPStatus.OK, KINDS.get(file.suffix, "application/octet-stream"), content, INERT)

    def _answer(self, status: HTTPStatus, kind: str, content: bytes, more: Mapping[str, str] = HEADERS) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **more, "Content-Type": kind, "Content-Length": str(len(content))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Stay quiet: the terminal belongs to the command."""
