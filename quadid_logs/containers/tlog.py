"""MAVLink telemetry logs: messages as columns, systems told apart, one clock.

A bare MAVLink stream without host stamps is read the same way.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray, IntArray
from quadid_logs.containers.content import FileParts, rows_at
from quadid_logs.containers.mavlink_clock import (
    BOOT_MS,
    USEC,
    BootClock,
    boot_ms_s,
    merge_clocks,
    usec_to_boot_s,
)
from quadid_logs.containers.mavlink_dialect import Dialect, load_dialect
from quadid_logs.containers.mavlink_frames import (
    LONGEST,
    MAGIC_1,
    MAGIC_2,
    STAMP_SIZE,
    Packets,
    frame,
    host_time_s,
)
from quadid_logs.data.log import LostBytes, MessageCount
from quadid_logs.errors import EmptyLogError, SettingsError

_INVALID_AUTOPILOT: Final = 8
_GROUND_STATION: Final = 6
#: The packets of as many bytes are sorted and copied at once.
_PART_BYTES: Final = 1 << 20
#: Nobody reads a longer list of who speaks.
_MOST_LISTED: Final = 12
_FEW: Final = 2
"""Packets with a right checksum that make a file a MAVLink log, unless it begins with one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessageRows:
    """All messages of one type, in file order.

    Attributes
    ----------
    rows : structured ndarray, shape (n_rows,)
        Truncated payloads are filled up with zeros.
    position : ndarray of int64, shape (n_rows,)
        Byte offset of each packet in the file.
    system_id, component_id : ndarray of uint8, shape (n_rows,)
        Who sent it.
    """

    name: str
    rows: AnyArray
    position: IntArray
    system_id: AnyArray
    component_id: AnyArray

    def column(self, field: str) -> AnyArray | None:
        """Return a field of every row; None where there is none."""
        return self.rows[field] if field in (self.rows.dtype.names or ()) else None


class Sender(NamedTuple):
    """Who speaks in a file: MAV_AUTOPILOT and MAV_TYPE as its heartbeats say, -1 and 0 without any."""

    system_id: int
    component_id: int
    autopilot: int
    mav_type: int
    n_messages: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TlogContent:
    """What the chosen one of the senders of a telemetry log says.

    `clock` is the boot clock; `on_host_clock` tells that it had to be taken
    from the host's stamps. Of `n_senders` the autopilots come first into `senders`, then who says most.
    """

    messages: Mapping[str, MessageRows]
    clock: BootClock
    on_host_clock: bool
    senders: tuple[Sender, ...]
    n_senders: int
    chosen: Sender
    counts: tuple[MessageCount, ...]
    lost: tuple[LostBytes, ...]
    n_unknown: int
    n_bytes: int

    def time_s(self, message: MessageRows) -> FloatArray:
        """Return when each row was sampled [s since boot]: its own time, else that of its neighbours."""
        boot_ms, usec = message.column(BOOT_MS), message.column(USEC)
        near_s = self.clock.at(message.position)
        if boot_ms is not None:
            own = boot_ms_s(boot_ms)
        elif usec is not None:
            own = usec_to_boot_s(usec, message.position, self.clock)
        else:
            return near_s
        return np.where(np.isfinite(own), own, near_s)


def is_mine(head: bytes) -> bool:
    """Tell whether a file beginning with `head` holds MAVLink packets."""
    data = np.frombuffer(head, np.uint8)
    if not ((data == MAGIC_1) | (data == MAGIC_2)).any():
        return False
    start = frame(FileParts(io.BytesIO(head)), load_dialect()).packets.start
    return len(start) >= _FEW or (len(start) == 1 and int(start[0]) in (0, STAMP_SIZE))


def read_messages(
    path: str | Path, names: Collection[str] | None = None, *, system: int = 0
) -> dict[str, MessageRows]:
    """Return the messages of a telemetry log by type.

    Parameters
    ----------
    names : collection of str, optional
        Message names to decode; all by default.
    system : int
        System id to keep; 0 keeps all.
    """
    dialect = load_dialect()
    with closing(FileParts.open(path)) as file:
        packets = frame(file, dialect).packets
        if system:
            packets = packets.where(packets.system == system)
        return _decode(file, packets, dialect, names)


