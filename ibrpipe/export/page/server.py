"""One page, served to this machine alone, at an address that nobody guesses."""

from __future__ import annotations

import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from ibrpipe.errors import ResourceError

LOOPBACK = "127.0.0.1"


class PageServer(ThreadingHTTPServer):
    """Serves one page on the loopback address; a context manager that closes the port.

    Parameters
    ----------
    page : str
        HTML text.
    port : int
        0 = any that is free.

    Raises
    ------
    ResourceError
        The port is taken or not permitted.
    """

    daemon_threads = True

    def __init__(self, page: str, port: int = 0) -> None:
        self.content = page.encode("utf-8")
        self.path = f"/{secrets.token_urlsafe(18)}/"
        try:
            super().__init__((LOOPBACK, port), _Handler)
        except OSError as error:
            raise ResourceError(f"port {port}: {error.strerror or error}; give another --port, or none") from error

    @property
    def address(self) -> str:
        """Where the page is found, with the token that it is not given without."""
        return f"http://{LOOPBACK}:{self.server_port}{self.path}"


class _Handler(BaseHTTPRequestHandler):
    """Answers with the page under its one address, and with nothing under any other."""

    server: PageServer
    server_version, sys_version = "ibrpipe", ""

    def do_GET(self) -> None:
        """Send the page."""
        if self._send_head():
            self.wfile.write(self.server.content)

    def do_HEAD(self) -> None:
        """Send what would go before the page."""
        self._send_head()

    def _send_head(self) -> bool:
        # another host's name that leads here is a foreign page that tries to read this one
        own = self.headers.get("Host") == f"{LOOPBACK}:{self.server.server_port}"
        if not own or not secrets.compare_digest(self.path.encode(), self.server.path.encode()):
            self.send_error(HTTPStatus.NOT_FOUND)
            return False
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.content)))
        self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        return True

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing: the terminal belongs to the command."""
