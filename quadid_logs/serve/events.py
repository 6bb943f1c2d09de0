"""Server-sent events [1]_: everything once, then what changes, and how far the running jobs are.

References
----------
.. [1] https://html.spec.whatwg.org/multipage/server-sent-events.html
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any, Final

from quadid_logs.serve.schedule import Changes, Schedule

#: How often progress is told while something runs [s].
_TICK_S: Final = 0.5
#: A sign of life where nothing changes [s]; without it nobody would notice a closed page.
_ALIVE_S: Final = 15.0


class Pages:
    """The open pages: counted, so that a server that nobody looks at can end, and ended with it."""

    def __init__(self) -> None:
        self.n_open = 0
        self.closing = asyncio.Event()

    async def events(self, schedule: Schedule) -> AsyncIterator[str]:
        """Yield events for one page, until it is closed or the server ends."""
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            loop.call_soon_threadsafe(changed.set)

        self.n_open += 1
        schedule.listeners.add(wake)
        try:
            since = 0
            while not self.closing.is_set():
                changed.clear()
                found = schedule.changes(since)
                # One event; JSON holds no line break that would end it.
                yield f"data: {json.dumps(changes_dict(found, is_all=(not since)))}\n\n"
                since = found.version
                await self._wait(changed, _TICK_S if found.running else _ALIVE_S)
        finally:
            schedule.listeners.discard(wake)
            self.n_open -= 1

    async def _wait(self, changed: asyncio.Event, longest_s: float) -> None:
        """Wait for a change, the end of the server, or the next tick."""
        waits = [asyncio.ensure_future(event.wait()) for event in (changed, self.closing)]
        try:
            await asyncio.wait(waits, timeout=longest_s, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for each in waits:
                each.cancel()


def changes_dict(found: Changes, *, is_all: bool) -> dict[str, Any]:
    """Return what a page has to learn, ready for JSON."""
    return {
        "all": is_all,
        "entries": [entry.shown() for entry in found.entries],
        "gone": list(found.gone),
        "running": dict(found.running),
        "waiting": found.n_waiting,
        "left_s": round(found.left_s, 1),
    }
