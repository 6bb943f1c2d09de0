"""Ways to damage a log: those of storage and transfer, and those that only a format's framing makes possible.

Every mutation takes a random generator and the content, changes the content
in place or returns a new one. `mutated` draws one to four of them.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from functools import cache

from quadid_logs.containers.dataflash_index import parse_definition
from quadid_logs.containers.mavlink_dialect import load_dialect

Mutation = Callable[[random.Random, bytearray], bytearray]
Frame = tuple[int, int]
"""Where a message begins and where it ends."""

DATAFLASH_HEADER, ULOG_HEADER = b"\xa3\x95", 16
EXTREME = (float("nan"), float("inf"), -float("inf"), 1e38, -3.4e38, 1e-40, 0.0, -0.0, 1e300, 1e16)
#: Those that a single-precision number can hold.
EXTREME_SINGLES = tuple(number for number in EXTREME if not 3.4e38 < abs(number) < float("inf"))
SIGNALLING = (b"\x01\x00\xa0\x7f", b"\x01\x00\x00\x00\x00\x00\xf4\x7f")
HEADERS = (b"\xa3\x95\x80", b"\xa3\x95", b"\xfe\x09", b"\xfd\x1c\x00\x00", b"\x10\x00D", b"ULog\x01\x12\x35")
LETTERS = (
    b"\xff\xfe",
    b"\x80",
    b"\xc3\x28",
    b"\x00",
    b"\x1b[31m",
    b"\xe2\x80\xae",
    b"<script>",
    b"\xed\xa0\x80",
)


def mutated(rng: random.Random, kind: str, content: bytes) -> bytes:
    """Return the content with one to four mutations that suit its kind."""
    choices = [*ANY, *BY_KIND[kind] * 2]
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if data:
            data = rng.choice(choices)(rng, data)
    return bytes(data)


def _block(rng: random.Random, data: bytearray) -> slice:
    """Return 1 byte to 64 kB somewhere; short ones are as likely as long ones."""
    size = min(len(data), int(2 ** rng.uniform(0.0, 16.0)))
    start = rng.randrange(len(data) - size + 1)
    return slice(start, start + size)


def truncate(rng: random.Random, data: bytearray) -> bytearray:
    """Cut the end off."""
    return data[: rng.randrange(len(data) + 1)]


def behead(rng: random.Random, data: bytearray) -> bytearray:
    """Cut the beginning off."""
    return data[_block(rng, data).stop :]


def cut_out(rng: random.Random, data: bytearray) -> bytearray:
    """Leave a block out."""
    del data[_block(rng, data)]
    return data


def zeros(rng: random.Random, data: bytearray) -> bytearray:
    """Overwrite a block with zeros or ones."""
    part = _block(rng, data)
    data[part] = rng.choice((b"\0", b"\xff")) * (part.stop - part.start)
    return data


def noise(rng: random.Random, data: bytearray) -> bytearray:
    """Overwrite a block with noise."""
    part = _block(rng, data)
    data[part] = rng.randbytes(part.stop - part.start)
    return data


def insert_noise(rng: random.Random, data: bytearray) -> bytearray:
    """Put noise between, so that everything behind moves."""
    part = _block(rng, data)
    data[part.start : part.start] = rng.randbytes(part.stop - part.start)
    return data


def copied_block(rng: random.Random, data: bytearray) -> bytearray:
    """Write a block of the log to another place of it, over what is there or between."""
    part = _block(rng, data)
    block = bytes(data[part])
    place = rng.randrange(len(data))
    data[place : place + rng.choice((0, len(block)))] = block
    return data


def header_flood(rng: random.Random, data: bytearray) -> bytearray:
    """Fill a block with copies of a header."""
    part = _block(rng, data)
    header = rng.choice(HEADERS) + rng.choice((b"", bytes([rng.randrange(256)])))
    n_bytes = part.stop - part.start
    data[part] = (header * (n_bytes // len(header) + 1))[:n_bytes]
    return data


def flip_bits(rng: random.Random, data: bytearray) -> bytearray:
    """Flip 1 to 1000 bits anywhere."""
    for _ in range(int(10 ** rng.uniform(0.0, 3.0))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def extreme_numbers(rng: random.Random, data: bytearray) -> bytearray:
    """Write NaN, infinities and huge numbers anywhere."""
    for _ in range(rng.choice((1, 20, 400))):
        number = rng.choice(EXTREME)
        value = struct.pack("<f" if number in EXTREME_SINGLES and rng.random() < 0.7 else "<d", number)
        _write_over(data, rng.randrange(len(data)), rng.choice((value, value, value, *SIGNALLING)))
    return data


def odd_letters(rng: random.Random, data: bytearray) -> bytearray:
    """Write bytes that are no UTF-8, control sequences and markup anywhere, most often into texts."""
    letters = [k for k, byte in enumerate(data) if 65 <= byte <= 122] or [0]
    for _ in range(rng.choice((1, 10, 100))):
        _write_over(data, rng.choice(letters), rng.choice(LETTERS))
    return data


def twice(rng: random.Random, data: bytearray) -> bytearray:
    """Join the log to itself, or to a part of itself: two boots in one file."""
    return data + data[rng.choice((0, rng.randrange(len(data)))) :]


def _write_over(data: bytearray, place: int, value: bytes) -> None:
    """Overwrite without making the data longer."""
    value = value[: len(data) - place]
    data[place : place + len(value)] = value


def _write_singles(rng: random.Random, data: bytearray, places: list[int]) -> None:
    """Write one extreme number at some or all places."""
    value = struct.pack("<f", rng.choice(EXTREME_SINGLES))
    for place in rng.sample(places, min(len(places), rng.choice((1, 10, len(places))))):
        _write_over(data, place, value)


# ---- DataFlash


def dataflash_frames(data: bytearray) -> list[Frame]:
    """Return the messages, as far as an undamaged beginning can be followed."""
    lengths = {0x80: 89}
    frames, place = [], 0
    while data[place : place + 2] == DATAFLASH_HEADER and place + 3 <= len(data):
        length = lengths.get(data[place + 2], 0)
        if not length or place + length > len(data):
            break
        if data[place + 2] == 0x80:
            lengths[data[place + 3]] = data[place + 4]
        frames.append((place, place + length))
        place += length
    return frames


def _definitions(data: bytearray) -> list[Frame]:
    """Return the FMT messages."""
    return [frame for frame in dataflash_frames(data) if data[frame[0] + 2] == 0x80]


def drop_definition(rng: random.Random, data: bytearray) -> bytearray:
    """Leave an FMT message out."""
    for begin, end in _some(rng, _definitions(data), 1):
        del data[begin:end]
    return data


def repeat_definition(rng: random.Random, data: bytearray) -> bytearray:
    """Write an FMT message again, perhaps changed, where another message begins."""
    for begin, end in _some(rng, _definitions(data), 1):
        record = data[begin:end]
        if rng.random() < 0.7:
            _spoil_definition(rng, record)
        for place, _ in _some(rng, dataflash_frames(data), 1):
            data[place:place] = record
    return data


def change_definition(rng: random.Random, data: bytearray) -> bytearray:
    """Let FMT messages lie."""
    for begin, end in _some(rng, _definitions(data), rng.choice((1, 3))):
        record = data[begin:end]
        _spoil_definition(rng, record)
        data[begin:end] = record
    return data


def _spoil_definition(rng: random.Random, record: bytearray) -> None:
    """Change id, length, name, format or labels."""
    part = rng.choice(("id", "length", "name", "format", "labels"))
    if part == "id":
        record[3] = rng.randrange(256)
    elif part == "length":
        record[4] = rng.randrange(256)
    elif part == "name":
        record[5:9] = rng.choice((b"RATE", b"PARM", b"IMU\0", b"ATT\0", b"\xff\xfe\0\0", b"FMT\0", b"FMTU"))
    elif part == "format":
        letters = b"abBhHiIfdgnNZcCeELMqQ"
        record[9:25] = bytes(rng.choice(letters) for _ in range(rng.randrange(17))).ljust(16, b"\0")
    else:
        labels = bytes(record[25:89]).split(b"\0")[0].split(b",")
        rng.shuffle(labels)
        record[25:89] = b",".join(labels)[:64].ljust(64, b"\0")


def dataflash_clock(rng: random.Random, data: bytearray) -> bytearray:
    """Let the time of all messages from somewhere on jump."""
    return _jump(rng, data, [(b + 3, e) for b, e in dataflash_frames(data) if data[b + 2] != 0x80])


def parameter_values(data: bytearray) -> list[int]:
    """Return where the values of the PARM messages stand."""
    places = []
    for begin, end in _definitions(data):
        definition = parse_definition(bytes(data[begin:end]))
        if definition is not None and definition.name == "PARM" and "Value" in definition.fields():
            offset = definition.fields()["Value"][1]
            rows = [row for row, _ in dataflash_frames(data) if data[row + 2] == definition.type_id]
            places += [row + offset for row in rows]
    return places


def dataflash_parameters(rng: random.Random, data: bytearray) -> bytearray:
    """Give some or all parameters extreme values."""
    _write_singles(rng, data, parameter_values(data))
    return data


def dataflash_rows(rng: random.Random, data: bytearray) -> bytearray:
    """Reorder, repeat or drop whole messages."""
    return _shuffled(rng, data, dataflash_frames(data))


# ---- ULog


def ulog_frames(data: bytearray) -> list[Frame]:
    """Return the messages behind the header."""
    frames, place = [], ULOG_HEADER
    while place + 3 <= len(data):
        end = place + 3 + data[place] + 256 * data[place + 1]
        if end > len(data):
            break
        frames.append((place, end))
        place = end
    return frames


def ulog_sizes(rng: random.Random, data: bytearray) -> bytearray:
    """Let the sizes of messages lie."""
    for begin, _ in _some(rng, ulog_frames(data), rng.choice((1, 5, 50))):
        data[begin : begin + 2] = struct.pack("<H", rng.choice((0, 1, 2, 5, 0xFFFF, rng.randrange(1 << 16))))
    return data


def ulog_types(rng: random.Random, data: bytearray) -> bytearray:
    """Put in messages of unknown type, dropouts, or texts, and change the type of others."""
    for begin, end in _some(rng, ulog_frames(data), rng.choice((1, 5, 50))):
        kind = rng.choice(b"ABCDFILMOPQRSXZaz\x00\xff")
        if rng.random() < 0.5:
            data[begin + 2] = kind
        else:
            body = rng.randbytes(rng.choice((0, 1, 2, 40)))
            data[end:end] = struct.pack("<HB", len(body), kind) + body
    return data


def ulog_definitions(rng: random.Random, data: bytearray) -> bytearray:
    """Change formats, parameters and subscriptions inside their messages."""
    frames = [frame for frame in ulog_frames(data) if data[frame[0] + 2] in b"FAPI"]
    for begin, end in _some(rng, frames, rng.choice((1, 4))):
        body = data[begin + 3 : end]
        if not body:
            continue
        place = rng.randrange(len(body))
        body[place : place + rng.randrange(3)] = rng.choice(
            (b"[99999]", b"[0]", b"[-1]", b";", b" ", b"uint8_t a;", b":", b"\xff", b"float[65535] x;", b"")
        )
        data[begin:end] = struct.pack("<HB", len(body) & 0xFFFF, data[begin + 2]) + body
    return data


def ulog_parameters(rng: random.Random, data: bytearray) -> bytearray:
    """Give some or all parameters extreme values (message P: type and name, then four bytes)."""
    places = []
    for begin, end in ulog_frames(data):
        key = data[begin + 4 : begin + 4 + data[begin + 3]] if end - begin > 4 else b""
        if data[begin + 2] == ord("P") and key.startswith(b"float "):
            places.append(end - 4)
    _write_singles(rng, data, places)
    return data


def ulog_appended(rng: random.Random, data: bytearray) -> bytearray:
    """Announce appended data at an offset that may lie (message B of 40 bytes), with some behind the end."""
    flags = bytes(8) + bytes([1]) + bytes(7)
    offsets = [rng.choice((0, len(data), len(data) // 2, 1 << 40, 2**64 - 1)) for _ in range(3)]
    message = struct.pack("<HB", 40, ord("B")) + flags + struct.pack("<3Q", *offsets)
    data[ULOG_HEADER:ULOG_HEADER] = message
    return data + data[_block(rng, data)]


def ulog_clock(rng: random.Random, data: bytearray) -> bytearray:
    """Let the time of all messages from somewhere on jump."""
    return _jump(rng, data, [(b + 5, e) for b, e in ulog_frames(data) if data[b + 2] == ord("D")])


def ulog_rows(rng: random.Random, data: bytearray) -> bytearray:
    """Reorder, repeat or drop whole messages."""
    return _shuffled(rng, data, ulog_frames(data))


# ---- MAVLink


@cache
def _extra_bytes() -> list[int]:
    """Return CRC_EXTRA by message id, negative where unknown."""
    return [int(extra) for extra in load_dialect().extra]


def tlog_frames(data: bytearray) -> list[Frame]:
    """Return the packets without their host stamps, as far as an undamaged beginning can be followed."""
    frames, place = [], 8
    while place + 12 <= len(data) and data[place] in (0xFE, 0xFD):
        signed = 13 * (data[place] == 0xFD and data[place + 2] & 1)
        end = place + data[place + 1] + (8 if data[place] == 0xFE else 12) + signed
        if end > len(data):
            break
        frames.append((place, end))
        place = end + 8
    return frames


def _message_id(packet: bytearray) -> int:
    """Return the type of a packet."""
    return packet[5] if packet[0] == 0xFE else int.from_bytes(packet[7:10], "little")


def sealed(packet: bytearray) -> bytearray:
    """Return an unsigned packet with a right checksum (CRC-16/MCRF4XX), if its type is known."""
    msg_id = _message_id(packet)
    extra = _extra_bytes()[msg_id] if msg_id < len(_extra_bytes()) else -1
    crc = 0xFFFF
    for byte in (*packet[1:-2], max(extra, 0)):
        mixed = (byte ^ crc) & 0xFF
        mixed = (mixed ^ (mixed << 4)) & 0xFF
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    packet[-2:] = struct.pack("<H", crc)
    return packet


def tlog_payloads(rng: random.Random, data: bytearray) -> bytearray:
    """Change payloads, or who sent them, and put the checksum right again: only the content is wrong."""
    mutation = rng.choice((extreme_numbers, noise, zeros, odd_letters, flip_bits))
    for begin, end in _some(rng, tlog_frames(data), rng.choice((1, 10, 100))):
        packet = data[begin:end]
        header = 6 if packet[0] == 0xFE else 10
        body = packet[header:-2]
        if body:
            packet[header:-2] = mutation(rng, body)
        if rng.random() < 0.3:
            packet[header - 3 if header == 6 else 5] = rng.randrange(256)
        data[begin:end] = sealed(packet)
    return data


def tlog_parameters(rng: random.Random, data: bytearray) -> bytearray:
    """Give some or all parameters extreme values (PARAM_VALUE, 22, begins with the value)."""
    packets = [(begin, end) for begin, end in tlog_frames(data) if _message_id(data[begin:end]) == 22]
    _write_singles(rng, data, [begin + (6 if data[begin] == 0xFE else 10) for begin, _ in packets])
    for begin, end in packets:
        data[begin:end] = sealed(data[begin:end])
    return data


def tlog_short_payloads(rng: random.Random, data: bytearray) -> bytearray:
    """Cut payloads short, or make them longer, with a right checksum."""
    for begin, end in sorted(_some(rng, tlog_frames(data), rng.choice((1, 10, 50))), reverse=True):
        packet = data[begin:end]
        header = 6 if packet[0] == 0xFE else 10
        body = packet[header:-2][: rng.randrange(256)]
        body = body + rng.randbytes(rng.choice((0, 0, 1, 40)))
        body = body[:255]
        packet[1] = len(body)
        data[begin:end] = sealed(packet[:header] + body + b"\0\0")
    return data


def tlog_headers(rng: random.Random, data: bytearray) -> bytearray:
    """Unknown ids, signatures announced or given, other flags, wrong lengths and checksums."""
    for begin, end in sorted(_some(rng, tlog_frames(data), rng.choice((1, 10, 100))), reverse=True):
        choice = rng.randrange(5)
        if choice == 0:
            data[begin + 7 if data[begin] == 0xFD else begin + 5] = rng.randrange(256)
        elif choice == 1 and data[begin] == 0xFD:
            data[begin + 2] |= 1
            data[end:end] = rng.randbytes(rng.choice((0, 13)))
        elif choice == 2:
            data[begin + 1] = rng.randrange(256)
        elif choice == 3:
            data[end - 1] ^= 0x55
        else:
            data[begin] ^= 3  # 0xFE and 0xFD
    return data


def tlog_clock(rng: random.Random, data: bytearray) -> bytearray:
    """Let the host's stamps from somewhere on jump."""
    return _jump(rng, data, [(b - 8, e) for b, e in tlog_frames(data)])


