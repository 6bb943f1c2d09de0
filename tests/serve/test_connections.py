"""Who never shows the cookie keeps nobody out: real sockets on loopback, and little patience."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn

from quadid_logs.serve import app as app_module
from quadid_logs.serve import lingering, security
from quadid_logs.serve import upload as upload_module
from quadid_logs.serve.app import Server
from quadid_logs.serve.connections import Patience
from quadid_logs.serve.events import Pages
from quadid_logs.serve.security import Access, hosts_of
from quadid_logs.serve.server import _config, _listening
from tests.serve.asgi import Site, site

HEAD_S = 0.5
MOST = 8


class Listening:
    """A server on a free port that does no work."""

    def __init__(self, own: Site, listener: uvicorn.Server, port: int, access: Access) -> None:
        self.own, self.listener, self.port, self.access = own, listener, port, access

    def connect(self) -> socket.socket:
        """Open a connection."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=5.0)

    def ask(self, path: str = "/entries", *, cookie: bool = True) -> tuple[int, dict[str, str]]:
        """Ask with the cookie, on a connection of its own."""
        asked = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5.0)
        try:
            asked.request("GET", path, headers=self.cookie if cookie else {})
            answer = asked.getresponse()
            answer.read()
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}
        finally:
            asked.close()

    @property
    def cookie(self) -> dict[str, str]:
        """The header that lets the owner in."""
        return {"Cookie": f"{self.access.cookie_name}={self.access.cookie}"}


@pytest.fixture
def listening(tmp_path: Path) -> Iterator[Listening]:
    """Give a server that waits half a second for a head, and for eight strangers."""
    (listens, *others) = _listening("127.0.0.1", 0)
    assert not others
    port = listens.getsockname()[1]
    with site(tmp_path / "store") as own:
        access = Access(hosts=frozenset(hosts_of("127.0.0.1", port)), port=port, secret=own.store.secret())
        server = Server(
            store=own.store, schedule=own.schedule, access=access, pages=Pages(), max_bytes=1_000_000
        )
        listener = uvicorn.Server(_config(server, Patience(head_s=HEAD_S, most_strangers=MOST)))
        thread = threading.Thread(target=listener.run, kwargs={"sockets": [listens]}, daemon=True)
        thread.start()
        try:
            yield Listening(own, listener, port, access)
        finally:
            listener.should_exit = True
            thread.join(timeout=20.0)
            listens.close()


def is_closed(connection: socket.socket, within_s: float = 5.0) -> bool:
    """Say whether the other end closes a connection in time."""
    connection.settimeout(within_s)
    try:
        while connection.recv(4096):
            pass
    except TimeoutError:
        return False
    except OSError:
        return True
    return True


@pytest.mark.parametrize("sent", [b"", b"GET / HTT", b"GET / HTTP/1.1\r\nHost: a\r\nX-Slow: "])
def test_half_a_request_is_waited_for_a_short_time(listening: Listening, sent: bytes) -> None:
    """It used to stay open for ever, however little of it had come."""
    with listening.connect() as half:
        half.sendall(sent)
        assert is_closed(half)


def test_a_head_that_comes_drop_by_drop_gets_no_more_time(listening: Listening) -> None:
    """A byte now and then kept it alive."""
    with listening.connect() as slow:
        began = time.monotonic()
        with contextlib.suppress(OSError):
            while time.monotonic() - began < 20.0 * HEAD_S:
                slow.sendall(b"G")
                time.sleep(HEAD_S / 5.0)
        assert time.monotonic() - began < 10.0 * HEAD_S


def test_strangers_never_keep_the_owner_out(listening: Listening) -> None:
    """200 half requests without a token made every answer a 503, for as long as they liked."""
    with contextlib.ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(listening.connect()).sendall(b"GET / HTTP/1.1\r\n")
        assert listening.ask()[0] == 200
        assert listening.ask(f"/start?token={listening.access.token}", cookie=False)[0] == 200


def test_the_oldest_stranger_goes_for_the_newest(listening: Listening) -> None:
    """So that whoever comes with the token now can always show it."""
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(listening.connect())
        for _ in range(MOST):
            stack.enter_context(listening.connect())
        began = time.monotonic()
        assert is_closed(first)
        assert time.monotonic() - began < 0.8 * HEAD_S


