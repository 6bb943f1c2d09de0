"""An autopilot in one file: the template of `docs/extending.md`, and run by `test_toy.py`.

Its log is text: a line ``TOY1``, then lines that begin with the name of a message.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from quadid_logs.arrays import AnyArray, IntArray
from quadid_logs.autopilots import Autopilot, LogFormat
from quadid_logs.autopilots.sources import Part, Source, build_signals
from quadid_logs.data.log import FlightLog, LostBytes, Rows
from quadid_logs.errors import EmptyLogError


# A container: bytes to rows of messages, without their meaning. Nothing that a file can hold may
# raise anything but a LogError; what cannot be read is counted as lost.
class ToyTable:
    """The rows of one message: where in the file, and its numbers."""

    def __init__(self, lines: list[tuple[int, list[float]]]) -> None:
        self.position: IntArray = np.array([at for at, _ in lines], dtype=np.int64)
        self._cells = np.array([cells for _, cells in lines], dtype=np.float64)

    def column(self, field: str) -> AnyArray | None:
        """Return a field of every row: the name of a column of this format is its number."""
        number = int(field)
        return self._cells[:, number] if number < self._cells.shape[1] else None


def read_tables(content: bytes) -> tuple[dict[str, ToyTable], list[LostBytes]]:
    """Return the messages by name, and the lines that are none."""
    lines: dict[str, list[tuple[int, list[float]]]] = {}
    lost, at = [], 0
    for number, line in enumerate(content.splitlines(keepends=True)):
        name, *cells = line.decode("ascii", errors="replace").split()[:20] or [""]
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            values = []
        known = lines.get(name, [])
        if values and (not known or len(known[0][1]) == len(values)):
            lines.setdefault(name, []).append((at, values))
        elif number:
            lost.append(LostBytes(offset=at, n_bytes=len(line), reason="no message"))
        at += len(line)
    return {name: ToyTable(found) for name, found in lines.items()}, lost


# The meaning: one row per source of a signal, the preferred one of each signal first. Names, units and
# signs of the signals are those of quadid_logs.vocabulary; a scale or a builder brings the fields there.
SOURCES: tuple[Source[Part[ToyTable]], ...] = (
    Source("body_rate", "GYRO", ("1", "2", "3"), "the rate controller's own input", scale=np.pi / 180.0),
    Source("torque_command", "CMD", ("1", "2", "3"), "the rate controller's output", scale=0.01),
    Source("throttle", "CMD", ("4",), "the altitude controller's output", scale=0.01),
)


def read(path: str | Path, *, system: int = 0) -> FlightLog:
    """Read a toy log."""
    content = Path(path).read_bytes()
    tables, lost = read_tables(content)
    if not tables:
        raise EmptyLogError(f"{path} holds no message.", hint="Fly first.")
    # One Rows per message: its signals all have it, and with it all that is found out about the clock.
    parts = {
        name: [Part(name=name, table=table, rows=Rows(time_ms / 1e3, table.position))]
        for name, table in tables.items()
        if (time_ms := table.column("0")) is not None
    }
    return FlightLog(
        path=str(path),
        format="toy",
        autopilot="toy",
        n_bytes=len(content),
        signals=build_signals(SOURCES, lambda source: parts.get(source.message, [])),
        vehicle_type="multirotor",
        lost=tuple(lost),
    )


class Toy(Autopilot):
    """What is not overridden (airframe, mixer, loop rate, advice) counts as not known."""

    name = "toy"
    title = "Toy autopilot"

    def formats(self) -> tuple[LogFormat, ...]:
        """Tell a file by its first bytes."""
        return (LogFormat("toy", "toy log", lambda head: head.startswith(b"TOY1"), read, (".toy",)),)


AUTOPILOT = Toy()
