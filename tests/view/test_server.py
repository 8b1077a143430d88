"""The page's server: this machine alone, by its own names, behind its token, read-only."""

import http.client
import re
import socket
from urllib.parse import urlsplit

import pytest

from torquebench.view.server import serve

PAGE = b"<!doctype html><title>some arm</title>"


@pytest.fixture
def server():
    """The address of a server, in its parts."""
    with serve(PAGE) as address:
        yield urlsplit(address)


def ask(server, path, host=None, method="GET", body=None):
    """Status, headers and body of a request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    connection.putrequest(method, path, skip_host=True)
    connection.putheader("Host", f"127.0.0.1:{server.port}" if host is None else host)
    connection.endheaders()
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read()
    connection.close()
    return found


def other_addresses():
    """Addresses of this machine but for 127.0.0.1: another of the loopback, and where packets to elsewhere leave."""
    found = ["127.0.0.2"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address for documentation: nothing is sent
            found.append(probe.getsockname()[0])
        except OSError:
            found.append("127.1.2.3")
    return found


def test_no_other_address_reaches_it(server):
    """On 127.0.0.1 it answers; on every other address of this machine nothing listens at that port."""
    assert ask(server, server.path)[0] == 200
    for address in other_addresses():
        with socket.socket() as other:
            other.settimeout(5.0)
            assert other.connect_ex((address, server.port)) != 0, address
    with socket.socket(socket.AF_INET6) as other:
        other.settimeout(5.0)
        try:
            reached = other.connect_ex(("::1", server.port)) == 0
        except OSError:
            reached = False
        assert not reached


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:80",
        "127.0.0.1.evil.example",
        "localhost.evil.example",
        "",
        "0.0.0.0",
        "localhost:1:2",
        "192.168.0.1",
    ],
)
def test_other_names_are_refused(server, host):
    """A name that someone else has resolve to 127.0.0.1 gets nothing, whatever the path: 403."""
    for path in (server.path, f"{server.path}report.html", "/"):
        status, _, body = ask(server, path, host)
        assert status == 403
        assert b"arm" not in body


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "localhost:8123", "127.0.0.1:9"])
def test_its_own_names_are_answered(server, host):
    """At any port: a tunnel's other end has another one."""
    assert ask(server, server.path, host)[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/report.html",
        "/wrong/",
        "/wrong/report.html",
        "{token}",
        "{token}x/",
        "{token}/../arm.py",
        "{token}/../../errors.py",
        "{token}/report.html",
        "{token}/nothing.js",
    ],
)
def test_without_the_token_or_elsewhere_there_is_nothing(server, path):
    """Not the page, and no file at all."""
    status, _, body = ask(server, path.format(token=server.path.rstrip("/")))
    assert (status, body) == (404, b"nothing here")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "HEAD"])
def test_only_reading(server, method):
    """Nothing but GET is known."""
    assert ask(server, server.path, method=method)[0] == 501


def test_the_page_may_load_nothing_from_elsewhere(server):
    """It comes as it is, under a policy that allows no connection and no frame."""
    status, headers, body = ask(server, server.path)
    assert (status, headers["Content-Type"], body) == (200, "text/html; charset=utf-8", PAGE)
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "connect-src" not in policy
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_each_server_has_a_token_of_its_own(server):
    """The path begins with at least 20 random characters; another server's are others."""
    with serve(PAGE) as other:
        paths = [urlsplit(other).path, server.path]
    assert paths[0] != paths[1]
    assert all(re.fullmatch(r"/[\w-]{20,}/", path) for path in paths)


def test_closed_it_is_gone():
    """After the context the port is free again."""
    with serve(PAGE) as address:
        port = urlsplit(address).port
    with socket.socket() as again:
        assert again.connect_ex(("127.0.0.1", port)) != 0


def test_what_the_page_links_is_there_and_nothing_else_of_its_folder(tmp_path):
    """A file given under a name comes with its bytes and a policy that runs nothing; no other path leads there."""
    (tmp_path / "a law").mkdir()
    (tmp_path / "a law" / "figure.svg").write_bytes(b"<svg/>")
    (tmp_path / "secret.txt").write_bytes(b"secret")
    files = {"a law/figure.svg": tmp_path / "a law" / "figure.svg", "gone.json": tmp_path / "gone.json"}
    with serve(PAGE, files=files) as address:
        server = urlsplit(address)
        status, headers, body = ask(server, f"{server.path}a%20law/figure.svg")
        assert (status, headers["Content-Type"], body) == (200, "image/svg+xml", b"<svg/>")
        assert "sandbox" in headers["Content-Security-Policy"]
        assert "script" not in headers["Content-Security-Policy"]
        for path in ("gone.json", "secret.txt", "a%20law/../secret.txt", "..%2fsecret.txt", "a%20law", "%00"):
            assert ask(server, server.path + path)[0] == 404, path
        assert ask(server, "/a%20law/figure.svg")[0] == 404  # without the token