def read_content(path: str | Path, names: Collection[str], *, system: int = 0) -> TlogContent:
    """Read a telemetry log, decoding the given messages of one system.

    Parameters
    ----------
    names : collection of str
        Message names to decode.
    system : int
        System id; 0 chooses the autopilot with most messages.

    Raises
    ------
    EmptyLogError
        If there is no packet with a right checksum.
    SettingsError
        If the file holds no system of that id.
    """
    with closing(FileParts.open(path)) as file:
        dialect = load_dialect()
        framing = frame(file, dialect)
        packets = framing.packets
        if not len(packets.start):
            raise EmptyLogError(
                f"{path} holds no MAVLink packet with a right checksum.", hint="Copy the log again."
            )
        heartbeats = _decode(file, packets, dialect, {"HEARTBEAT"}).get("HEARTBEAT")
        senders, chosen, n_senders = _senders(packets, heartbeats, system)
        if chosen is None:
            present = ", ".join(str(number) for number in np.unique(packets.system).tolist())
            raise SettingsError(f"There is no system {system} in {path}.", hint=f"It holds {present}.")
        is_own = (packets.system == chosen.system_id) & (packets.component == chosen.component_id)
        own = packets if is_own.all() else packets.where(is_own)
        messages = _decode(file, own, dialect, {*names, "HEARTBEAT"})
        clock, on_host_clock = _boot_clock(file, own, dialect, messages)
    # Count the messages by type, with their mean rate over the time that the clock covers.
    running = np.diff(clock.time_s)
    duration_s = float(running[(running > 0.0) & (running < 3600.0)].sum())
    ids, counts = np.unique(own.msg_id, return_counts=True)
    rate = 1.0 / duration_s if duration_s > 0.0 else float("nan")
    return TlogContent(
        messages=messages,
        clock=clock,
        on_host_clock=on_host_clock,
        senders=senders,
        n_senders=n_senders,
        chosen=chosen,
        counts=tuple(
            sorted(
                (
                    MessageCount(name=dialect.types[msg_id].name, count=count, rate_hz=count * rate)
                    for msg_id, count in zip(ids.tolist(), counts.tolist(), strict=True)
                ),
                key=lambda count: count.name,
            )
        ),
        lost=framing.lost,
        n_unknown=framing.n_unknown,
        n_bytes=file.n_bytes,
    )


def _decode(
    file: FileParts, packets: Packets, dialect: Dialect, names: Collection[str] | None
) -> dict[str, MessageRows]:
    """Decode the packets by type, part by part: only the rows themselves are as large as the file."""
    tables: dict[int, MessageRows] = {}
    for msg_id, count in enumerate(np.bincount(packets.msg_id).tolist()):
        if count and (names is None or dialect.types[msg_id].name in names):
            # A table for so many rows: zero is what a sender leaves out of a payload's end.
            kind = dialect.types[msg_id]
            tables[msg_id] = MessageRows(
                name=kind.name,
                rows=np.zeros(count, kind.dtype),
                position=np.empty(count, np.int64),
                system_id=np.empty(count, np.uint8),
                component_id=np.empty(count, np.uint8),
            )
    if not tables:
        return {}
    is_wanted = np.isin(packets.msg_id, list(tables))
    packets = packets if is_wanted.all() else packets.where(is_wanted)
    filled = dict.fromkeys(tables, 0)
    last = 0
    for begin, block in file.blocks(_PART_BYTES, LONGEST):
        first, last = last, int(packets.start.searchsorted(begin + _PART_BYTES))
        if first == last:
            continue
        part = packets.where(slice(first, last))
        order = np.argsort(part.msg_id, kind="stable")  # radix sort
        ids, firsts = np.unique(part.msg_id[order], return_index=True)
        for msg_id, chosen in zip(ids.tolist(), np.split(order, firsts[1:]), strict=True):
            table, some = tables[msg_id], part.where(chosen)
            place = slice(filled[msg_id], filled[msg_id] + len(chosen))
            filled[msg_id] = place.stop
            # What we do not know of a payload is left out.
            body = table.rows.view((np.uint8, table.rows.dtype.itemsize))
            # Copy the payloads into the rows of `body`, those of equal length together.
            payload = some.payload - begin
            body = body[place]
            kept = np.minimum(some.length, min(body.shape[1], 255))
            for size in np.flatnonzero(np.bincount(kept, minlength=1)).tolist():
                group = np.flatnonzero(kept == size)
                copied = rows_at(block, payload[group], np.dtype((np.void, size)))
                body[group, :size] = copied.view(np.uint8).reshape(len(group), size)
            table.position[place] = some.start
            table.system_id[place] = some.system
            table.component_id[place] = some.component
    return {table.name: table for table in tables.values()}