def test_a_connection_that_showed_the_cookie_is_no_stranger(listening: Listening) -> None:
    """However many come after it, it stays: a page hears of its jobs through one."""
    page = http.client.HTTPConnection("127.0.0.1", listening.port, timeout=5.0)
    page.request("GET", "/events", headers=listening.cookie)
    answer = page.getresponse()
    with contextlib.ExitStack() as stack:
        for _ in range(3 * MOST):
            stack.enter_context(listening.connect())
        time.sleep(2.0 * HEAD_S)
        assert answer.status == 200
        assert not is_closed(page.sock, 0.2)
    page.close()


def test_the_body_of_a_question_is_waited_for_a_short_time(
    listening: Listening, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page that takes the token takes a body from everybody."""
    monkeypatch.setattr(app_module, "_BODY_S", 0.3)
    host = f"127.0.0.1:{listening.port}"
    head = f"POST /start HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nContent-Length: 9\r\n\r\n"
    with listening.connect() as half:
        half.sendall(head.encode() + b"tok")
        assert half.recv(4096).startswith(b"HTTP/1.1 408 ")


def test_too_many_requests_at_once_are_told_to_come_again(
    listening: Listening, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few seconds later there is room."""
    monkeypatch.setattr(security, "_MOST_REQUESTS", 0)
    status, headers = listening.ask()
    assert (status, int(headers["retry-after"]) > 0) == (503, True)


def put(listening: Listening, n_bytes: int, **headers: str) -> tuple[int, dict[str, str], bytes]:
    """Send a log as a browser does: all of it, then look at the answer."""
    asked = http.client.HTTPConnection("127.0.0.1", listening.port, timeout=20.0)
    try:
        origin = f"http://127.0.0.1:{listening.port}"
        asked.request("PUT", "/upload", b"x" * n_bytes, {"Origin": origin, **listening.cookie, **headers})
        answer = asked.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        asked.close()


def test_an_upload_that_is_too_large_gets_its_reason(listening: Listening) -> None:
    """It used to be cut off while it was sent, which says nothing: the page tried again for ever."""
    status, _, body = put(listening, 30_000_000)
    assert (status, json.loads(body)["error"]) == (413, "The log is larger than 1 MB (--max-mb).")


def test_an_upload_that_finds_the_disk_full_gets_its_reason(
    listening: Listening, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first look at the disk refuses it."""
    monkeypatch.setattr(listening.own.store, "free_bytes", lambda: 0)
    status, _, body = put(listening, 900_000)
    assert (status, json.loads(body)["error"]) == (507, "The disk of this server is nearly full.")


def test_an_upload_beside_too_many_is_told_when_to_come_again(
    listening: Listening, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In seconds, and with the reason."""
    monkeypatch.setattr(upload_module, "_MOST_AT_ONCE", 0)
    status, headers, body = put(listening, 900_000)
    assert (status, int(headers["retry-after"]) > 0) == (503, True)
    assert json.loads(body)["error"] == "Too many uploads at once. Try again."


def test_an_upload_without_the_cookie_of_this_server_gets_its_reason(listening: Listening) -> None:
    """After a restart with another token, say."""
    status, _, body = put(listening, 30_000_000, Cookie="none=1")
    assert (status, body) == (401, b"Open the address that quadid-log serve printed.")


def test_who_is_refused_and_sends_for_ever_is_cut_off(
    listening: Listening, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is dropped costs a connection, for some seconds."""
    monkeypatch.setattr(lingering, "_LINGER_S", 0.3)
    with listening.connect() as endless:
        host = f"127.0.0.1:{listening.port}"
        head = f"PUT /upload HTTP/1.1\r\nHost: {host}\r\nContent-Length: 10000000000\r\n\r\n"
        endless.sendall(head.encode())
        began = time.monotonic()
        with contextlib.suppress(OSError):
            while time.monotonic() - began < 10.0:
                endless.sendall(b"x" * 100_000)
        assert time.monotonic() - began < 5.0
