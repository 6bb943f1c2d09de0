"""The whole server as a process: killed, begun again, refused, and as large as an upload lets it become."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import socket
from pathlib import Path
from types import SimpleNamespace

import pytest

from quadid_logs import analyze, result_dict
from quadid_logs.serve.app import Server
from quadid_logs.serve.events import Pages
from quadid_logs.serve.server import _leave_when_idle
from tests.conftest import REPOSITORY
from tests.serve.asgi import site
from tests.serve.running import Running

LOGS = REPOSITORY / "sample_logs"


def without_circumstances(content: dict[str, object]) -> dict[str, object]:
    """Leave out of result.json how long it took and where the log lay."""
    kept = {key: value for key, value in content.items() if key not in ("tool", "timings_s")}
    log = kept["log"]
    assert isinstance(log, dict)
    return {**kept, "log": {key: value for key, value in log.items() if key != "path"}}


def test_a_killed_server_goes_on_where_it_was(tmp_path: Path) -> None:
    """Every log has exactly one result in the end, equal to the command line's; an open page stays let in."""
    store = tmp_path / "store"
    copy = shutil.copy(LOGS / "doublets.tlog", tmp_path / "copy.tlog")
    with Running(store, "--workers", "1") as first:
        for path in (LOGS / "doublets.tlog", LOGS / "default-logging.bin", Path(copy)):
            first.upload(path)
        first.kill()
    with Running(store, "--workers", "1", port=first.port) as second:
        second.cookie = first.cookie
        entries = {entry["name"]: entry for entry in second.wait()}
        assert {name: entry["state"] for name, entry in entries.items()} == {
            "doublets.tlog": "done",
            "default-logging.bin": "done",
        }
        path = f"/reports/{entries['default-logging.bin']['id']}/files/result.json"
        served = json.loads(second.ask("GET", path)[2])
        expected = json.loads(json.dumps(result_dict(analyze(LOGS / "default-logging.bin"))))
        assert without_circumstances(served) == without_circumstances(expected)
    assert len(list((store / "results").iterdir())) == 2
    assert not list((store / "work").iterdir())


def test_uploads_take_no_memory_and_ten_gigabytes_are_refused_at_once(tmp_path: Path) -> None:
    """The body goes to the disk block by block; what declares too much is refused before it is sent."""
    psutil = pytest.importorskip("psutil")
    noise = tmp_path / "noise.bin"
    with noise.open("wb") as file:
        for number in range(64):
            file.write(bytes([number]) * (1 << 20))
    with Running(tmp_path / "store", "--workers", "1") as server:
        process = psutil.Process(server.process.pid)
        before = process.memory_info().rss
        assert server.upload(noise)["state"] in ("queued", "running", "failed")
        assert process.memory_info().rss - before < 20e6
        with socket.create_connection(("127.0.0.1", server.port), timeout=10.0) as connection:
            head = (
                f"PUT /upload HTTP/1.1\r\nHost: {server.host}\r\nOrigin: {server.address}\r\n"
                f"Cookie: {server.cookie}\r\nContent-Length: 10000000000\r\n\r\n"
            )
            connection.sendall(head.encode())
            assert connection.recv(100).startswith(b"HTTP/1.1 413")


@pytest.mark.thorough
def test_a_port_that_is_taken_ends_with_one_line(tmp_path: Path) -> None:
    """And says what to do."""
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(RuntimeError, match="Choose another --port") as refused,
    ):
        Running(tmp_path / "store", port=taken.getsockname()[1])
    assert str(refused.value).count("\n") == 1


@pytest.mark.parametrize(("n_open", "ended"), [(0, True), (1, False)])
def test_a_server_that_nobody_looks_at_ends(tmp_path: Path, n_open: int, ended: bool) -> None:
    """When there is nothing to do, and not while a page is open."""
    left: list[bool] = []
    with site(tmp_path / "store") as own:
        pages = Pages()
        pages.n_open = n_open
        shared = Server(store=own.store, schedule=own.schedule, access=own.access, pages=pages, max_bytes=1)
        listener = SimpleNamespace(leave=lambda: left.append(True))
        watching = _leave_when_idle(listener, shared, 0.02)  # type: ignore[arg-type]
        with contextlib.suppress(TimeoutError):
            asyncio.run(asyncio.wait_for(watching, 60.0 if ended else 0.2))
    assert bool(left) is ended