def _boot_clock(
    file: FileParts, packets: Packets, dialect: Dialect, decoded: Mapping[str, MessageRows]
) -> tuple[BootClock, bool]:
    """Return the boot clock, and whether it had to be taken from the host's stamps.

    What is already decoded mostly tells the time; only where it does not, all messages are decoded.
    """
    for name in (BOOT_MS, USEC):
        clock = _clock_of(decoded, name)
        if not len(clock.position):
            present = [dialect.types[int(msg_id)] for msg_id in np.unique(packets.msg_id)]
            timed = {kind.name for kind in present if name in (kind.dtype.names or ())}
            clock = _clock_of(_decode(file, packets, dialect, timed), name)
        if len(clock.position):
            return clock, False
    host_s = host_time_s(file, packets)
    return BootClock(packets.start, host_s - host_s[0]), True


def _clock_of(messages: Mapping[str, MessageRows], name: str) -> BootClock:
    """Return the clock that a time field of these messages shows, without rows where it is not filled in."""
    clocks = []
    for message in messages.values():
        stamp = message.column(name)
        if stamp is not None:
            own_s = boot_ms_s(stamp) if name == BOOT_MS else np.where(stamp > 0, stamp / 1e6, np.nan)
            clocks.append(BootClock(message.position, own_s))
    clock = merge_clocks(clocks)
    usable = np.isfinite(clock.time_s)
    return BootClock(clock.position[usable], clock.time_s[usable])


def _senders(
    packets: Packets, heartbeats: MessageRows | None, system: int
) -> tuple[tuple[Sender, ...], Sender | None, int]:
    """Tell who speaks in the file, by address; who is read, None without that system; and how many speak.

    Anybody may send in the name of any of 65 536 addresses: only those that matter most are listed.
    """
    counts = np.bincount(_addresses(packets.system, packets.component))
    keys = np.flatnonzero(counts)
    autopilot, mav_type = np.full(counts.size, -1), np.zeros(counts.size, int)
    if heartbeats is not None:
        address = _addresses(heartbeats.system_id, heartbeats.component_id)
        for said, field in ((autopilot, "autopilot"), (mav_type, "type")):
            pairs, times = np.unique(address * 256 + heartbeats.rows[field], return_counts=True)
            order = np.lexsort((pairs, -times, pairs // 256))
            # The most frequent byte that each address sent, the smallest of equally frequent ones.
            who, first = np.unique(pairs[order] // 256, return_index=True)
            said[who] = pairs[order][first] % 256
    flies = ~np.isin(autopilot[keys], (-1, _INVALID_AUTOPILOT)) & (mav_type[keys] != _GROUND_STATION)
    by_rank = keys[np.lexsort((-counts[keys], ~flies))]
    eligible = by_rank[by_rank // 256 == system] if system else by_rank
    first = eligible[:1]
    listed = np.sort(np.concatenate([first, by_rank[~np.isin(by_rank, first)]])[:_MOST_LISTED])
    columns = (listed // 256, listed % 256, autopilot[listed], mav_type[listed], counts[listed])
    senders = tuple(Sender(*row) for row in zip(*(column.tolist() for column in columns), strict=True))
    chosen = senders[listed.searchsorted(first[0])] if eligible.size else None
    return senders, chosen, int(keys.size)


def _addresses(system: AnyArray, component: AnyArray) -> IntArray:
    """Return system and component as one number."""
    return np.asarray(system.astype(np.int64) * 256 + component, np.int64)