def tlog_rows(rng: random.Random, data: bytearray) -> bytearray:
    """Reorder, repeat or drop whole packets."""
    return _shuffled(rng, data, tlog_frames(data))


# ---- text


def spoil_lines(rng: random.Random, data: bytearray) -> bytearray:
    """Drop, repeat, exchange lines, or change a cell."""
    lines = bytes(data).split(b"\n")
    for _ in range(rng.choice((1, 10, 100))):
        k = rng.choice((0, rng.randrange(len(lines))))
        choice = rng.randrange(4)
        if choice == 0 and len(lines) > 1:
            del lines[k]
        elif choice == 1:
            lines.insert(rng.randrange(len(lines)), lines[k])
        elif choice == 2:
            other = rng.randrange(len(lines))
            lines[k], lines[other] = lines[other], lines[k]
        else:
            lines[k] = _spoiled_line(rng, lines[k])
    return bytearray(b"\n".join(lines))


def _spoiled_line(rng: random.Random, line: bytes) -> bytes:
    """Change a cell of a line."""
    cells = line.split(b",")
    cells[rng.randrange(len(cells))] = rng.choice(
        (
            b"nan",
            b"inf",
            b"-1e400",
            b"",
            b"1e16",
            b"\xff\xfe",
            b'"',
            b"0x10",
            b"9" * 400,
            b"1,2",
            b"t_s",
            b"\0",
        )
    )
    return b",".join(cells)


