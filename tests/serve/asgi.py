"""Ask the application itself, without a socket: what a browser sends is all that it gets."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from quadid_logs.serve.app import Server, make_app
from quadid_logs.serve.entries import Entry, State, log_entry
from quadid_logs.serve.events import Pages
from quadid_logs.serve.schedule import Limits, Schedule
from quadid_logs.serve.security import Access, hosts_of
from quadid_logs.serve.store import ServeStore

PORT = 8723
OWN = f"http://127.0.0.1:{PORT}"
SHA = "a" * 64


@dataclass
class Answer:
    """What came back."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def text(self) -> str:
        """The body."""
        return self.body.decode()


class Site:
    """A server that does no work: its queue is never begun."""

    def __init__(self, folder: Path, max_bytes: int = 1_000_000) -> None:
        self.store = ServeStore(folder)
        self.schedule = Schedule(self.store, Limits(n_workers=1, timeout_s=10.0, most_bytes=0))
        self.access = Access(
            hosts=frozenset(hosts_of("127.0.0.1", PORT)), port=PORT, secret=self.store.secret()
        )
        self.app = make_app(
            Server(
                store=self.store,
                schedule=self.schedule,
                access=self.access,
                pages=Pages(),
                max_bytes=max_bytes,
            )
        )

    def ask(
        self,
        path: str,
        method: str = "GET",
        body: Iterable[bytes] = (),
        *,
        cookie: bool = True,
        **headers: str | None,
    ) -> Answer:
        """Ask as our own page does, but for the headers given (None leaves one out)."""
        sent: dict[str, str | None] = {"host": f"127.0.0.1:{PORT}"}
        if cookie:
            sent["cookie"] = f"{self.access.cookie_name}={self.access.cookie}"
        if method != "GET":
            sent["origin"] = OWN
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        return asyncio.run(self._ask(path, method, list(body), sent))

    async def _ask(self, path: str, method: str, body: list[bytes], headers: dict[str, str | None]) -> Answer:
        path, _, query = path.partition("?")
        scope = {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": "1.1",
            "method": method,
            "path": path,
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "scheme": "http",
            "server": ("127.0.0.1", PORT),
            "client": ("127.0.0.1", 50_000),
            "headers": [
                (name.encode(), value.encode()) for name, value in headers.items() if value is not None
            ],
        }
        waiting = [*body, b""]
        sent: list[dict[str, object]] = []

        async def receive() -> dict[str, object]:
            if not waiting:
                await asyncio.Event().wait()
            block = waiting.pop(0)
            return {"type": "http.request", "body": block, "more_body": bool(waiting)}

        async def send(message: dict[str, object]) -> None:
            sent.append(message)

        await self.app(scope, receive, send)  # type: ignore[arg-type]
        begin = next(message for message in sent if message["type"] == "http.response.start")
        found = {name.decode(): value.decode() for name, value in begin["headers"]}  # type: ignore[attr-defined]
        body_sent = b"".join(message.get("body", b"") for message in sent)  # type: ignore[misc]
        return Answer(int(str(begin["status"])), found, body_sent)

    def finished(self, sha256: str = SHA, name: str = "flight.bin", page: str = "<p>report</p>") -> Entry:
        """Put a log with a result into the store and the list."""
        from dataclasses import replace

        self.store.log(sha256).touch(0o600)
        self.store.log(sha256).write_bytes(b"log")
        work = self.store.new_work()
        (work / "report.html").write_text(page)
        (work / "result.json").write_text("{}")
        entry = replace(
            log_entry(sha256, name, 3, -1.0), state=State.DONE, summary={"vehicle": "v", "headline": name}
        )
        self.store.keep(entry, work, None)
        self.schedule.submit(entry)
        return entry


@contextmanager
def site(folder: Path, max_bytes: int = 1_000_000) -> Iterator[Site]:
    """Give a server that does no work."""
    made = Site(folder, max_bytes)
    with made.store:
        yield made
