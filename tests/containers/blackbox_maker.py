"""Blackbox logs written field by field, from the format's description and not from the reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

MAGIC = "H Product:Blackbox flight data recorder by Nicholas Sherlock\n"
#: name, signed, predictor and encoding in complete frames, then in frames of differences.
FIELDS = (
    ("loopIteration", 0, 0, 1, 6, 9), ("time", 0, 0, 1, 2, 0),
    *((f"axisP[{k}]", 1, 0, 0, 1, 0) for k in range(3)),
    *((f"axisI[{k}]", 1, 0, 0, 1, 7) for k in range(3)),
    *((f"axisD[{k}]", 1, 0, 0, 1, 10) for k in range(3)),
    *((f"axisF[{k}]", 1, 0, 0, 1, 6) for k in range(3)),
    *((f"setpoint[{k}]", 1, 0, 0, 1, 8) for k in range(4)),
    ("vbatLatest", 0, 9, 3, 1, 1),
    *((f"gyroADC[{k}]", 1, 0, 0, 3, 0) for k in range(3)),
    *((f"accSmooth[{k}]", 1, 0, 0, 3, 0) for k in range(3)),
    ("rssi", 0, 8, 0, 0, 6),
    ("motor[0]", 0, 11, 1, 3, 0), *((f"motor[{k}]", 0, 5, 0, 3, 0) for k in range(1, 4)),
)  # fmt: skip
NAMES = tuple(field[0] for field in FIELDS)
SETTINGS = {
    "Firmware revision": "Betaflight 4.5.1 (abcdef) STM32F7X2",
    "looptime": "125",
    "pid_process_denom": "2",
    "vbatref": "1600",
    "motorOutput": "158,2047",
    "acc_1G": "2048",
    "features": "4194304",
    "blackbox_high_resolution": "0",
}
END = b"E\xffEnd of log\0"


def unsigned(value: int) -> bytes:
    """Seven bits per byte, lowest first."""
    value &= 0xFFFFFFFF
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])


def signed(value: int) -> bytes:
    """The sign in the lowest bit; differences are modulo 2^32, as in the firmware."""
    value = (value + (1 << 31)) % (1 << 32) - (1 << 31)
    return unsigned((value << 1) ^ (value >> 31))


def tag8_8svb(values: Sequence[int]) -> bytes:
    """A bit per field that is not zero; a single field has no tag."""
    if len(values) == 1:
        return signed(values[0])
    tag = sum(1 << k for k, value in enumerate(values) if value)
    return bytes([tag]) + b"".join(signed(value) for value in values if value)


def _fits(value: int, bits: int) -> bool:
    return -(1 << bits - 1) <= value < 1 << bits - 1


def _counted(values: Sequence[int]) -> bytes:
    """One to four bytes per field, lowest byte first, counted in the first byte."""
    sizes = [next(n for n in range(1, 5) if _fits(value, 8 * n)) for value in values]
    tag = 0xC0 | sum(size - 1 << 2 * k for k, size in enumerate(sizes))
    return bytes([tag]) + b"".join(
        value.to_bytes(size, "little", signed=True) for value, size in zip(values, sizes, strict=True)
    )


def tag2_3s32(values: Sequence[int]) -> bytes:
    """Three fields of 2, 4 or 6 bits, or of counted bytes."""
    a, b, c = values
    if all(_fits(value, 2) for value in values):
        return bytes([(a & 3) << 4 | (b & 3) << 2 | c & 3])
    if all(_fits(value, 4) for value in values):
        return bytes([0x40 | a & 15, (b & 15) << 4 | c & 15])
    if all(_fits(value, 6) for value in values):
        return bytes([0x80 | a & 63, b & 63, c & 63])
    return _counted(values)


def tag2_3svariable(values: Sequence[int]) -> bytes:
    """Three fields of 2 bits, of 5, 5, 4, of 8, 7, 7, or of counted bytes."""
    a, b, c = values
    if all(_fits(value, 2) for value in values):
        return bytes([(a & 3) << 4 | (b & 3) << 2 | c & 3])
    if _fits(a, 5) and _fits(b, 5) and _fits(c, 4):
        return (0x4000 | (a & 31) << 9 | (b & 31) << 4 | c & 15).to_bytes(2, "big")
    if _fits(a, 8) and _fits(b, 7) and _fits(c, 7):
        return (0x800000 | (a & 255) << 14 | (b & 127) << 7 | c & 127).to_bytes(3, "big")
    return _counted(values)


def tag8_4s16(values: Sequence[int]) -> bytes:
    """Four fields of 0, 4, 8 or 16 bits; half bytes follow each other, high first."""
    tag, nibbles = 0, []
    for k, value in enumerate(values):
        kind = next(n for n, bits in enumerate((0, 4, 8, 16)) if value == 0 or (bits and _fits(value, bits)))
        tag |= kind << 2 * k
        width = (0, 1, 2, 4)[kind]
        nibbles += [value >> 4 * (width - 1 - n) & 15 for n in range(width)]
    nibbles += [0] * (len(nibbles) % 2)
    return bytes([tag, *(high << 4 | low for high, low in zip(nibbles[::2], nibbles[1::2], strict=True))])


GROUPS = {6: (8, tag8_8svb), 7: (3, tag2_3s32), 8: (4, tag8_4s16), 10: (3, tag2_3svariable)}


def encoded(values: Sequence[int], encodings: Sequence[int]) -> bytes:
    """Write what is left of the fields behind their predictions."""
    content, at = b"", 0
    while at < len(values):
        most, together = GROUPS.get(encodings[at], (1, None))
        count = 1
        while count < most and tuple(encodings[at + count : at + count + 1]) == (encodings[at],):
            count += 1
        if together:
            content += together(values[at : at + count])
        elif encodings[at] == 0:
            content += signed(values[at])
        elif encodings[at] == 1:
            content += unsigned(values[at])
        elif encodings[at] == 3:
            content += unsigned(-values[at] & 0x3FFF)
        at += count
    return content


def complete(row: Sequence[int], settings: Mapping[str, str]) -> bytes:
    """Write a complete frame."""
    low = int(settings["motorOutput"].split(",")[0])
    constant = {0: 0, 5: row[NAMES.index("motor[0]")], 8: 1500, 9: int(settings["vbatref"]), 11: low}
    left = [value - constant[field[2]] for value, field in zip(row, FIELDS, strict=True)]
    return b"I" + encoded(left, [field[3] for field in FIELDS])


def difference(row: Sequence[int], last: Sequence[int], before: Sequence[int]) -> bytes:
    """Write a frame of differences to the two before it."""
    left = []
    for value, one, two, field in zip(row, last, before, FIELDS, strict=True):
        total = one + two
        expected = {0: 0, 1: one, 2: 2 * one - two, 3: (abs(total) // 2) * (1 if total > 0 else -1), 6: value}
        left.append(value - expected[field[4]])
    return b"P" + encoded(left, [field[5] for field in FIELDS])


def header(settings: Mapping[str, str], *, interval: int = 32, between: str = "1") -> bytes:
    """Write the lines before the frames."""
    lists = {
        "Field I name": [field[0] for field in FIELDS],
        "Field I signed": [field[1] for field in FIELDS],
        "Field I predictor": [field[2] for field in FIELDS],
        "Field I encoding": [field[3] for field in FIELDS],
        "Field P predictor": [field[4] for field in FIELDS],
        "Field P encoding": [field[5] for field in FIELDS],
        "Field S name": ["flightModeFlags", "stateFlags", "failsafePhase", "rxSignalReceived", "rxValid"],
        "Field S signed": [0] * 5,
        "Field S predictor": [0] * 5,
        "Field S encoding": [1, 1, 7, 7, 7],
    }
    lines = {name: ",".join(map(str, values)) for name, values in lists.items()}
    lines |= {"I interval": str(interval), "P interval": between} | dict(settings)
    return (MAGIC + "H Data version:2\n" + "".join(f"H {k}:{v}\n" for k, v in lines.items())).encode()


def frames(
    rows: Sequence[Sequence[int]], *, interval: int = 32, settings: Mapping[str, str] = SETTINGS
) -> list[bytes]:
    """Write every row, complete at every `interval`-th loop."""
    found: list[bytes] = []
    last: Sequence[int] = ()
    before: Sequence[int] = ()
    for row in rows:
        if row[0] % interval == 0:
            found.append(complete(row, settings))
            last = before = row
        else:
            found.append(difference(row, last, before))
            last, before = row, last
    return found


def log(
    rows: Sequence[Sequence[int]],
    *,
    interval: int = 32,
    between: str = "1",
    settings: Mapping[str, str] = SETTINGS,
) -> bytes:
    """Write a whole log, with events and a slow frame between the rows."""
    start = b"E\0" + unsigned(1000) + b"S" + unsigned(65) + unsigned(3) + tag2_3s32([0, 1, 1])
    body = frames(rows, interval=interval, settings=settings)
    middle = b"E\x1e" + unsigned(65) + unsigned(1)
    content = header(settings, interval=interval, between=between)
    return content + start + body[0] + middle + b"".join(body[1:]) + b"E\x0f" + unsigned(4) + END
