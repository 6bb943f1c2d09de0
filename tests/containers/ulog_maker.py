"""Write small ULog files byte by byte, so that tests know what every byte is."""

from __future__ import annotations

import struct

from quadid_logs.containers.ulog_definitions import SYNC_MAGIC
from quadid_logs.containers.ulog_header import HEADER_MAGIC

RATE_FORMAT = "vehicle_angular_velocity:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"
TORQUE_FORMAT = "vehicle_torque_setpoint:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"
RATE_ID, TORQUE_ID = 3, 7


def message(kind: str, body: bytes) -> bytes:
    """Return one message: size, type, body."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def keyed(kind: str, key: str, value: bytes) -> bytes:
    """Return an information or parameter message."""
    return message(kind, bytes([len(key)]) + key.encode() + value)


def subscription(msg_id: int, name: str, multi_id: int = 0) -> bytes:
    """Announce a topic."""
    return message("A", struct.pack("<BH", multi_id, msg_id) + name.encode())


def header(start_us: int = 1000) -> bytes:
    """Return the file header."""
    return HEADER_MAGIC + b"\x01" + struct.pack("<Q", start_us)


def definitions(flags: bytes = bytes(40)) -> bytes:
    """Return flags, formats, an information, a parameter and two subscriptions."""
    return (
        message("B", flags)
        + keyed("I", "char[3] sys_name", b"PX4")
        + message("F", RATE_FORMAT.encode())
        + message("F", TORQUE_FORMAT.encode())
        + keyed("P", "int32_t MAV_TYPE", struct.pack("<i", 2))
        + subscription(RATE_ID, "vehicle_angular_velocity")
        + subscription(TORQUE_ID, "vehicle_torque_setpoint")
    )


def row(msg_id: int, k: int, value: float | None = None) -> bytes:
    """Return the data message number `k`: stamped every 4 ms, sampled 1 ms earlier, values near `k`."""
    value = float(k) if value is None else value
    stamp_us = 1_000_000 + 4000 * k
    return message("D", struct.pack("<HQQ3f", msg_id, stamp_us, stamp_us - 1000, value, -value, 0.5))


def rows(n_rows: int, first: int = 0) -> bytes:
    """Return pairs of rate and torque rows."""
    return b"".join(row(RATE_ID, k) + row(TORQUE_ID, k) for k in range(first, first + n_rows))


def text(stamp_us: int, words: str) -> bytes:
    """Return a logged text."""
    return message("L", struct.pack("<BQ", ord("6"), stamp_us) + words.encode())


def dropout(duration_ms: int) -> bytes:
    """Return a dropout mark."""
    return message("O", struct.pack("<H", duration_ms))


def sync() -> bytes:
    """Return a synchronisation mark."""
    return message("S", SYNC_MAGIC)


def small_log(n_rows: int = 40) -> bytes:
    """Return a whole log with a text, a sync mark and a changed parameter in the middle."""
    half = n_rows // 2
    middle = (
        sync() + text(1_100_000, "Takeoff detected") + keyed("P", "int32_t MAV_TYPE", struct.pack("<i", 13))
    )
    return header() + definitions() + rows(half) + middle + rows(n_rows - half, half)