# ---- shared


def _some(rng: random.Random, frames: list[Frame], count: int) -> list[Frame]:
    """Draw frames, last first so that changes of length do not move the others."""
    return sorted(rng.sample(frames, min(count, len(frames))), reverse=True)


def _jump(rng: random.Random, data: bytearray, stamps: list[Frame]) -> bytearray:
    """Add to, or replace, the 8-byte times at the places, from a random one on, for a while or to the end."""
    if not stamps:
        return data
    first = rng.randrange(len(stamps))
    last = rng.choice((first + 1, first + rng.randrange(1, 200), len(stamps)))
    shift = rng.choice(
        (-5_000_000, 5_000_000, -(10**12), 10**12, 10**22, 2**63, 1, -1_000, rng.randrange(2**64))
    )
    for place, end in stamps[first:last]:
        if place + 8 <= end:
            time = int.from_bytes(data[place : place + 8], "little") + shift
            data[place : place + 8] = (time % 2**64).to_bytes(8, "little")
    return data


def _shuffled(rng: random.Random, data: bytearray, frames: list[Frame]) -> bytearray:
    """Exchange, repeat or drop messages within a window."""
    if len(frames) < 3:
        return data
    first = rng.randrange(len(frames) - 1)
    window = frames[first : first + rng.choice((2, 50, 1000))]
    parts = [bytes(data[begin:end]) for begin, end in window]
    choice = rng.randrange(3)
    if choice == 0:
        rng.shuffle(parts)
    elif choice == 1:
        parts = [part for part in parts for _ in range(rng.randrange(3))]
    else:
        parts = [part for part in parts if rng.random() < 0.5]
    data[window[0][0] : window[-1][1]] = b"".join(parts)
    return data


