"""MAVLink 2 packets: a header, the payload without its trailing zeros, a checksum [1]_.

References
----------
.. [1] https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import binascii
import re
import struct
from collections.abc import Callable
from typing import NamedTuple

from quadid_logs.containers.mavlink_dialect import MessageType, load_dialect

_MAGIC = 0xFD
#: CRC-16/MCRF4XX is the standard library's CRC with the bits of every byte, and of the result, in reverse.
_MIRRORED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_Value = int | float | bytes | list[int] | list[float]


class Message(NamedTuple):
    """A message and its payload."""

    kind: MessageType
    payload: bytes


class Messages:
    """Makes messages by name: ``messages.heartbeat(...)``, fields in the order of their definition."""

    def __getattr__(self, name: str) -> Callable[..., Message]:
        kind = next((one for one in load_dialect().types.values() if one.name == name.upper()), None)
        if kind is None:
            raise AttributeError(name)

        def make(*values: _Value) -> Message:
            return Message(kind, payload_of(kind, values))

        setattr(self, name, make)
        return make


def payload_of(kind: MessageType, values: tuple[_Value, ...]) -> bytes:
    """Return the payload of a message.

    Parameters
    ----------
    values : tuple
        Of its fields in the order of their definition; those that are missing are zero.
    """
    parts = re.findall(r"(\d*)([A-Za-z])", kind.struct_format)
    wire: list[_Value] = [b"" if code == "s" else [0] * int(count) if count else 0 for count, code in parts]
    for place, value in zip(kind.definition_order, values, strict=False):
        wire[place] = value
    flat: list[int | float | bytes] = []
    for value, (_, code) in zip(wire, parts, strict=True):
        if isinstance(value, list) or (isinstance(value, bytes) and code != "s"):
            flat.extend(value)
        else:
            flat.append(value)
    return struct.pack(kind.struct_format, *flat)


def packet(message: Message, sequence: int, system: int, component: int) -> bytes:
    """Return a message as it is sent."""
    payload = message.payload.rstrip(b"\0") or b"\0"
    number = message.kind.msg_id.to_bytes(3, "little")
    body = bytes((len(payload), 0, 0, sequence, system, component)) + number + payload
    checked = body + bytes((int(load_dialect().extra[message.kind.msg_id]),))
    crc = binascii.crc_hqx(checked.translate(_MIRRORED), 0xFFFF)
    low, high = _MIRRORED[crc >> 8], _MIRRORED[crc & 0xFF]
    return bytes((_MAGIC,)) + body + bytes((low, high))
