"""A server in a process of its own, and a client without a browser."""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote

_PATIENCE_S = 120.0
_ENTRY = "from quadid_logs.cli import run; run()"


class Running:
    """``quadid-log serve`` on a free port; ends with the block, or is killed."""

    def __init__(self, store: Path, *options: str, port: int = 0, **environment: str) -> None:
        command = [
            sys.executable,
            "-c",
            _ENTRY,
            "serve",
            "--port",
            str(port),
            "--store",
            str(store),
            *options,
        ]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), **environment},
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line.startswith("Open "):
            raise RuntimeError(self.process.communicate(timeout=60.0)[1])
        self.start_address = line.split()[1]
        self.address = self.start_address.split("/start")[0]
        self.host = self.address.removeprefix("http://")
        self.port = int(self.host.rsplit(":", 1)[1])
        self.cookie = ""
        status, headers, _ = self.ask("GET", self.start_address.removeprefix(self.address))
        assert status == 200
        self.cookie = headers["set-cookie"].split(";")[0]

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *_error: object) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(timeout=60.0)
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            stream.close()

    def kill(self) -> None:
        """End it as a power cut does."""
        self.process.kill()
        self.process.wait(timeout=20.0)

    def ask(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Send one request as our page would, and return status, headers and body."""
        connection = http.client.HTTPConnection(self.host, timeout=_PATIENCE_S)
        sent = {"Cookie": self.cookie, **headers}
        if method not in ("GET", "HEAD"):
            sent.setdefault("Origin", self.address)
        try:
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def upload(self, path: Path, name: str = "") -> dict[str, Any]:
        """Drop one log, without a browser."""
        with path.open("rb") as file:
            headers = {"X-Log-Name": quote(name or path.name), "Content-Length": str(path.stat().st_size)}
            status, _, body = self.ask("PUT", "/upload", file, **headers)
        assert status in (200, 201), body
        found: dict[str, Any] = json.loads(body)
        return found

    def entries(self) -> dict[str, Any]:
        """Return the list."""
        found: dict[str, Any] = json.loads(self.ask("GET", "/entries")[2])
        return found

    def wait(self, longest_s: float = _PATIENCE_S) -> list[dict[str, Any]]:
        """Wait until nothing runs or waits, and return the entries."""
        until = time.monotonic() + longest_s
        while time.monotonic() < until:
            entries: list[dict[str, Any]] = self.entries()["entries"]
            if all(entry["state"] not in ("queued", "running") for entry in entries):
                return entries
            time.sleep(0.2)
        raise TimeoutError(f"still at work: {entries}")
