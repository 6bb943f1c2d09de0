"""Packets are those of the reference implementation, byte by byte."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from quadid_logs.containers.mavlink_dialect import load_dialect
from quadid_logs.writers.mavlink_packets import Messages, packet

EXAMPLES: list[tuple[str, tuple[Any, ...]]] = [
    ("heartbeat", (2, 3, 81, 5, 4, 3)),
    ("attitude_target", (1000, 0, [math.nan] * 4, 0.1, -0.2, 0.3, 0.5)),
    ("raw_imu", (123456789, 1, -2, 3, -4, 5, -6, 0, 0, 0)),
    ("statustext", (6, b"EKF3 is ready", 0, 0)),
    ("autopilot_version", (0, 0x040507FF, 0, 0, 0, bytes(8), bytes(8), bytes(8), 0, 0, 0)),
    ("param_value", (b"ATC_RAT_RLL_P", 0.135, 9, 100, 7)),
    ("esc_telemetry_1_to_4", (bytes(4), [0] * 4, [0] * 4, [0] * 4, [900, 901, 902, 903], [0] * 4)),
]


@pytest.mark.parametrize(("name", "values"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_a_packet_is_that_of_pymavlink(name: str, values: tuple[Any, ...]) -> None:
    """Order of the fields on the wire, arrays, texts, extensions, trailing zeros and checksum."""
    from pymavlink.dialects.v20 import ardupilotmega as reference

    sender = reference.MAVLink(None, srcSystem=7, srcComponent=1)
    sender.seq = 200
    expected = getattr(reference, f"MAVLink_{name}_message")(*values).pack(sender)
    assert packet(getattr(Messages(), name)(*values), 200, 7, 1) == bytes(expected)


def test_a_message_that_there_is_none_of_is_an_attribute_error() -> None:
    """By its name."""
    with pytest.raises(AttributeError, match="no_such"):
        _ = Messages().no_such


def test_the_table_of_messages_agrees_with_the_installed_dialect() -> None:
    """A later pymavlink may have more messages, and longer ones; the numbers that both have are the same."""
    from pymavlink.dialects.v20 import all as generated

    for number, kind in load_dialect().types.items():
        there = generated.mavlink_map.get(number)
        if there is None or struct.calcsize(kind.struct_format) != there.unpacker.size:
            continue
        assert (kind.name, kind.fields) == (there.msgname, tuple(there.ordered_fieldnames))
        assert load_dialect().extra[number] == there.crc_extra


def test_the_table_holds_the_whole_dialect() -> None:
    """And not what a generator happened to know."""
    assert len(load_dialect().types) > 300
