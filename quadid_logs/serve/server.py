"""Listen, serve, and end: on Ctrl-C, or when nobody has looked for long."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Final
from urllib.parse import urlencode

import uvicorn

from quadid_logs.errors import SettingsError
from quadid_logs.serve.app import Server, make_app
from quadid_logs.serve.connections import PATIENT, Patience, protocol_for
from quadid_logs.serve.events import Pages
from quadid_logs.serve.schedule import Limits, Schedule
from quadid_logs.serve.security import Access, hosts_of, is_loopback
from quadid_logs.serve.store import ServeStore
from quadid_logs.untrusted import printable

DEFAULT_PORT: Final = 8723
#: Of a token that the owner chooses: 16 characters of a word that nobody guesses at the rate that is allowed.
LEAST_TOKEN: Final = 16
#: Of the machine's memory, all analyses together; as the fleet's workers.
_MEMORY_FRACTION: Final = 0.9
#: How often it is asked whether anybody still looks [s].
_LOOK_S: Final = 5.0
#: Open requests get so long when the server ends [s].
_GRACE_S: Final = 2
_ANY: Final = frozenset({"0.0.0.0", "::"})  # noqa: S104 - to recognise it


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeSettings:
    """How to serve.

    Attributes
    ----------
    folder : Path
        The store.
    port : int
        0 takes a free one.
    host : str
        "" listens on this machine's loopback addresses only.
    token : str
        "" makes a new one at every start; another address than loopback needs one that was chosen.
    max_bytes : int
        Of one log.
    timeout_s : float
        Of one analysis.
    idle_s : float
        After so long without an open page and without work the server ends; 0 for never.
    n_workers : int
        Analyses at a time; 0 for as many as there are cores.
    """

    folder: Path
    port: int = DEFAULT_PORT
    host: str = ""
    token: str = field(default="", repr=False)
    max_bytes: int = 4_000_000_000
    timeout_s: float = 1800.0
    idle_s: float = 0.0
    n_workers: int = 0


def default_folder() -> Path:
    """Return where logs and results are kept unless told otherwise: the user's folder for data."""
    if os.name == "nt":
        parent = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        parent = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    return parent / "quadid-logs" / "serve"


def serve(settings: ServeSettings, began: Callable[[str], None]) -> None:
    """Serve until told to end.

    Parameters
    ----------
    began : callable
        Called with the address to open, token included, once the server listens.

    Raises
    ------
    SettingsError
        If the address is taken, or needs a token, or another server has the store.
    OutputError
        If the store cannot be written.
    """
    _check(settings)
    sockets = _listening(settings.host, settings.port)
    try:
        port = sockets[0].getsockname()[1]
        shown = "127.0.0.1" if not settings.host or settings.host in _ANY else settings.host
        address = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}"
        with ServeStore(settings.folder, address) as store:
            access = _access(settings, store, port)
            schedule = Schedule(store, _limits(settings))
            asyncio.run(
                _run(
                    settings,
                    sockets,
                    Server(
                        store=store,
                        schedule=schedule,
                        access=access,
                        pages=Pages(),
                        max_bytes=settings.max_bytes,
                    ),
                    lambda: began(f"{address}/start?{urlencode({'token': access.token})}"),
                )
            )
    finally:
        for each in sockets:
            each.close()


def _check(settings: ServeSettings) -> None:
    """Refuse to let others in without a word that they must know."""
    if not settings.host or is_loopback(settings.host):
        return
    if len(settings.token) < LEAST_TOKEN:
        raise SettingsError(
            f"Anyone who reaches {printable(settings.host)} can read your logs. Set a token of "
            f"{LEAST_TOKEN} characters or more.",
            hint=(
                "Put it into the environment as QUADID_SERVE_TOKEN. The connection is not encrypted. For "
                "an encrypted one, leave --host out and use a tunnel (ssh -L)."
            ),
        )


def _access(settings: ServeSettings, store: ServeStore, port: int) -> Access:
    """Return who may come in."""
    hosts = frozenset(hosts_of(settings.host or "127.0.0.1", port))
    shared = {"hosts": hosts, "port": port, "secret": store.secret(), "any_address": settings.host in _ANY}
    if not settings.token:
        return Access(**shared)  # type: ignore[arg-type]
    return Access(**shared, token=settings.token, salt=settings.token)  # type: ignore[arg-type]


def _limits(settings: ServeSettings) -> Limits:
    """Give each analysis its fraction of the machine."""
    n_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    n_workers = settings.n_workers or n_cores
    memory = 0
    if os.name == "posix":
        with contextlib.suppress(ValueError, OSError):
            memory = int(_MEMORY_FRACTION * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return Limits(n_workers=n_workers, timeout_s=settings.timeout_s, most_bytes=memory // n_workers)


def _listening(host: str, port: int) -> list[socket.socket]:
    """Return sockets that listen: on both loopback addresses unless another one is wanted."""
    sockets: list[socket.socket] = []
    for each in (host,) if host else ("127.0.0.1", "::1"):
        family = socket.AF_INET6 if ":" in each else socket.AF_INET
        listening = socket.socket(family, socket.SOCK_STREAM)
        try:
            if os.name == "posix":
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                listening.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            listening.bind((each, sockets[0].getsockname()[1] if sockets else port))
            listening.listen(64)
        except OSError as error:
            listening.close()
            if sockets:  # no IPv6 on this machine
                continue
            raise SettingsError(
                f"{printable(each)} port {port} cannot be used: {error.strerror or error}.",
                hint="Choose another --port, or 0 for a free one.",
            ) from error
        sockets.append(listening)
    return sockets


class _Uvicorn(uvicorn.Server):
    """Ends the open pages' events first: they would keep it waiting."""

    def __init__(self, config: uvicorn.Config, pages: Pages) -> None:
        super().__init__(config)
        self._pages = pages

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Listen to signals; unlike the original they are not raised again: they have done their work."""
        handlers = {each: signal.signal(each, self.handle_exit) for each in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for each, handler in handlers.items():
                signal.signal(each, handler)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End on a signal, once what is open had its time."""
        self._pages.closing.set()
        super().handle_exit(sig, frame)

    def leave(self) -> None:
        """End without one."""
        self._pages.closing.set()
        self.should_exit = True


def _config(server: Server, patience: Patience) -> uvicorn.Config:
    """Return how connections are listened to."""
    return uvicorn.Config(
        make_app(server),
        access_log=False,
        server_header=False,
        proxy_headers=False,
        lifespan="off",
        http=protocol_for(server.access, patience),
        ws="none",
        log_level="warning",
        timeout_graceful_shutdown=_GRACE_S,
    )


async def _run(
    settings: ServeSettings, sockets: list[socket.socket], server: Server, began: Callable[[], None]
) -> None:
    """Serve, beside the queue's threads and a look now and then at whether anybody is there."""
    listener = _Uvicorn(_config(server, PATIENT), server.pages)
    server.schedule.start()
    watch = asyncio.create_task(_leave_when_idle(listener, server, settings.idle_s))
    began()
    try:
        await listener.serve(sockets=sockets)
    finally:
        watch.cancel()
        await asyncio.to_thread(server.schedule.stop)


async def _leave_when_idle(listener: _Uvicorn, server: Server, idle_s: float) -> None:
    """End the server when no page was open and nothing was to be done for long."""
    seen_s = time.monotonic()
    while idle_s > 0.0:
        await asyncio.sleep(min(_LOOK_S, idle_s))
        if server.pages.n_open or not server.schedule.is_idle:
            seen_s = time.monotonic()
        elif time.monotonic() - seen_s >= idle_s:
            listener.leave()
            return
