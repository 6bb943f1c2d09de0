"""Small DataFlash files made for one test, and the reference reader's view of a file."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

STRUCTS = {
    "a": "64s", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "g": "e",
    "n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "b", "q": "q",
    "Q": "Q",
}  # fmt: skip


def fmt(type_id: int, name: str, format_: str, labels: str, *, length: int | None = None) -> bytes:
    """Return the FMT message that defines a message id."""
    size = struct.calcsize("<" + "".join(STRUCTS[kind] for kind in format_)) + 3
    return b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s",
        type_id,
        size if length is None else length,
        name.encode(),
        format_.encode(),
        labels.encode(),
    )


def row(type_id: int, format_: str, *values: Any) -> bytes:
    """Return one message with raw (unscaled) values."""
    return bytes([0xA3, 0x95, type_id]) + struct.pack(
        "<" + "".join(STRUCTS[kind] for kind in format_), *values
    )


FMT_OF_FMT = fmt(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
ATT, RATE, EV = 140, 141, 142
DEFINITIONS = (
    FMT_OF_FMT
    + fmt(ATT, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw")
    + fmt(RATE, "RATE", "Qfffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut")
    + fmt(EV, "EV", "QB", "TimeUS,Id")
)


def flight(n_loops: int) -> bytes:
    """Return definitions and `n_loops` times a RATE and an ATT, with an EV now and then."""
    parts = [DEFINITIONS]
    for loop in range(n_loops):
        time_us = 1_000_000 + 2500 * loop
        parts.append(row(RATE, "Qfffffffff", time_us, *(0.1 * loop + k for k in range(9))))
        parts.append(row(ATT, "QccC", time_us, loop % 1800, -loop % 900, loop % 36000))
        if loop % 10 == 0:
            parts.append(row(EV, "QB", time_us, 10))
    return b"".join(parts)


def reference_rows(path: Path, types: Iterable[str]) -> dict[str, tuple[Sequence[str], list[list[Any]]]]:
    """Return every row of the types as pymavlink's reader decodes them, with the column names."""
    from pymavlink import DFReader

    reader_class = DFReader.DFReader_text if path.suffix == ".log" else DFReader.DFReader_binary
    found: dict[str, tuple[Sequence[str], list[list[Any]]]] = {}
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        reader = reader_class(str(path))
        while (message := reader.recv_match(type=set(types))) is not None:
            name = message.get_type()
            if name in types:
                labels, rows = found.setdefault(name, (message.get_fieldnames(), []))
                rows.append([getattr(message, label) for label in labels])
        reader.filehandle.close()
        reader.data_map.close()
    return found
