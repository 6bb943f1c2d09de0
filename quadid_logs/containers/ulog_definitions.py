"""What the messages of a ULog file mean, apart from the data: formats, topics, parameters, texts.

Every message is decoded on its own, so that a damaged one costs only itself.
(pyulog decodes the same messages, but it ends at the first short one, prints
to stdout and forgets where in the file they stood; it is the reference in the
tests.) Format: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.containers.ulog_formats import BASIC_TYPES, BrokenMessageError, Formats
from quadid_logs.containers.ulog_header import HEADER_SIZE

SYNC_MAGIC: Final = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
#: Where an id is not subscribed, no size fits: the least one is larger than any message.
NO_SIZE: Final = 1 << 17
MESSAGE_TYPES: Final = frozenset(b"BFIMPQARDSOLC")

_UNPACK: Final = {name: struct.Struct(code).unpack for name, code in BASIC_TYPES.items()}
#: An array, or the name of a format.
_OTHER_TYPE = re.compile(r"[a-z0-9_]+(\[\d{1,5}\])?")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subscription:
    """One topic instance and the layout of its data messages (without padding at the end)."""

    name: str
    multi_id: int
    msg_id: int
    dtype: np.dtype[np.void]
    max_size: int


class Text(NamedTuple):
    """A logged message; `timestamp_us` is the autopilot's."""

    offset: int
    timestamp_us: int
    level: int
    text: str


class Dropout(NamedTuple):
    """Messages were not written for `duration_ms` before this place in the file."""

    offset: int
    duration_ms: int


class ParameterWrite(NamedTuple):
    """A parameter that was written while logging, with the value that it had before."""

    offset: int
    name: str
    value: float
    before: float


@dataclass(slots=True, kw_only=True)
class Definitions:
    """All that is known so far while the messages of a file are gone through in order."""

    formats: Formats = field(default_factory=Formats)
    subscriptions: list[Subscription] = field(default_factory=list)
    index_by_id: dict[int, int] = field(default_factory=dict)
    information: dict[str, object] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    parameter_writes: list[ParameterWrite] = field(default_factory=list)
    texts: list[Text] = field(default_factory=list)
    dropouts: list[Dropout] = field(default_factory=list)
    appended_at: list[int] = field(default_factory=list)
    unknown_flags: bool = False
    has_data_section: bool = False

    def take(self, kind: int, body: bytes, offset: int) -> None:
        """Decode one message other than data.

        Raises
        ------
        BrokenMessageError
            If the body does not follow the format of its type.
        """
        try:
            self._take(chr(kind), body, offset)
        except (struct.error, UnicodeDecodeError, IndexError) as error:
            raise BrokenMessageError(str(error)) from error

    def _take(self, kind: str, body: bytes, offset: int) -> None:
        if kind == "B":
            incompatible = body[8:16]
            offsets = struct.unpack("<3Q", body[16:40])
            self.unknown_flags |= bool(incompatible[0] & ~1 or any(incompatible[1:]))
            if incompatible[0] & 1:
                # The offsets count from the start of this file, which can be joined to another one.
                start = offset - HEADER_SIZE
                self.appended_at += [start + position for position in offsets if position]
        elif kind == "F":
            self.formats.define(_text_of(body))
        elif kind == "A":
            multi_id, msg_id = struct.unpack("<BH", body[:3])
            name = _text_of(body[3:])
            dtype, max_size = self.formats.row(name)
            self.index_by_id[msg_id] = len(self.subscriptions)
            self.subscriptions.append(
                Subscription(name=name, multi_id=multi_id, msg_id=msg_id, dtype=dtype, max_size=max_size)
            )
            self.has_data_section = True
        elif kind == "R":
            # The writer's queue may still hold messages of the topic, so its layout stays known.
            struct.unpack("<H", body)
        elif kind == "I":
            name, value = _key_and_value(body)
            self.information[name] = value
        elif kind in "MQ":
            # Boot messages, performance counters, defaults of parameters: nothing that the analysis uses.
            _key_and_value(body[1:])
        elif kind == "P":
            name, value = _key_and_value(body)
            if not isinstance(value, int | float):
                raise BrokenMessageError("a parameter that is not a number")
            if self.has_data_section:
                before = self.parameters.get(name, float(value))
                self.parameter_writes.append(ParameterWrite(offset, name, float(value), before))
            self.parameters[name] = float(value)
        elif kind in "LC":
            # With a tag of two bytes after the level, or without.
            head = struct.Struct("<BQ" if kind == "L" else "<BHQ")
            level, *_, timestamp_us = head.unpack(body[: head.size])
            if not ord("0") <= level <= ord("7"):  # levels are the digits of syslog
                raise BrokenMessageError("a text without a level")
            self.texts.append(Text(offset, timestamp_us, level, _text_of(body[head.size :])))
        elif kind == "O":
            (duration_ms,) = struct.unpack("<H", body)
            self.dropouts.append(Dropout(offset, duration_ms))
        elif body != SYNC_MAGIC:
            raise BrokenMessageError("a sync message without its mark")


def _text_of(body: bytes) -> str:
    """Decode UTF-8 and leave out what is none."""
    return body.decode("utf-8", errors="ignore")


def _key_and_value(body: bytes) -> tuple[str, object]:
    """Split "type name" and value of an information or parameter message."""
    key_end = 1 + body[0]
    type_name, _, name = _text_of(body[1:key_end]).partition(" ")
    if name.split() != [name] or key_end > len(body):
        raise BrokenMessageError("a key without type and name")
    raw = body[key_end:]
    unpack = _UNPACK.get(type_name)
    if unpack:
        # Of the wrong size: struct.error, which `take` translates.
        return name, unpack(raw)[0]
    if not _OTHER_TYPE.fullmatch(type_name):
        raise BrokenMessageError("a key with an unknown type")
    # The size in the brackets is not checked: PX4's performance counters get it wrong.
    return name, _text_of(raw) if type_name.startswith("char[") else raw
