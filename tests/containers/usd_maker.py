"""Crazyflie micro-SD logs byte by byte, and an independent reader, both from the format's description.

uSD format: 0xBC; u16 version, u16 number of event types; per type u16 id, name and a zero, u16 n, n times
"name(f)" and a zero (struct letter in brackets); then per event u16 id, time (version 1: u32 ms; version 2:
u64 us), packed values; the last 4 bytes are the CRC32 of all before.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import NamedTuple

#: Name, and variables with their letters, of a type of events.
Type = tuple[str, Sequence[tuple[str, str]]]


class Event(NamedTuple):
    """Number of the type, time as it is stored, values."""

    number: int
    time: int
    values: Sequence[float]


def header(types: dict[int, Type], *, version: int = 2) -> bytes:
    """Return the definitions."""
    parts = [struct.pack("<BHH", 0xBC, version, len(types))]
    for number, (name, fields) in types.items():
        parts.append(struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(fields)))
        parts += [f"{field}({letter})".encode() + b"\0" for field, letter in fields]
    return b"".join(parts)


def event(types: dict[int, Type], one: Event, *, version: int = 2) -> bytes:
    """Return one event."""
    letters = "".join(letter for _, letter in types[one.number][1])
    whole = [
        value if letter in "fd" else int(value) for letter, value in zip(letters, one.values, strict=True)
    ]
    return struct.pack("<H" + "I Q"[2 * (version - 1)] + letters, one.number, one.time, *whole)


def log(types: dict[int, Type], events: Sequence[Event], *, version: int = 2) -> bytes:
    """Return a whole file."""
    content = header(types, version=version) + b"".join(event(types, one, version=version) for one in events)
    return content + struct.pack("<I", zlib.crc32(content))


def read(content: bytes) -> dict[str, dict[str, list[float]]]:
    """Return the values of every field of every type, its "time" in seconds, of an intact file."""
    magic, version, n_types = struct.unpack_from("<BHH", content)
    assert magic == 0xBC
    assert struct.unpack("<I", content[-4:]) == (zlib.crc32(content[:-4]),)
    at, types = 5, {}
    for _ in range(n_types):
        (number,) = struct.unpack_from("<H", content, at)
        name, _, _ = content[at + 2 :].partition(b"\0")
        at += 2 + len(name) + 1
        (n_fields,) = struct.unpack_from("<H", content, at)
        at += 2
        fields = []
        for _ in range(n_fields):
            field, _, _ = content[at:].partition(b"\0")
            at += len(field) + 1
            fields.append((field[:-3].decode(), chr(field[-2])))
        types[number] = (name.decode(), fields)
    found: dict[str, dict[str, list[float]]] = {}
    while at < len(content) - 4:
        number, time = struct.unpack_from("<HI" if version == 1 else "<HQ", content, at)
        at += 6 if version == 1 else 10
        name, fields = types[number]
        letters = "<" + "".join(letter for _, letter in fields)
        values = struct.unpack_from(letters, content, at)
        at += struct.calcsize(letters)
        table = found.setdefault(name, {each: [] for each in ("time", *(field for field, _ in fields))})
        table["time"].append(time * (1e-3 if version == 1 else 1e-6))
        for (field, _), value in zip(fields, values, strict=True):
            table[field].append(value)
    return found