def blackbox_header(rng: random.Random, data: bytearray) -> bytearray:
    """Change a number of the header: fields, encodings, intervals, settings."""
    end = data.find(b"\nI", data.find(b"Field P encoding"))
    digits = [at for at in range(max(end, 0)) if 48 <= data[at] <= 57]
    for _ in range(rng.choice((1, 1, 3))):
        if digits:
            at = rng.choice(digits)
            data[at : at + 1] = rng.choice((b"0", b"9", b"-1", b"99999", b"1e9", b",", b"", b"\xb2"))
    return data


def blackbox_frames(rng: random.Random, data: bytearray) -> bytearray:
    """Put letters of frames, and bytes that say that a number goes on, where others stand."""
    body = max(data.find(b"\nI", data.find(b"Field P encoding")), 0)
    for _ in range(rng.choice((1, 5, 50))):
        if body < len(data):
            data[rng.randrange(body, len(data))] = rng.choice(b"IPSGHE\x80\xff\x00")
    return data


def blackbox_logs(rng: random.Random, data: bytearray) -> bytearray:
    """Begin another log in the middle of a frame, once or many times."""
    header = data[: rng.choice((30, 90, max(data.find(b"\nI"), 1)))]
    at = rng.randrange(len(data) + 1)
    data[at:at] = header * rng.choice((1, 2, 30))
    return data


