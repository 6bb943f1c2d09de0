"""Connections without the cookie: they are few, short, and give way to the next.

Whoever reaches the port can open connections and send nothing, or half a
request (slow loris [1]_). A request's head must come within some seconds; of
connections that have not shown the cookie only so many stay open, and the
oldest is closed for the newest. So none of them keeps out the owner, whose
connections do not count.

References
----------
.. [1] RFC 9112, HTTP/1.1, section 9.5: connections may be closed at any time.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any, Final

import h11
from starlette.datastructures import Headers
from uvicorn.protocols.http.h11_impl import H11Protocol

from quadid_logs.serve.security import Access


@dataclass(frozen=True, slots=True, kw_only=True)
class Patience:
    """How long strangers are waited for, and how many.

    Attributes
    ----------
    head_s : float
        For the whole head of a request, from the connection's begin or from its first byte.
    most_strangers : int
        Open connections that have not shown the cookie.
    """

    head_s: float = 10.0
    most_strangers: int = 100


PATIENT: Final = Patience()


def protocol_for(access: Access, patience: Patience) -> type[H11Protocol]:
    """Return the protocol of a server's connections.

    Parameters
    ----------
    access : Access
        Who knows the cookie.

    Returns
    -------
    type
        For ``uvicorn.Config``.
    """
    strangers: dict[_Connection, None] = {}  # a set in the order of coming

    class Connection(_Connection):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.access, self.patience, self.strangers = access, patience, strangers

    return Connection


class _Connection(H11Protocol):
    """A connection that must say who it is."""

    access: Access
    patience: Patience
    strangers: dict[_Connection, None]
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a stranger in, for the oldest where there are too many."""
        super().connection_made(transport)
        self.strangers[self] = None
        if len(self.strangers) > self.patience.most_strangers:
            oldest = next(iter(self.strangers))
            del self.strangers[oldest]
            oldest.transport.abort()
        self._wait_for_head()

    def data_received(self, data: bytes) -> None:
        """See whether the head is complete, and the cookie in it."""
        super().data_received(data)
        if self.conn.their_state is h11.IDLE:
            self._wait_for_head()
            return
        self._stop_waiting()
        if self in self.strangers and self.headers is not None:
            cookies = Headers(raw=self.headers).get("cookie", "")
            if self.access.knows_cookie(cookies):
                del self.strangers[self]

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self.strangers.pop(self, None)
        self._stop_waiting()
        super().connection_lost(exc)

    def _wait_for_head(self) -> None:
        """Begin to wait; more of the same head gives no more time."""
        if self._deadline is None:
            self._deadline = self.loop.call_later(self.patience.head_s, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
