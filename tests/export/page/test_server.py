"""Pages served to this machine alone, and the command that does it."""

from __future__ import annotations

import http.client
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from page_assets import make_asset

from ibrpipe.errors import ResourceError
from ibrpipe.export.page.server import PageServer
from ibrpipe.io.assets import write_asset


@pytest.fixture
def server() -> Iterator[PageServer]:
    with PageServer("<p>grün</p>") as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def ask(address: str, method: str = "GET", path: str | None = None, host: str | None = None):
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=20)
    connection.request(method, path or parts.path, headers={} if host is None else {"Host": host})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer, content


def test_the_page_is_found_by_its_token_alone(server: PageServer) -> None:
    answer, content = ask(server.address)
    assert (answer.status, content.decode()) == (200, "<p>grün</p>")
    assert answer.headers["Cache-Control"] == "no-store"
    assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert ask(server.address, "HEAD")[1] == b""
    for path in ("/", "/index.html", server.path[:-2] + "/", server.path + "../"):
        assert ask(server.address, path=path)[0].status == 404, path
    assert ask(server.address, host="evil.example")[0].status == 404
    assert ask(server.address, "POST")[0].status == 501


def test_addresses_differ_and_taken_ports_are_told(server: PageServer) -> None:
    with PageServer("") as other:
        assert other.path != server.path
        assert len(other.path) > 20
        assert other.server_address[0] == "127.0.0.1"
    with pytest.raises(ResourceError, match="give another --port"):
        PageServer("", server.server_port)


def test_the_command_tells_the_address_and_ends_by_ctrl_c(tmp_path: Path) -> None:
    write_asset(make_asset("matt"), tmp_path / "run/asset")
    command = [sys.executable, "-m", "ibrpipe", "view", str(tmp_path / "run"), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        first = running.stdout.readline()
        answer, content = ask(first.rsplit(" ", 1)[1].strip())
        assert answer.status == 200
        assert b"<h1>run</h1>" in content
        running.send_signal(signal.SIGINT)
        _, told = running.communicate(timeout=60)
    assert running.returncode == 0, told
    assert told == ""