# ---- Crazyflie micro-SD


def usd_frames(data: bytearray) -> tuple[int, list[Frame]]:
    """Return where the header of a log with one kind of event ends, and the events."""
    version = data[1]
    end = data.find(0, 7) + 1
    n_fields = int.from_bytes(data[end : end + 2], "little")
    end += 2
    length = 6 if version == 1 else 10
    for _ in range(n_fields):
        after = data.find(0, end)
        if after < 2:
            return len(data), []
        length += {"b": 1, "B": 1, "h": 2, "H": 2}.get(chr(data[after - 2]), 4)
        end = after + 1
    return end, [(at, at + length) for at in range(end, len(data) - length, length)]


def usd_header(rng: random.Random, data: bytearray) -> bytearray:
    """Change numbers, names and types of the definitions, or write the header again."""
    end, frames = usd_frames(data)
    if rng.random() < 0.3 and frames:
        place = rng.choice(frames)[0]
        data[place:place] = data[:end]
        return data
    for _ in range(rng.choice((1, 3))):
        data[rng.randrange(min(end, len(data)))] = rng.choice((0, 1, 2, 40, 41, 0xFF, rng.randrange(256)))
    return data


def usd_clock(rng: random.Random, data: bytearray) -> bytearray:
    """Write times that fall, leap or repeat."""
    for begin, _ in _some(rng, usd_frames(data)[1], rng.choice((1, 10, 500))):
        time = rng.choice((0, 1, 2**32 - 1, 2**63, 2**64 - 1, rng.randrange(2**40)))
        _write_over(data, begin + 2, time.to_bytes(8, "little"))
    return data


def usd_rows(rng: random.Random, data: bytearray) -> bytearray:
    """Repeat, leave out and renumber events."""
    frames = usd_frames(data)[1]
    kind = rng.randrange(3)
    for begin, end in sorted(_some(rng, frames, rng.choice((1, 10, 100))), reverse=True):
        if kind == 0:
            data[begin:begin] = data[begin:end]
        elif kind == 1:
            del data[begin : end - rng.choice((0, 1))]
        else:
            _write_over(data, begin, rng.choice((b"\0\0", b"\xff\xff", b"\1\0")))
    return data


ANY: tuple[Mutation, ...] = (
    truncate,
    behead,
    cut_out,
    zeros,
    noise,
    insert_noise,
    copied_block,
    header_flood,
    flip_bits,
    extreme_numbers,
    odd_letters,
    twice,
)
BY_KIND: dict[str, tuple[Mutation, ...]] = {
    "dataflash": (
        drop_definition,
        repeat_definition,
        change_definition,
        dataflash_parameters,
        dataflash_clock,
        dataflash_rows,
    ),
    "ulog": (ulog_sizes, ulog_types, ulog_definitions, ulog_parameters, ulog_appended, ulog_clock, ulog_rows),
    "tlog": (tlog_payloads, tlog_short_payloads, tlog_parameters, tlog_headers, tlog_clock, tlog_rows),
    "blackbox": (blackbox_header, blackbox_frames, blackbox_logs),
    "usd": (usd_header, usd_clock, usd_rows),
    "text": (spoil_lines,),
    "plain": (),
}
