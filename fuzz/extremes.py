"""Legal extremes: what no autopilot writes though the format allows it, as large as is wanted.

Every family takes a random generator, an intact log and a size, and returns a
log of about that size: definitions that are many, wide, nested or repeated,
and parameters, texts, instances and senders by the thousand. None of it is
damage, so a reader may refuse none of it for its framing.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator
from itertools import count

from fuzz.mutations import DATAFLASH_HEADER, ULOG_HEADER, dataflash_frames, sealed, tlog_frames, ulog_frames

Extreme = Callable[[random.Random, bytes, int], bytes]
_LETTERS = "abcdefghijklmnopqrstuvwxyz"


def extreme(rng: random.Random, kind: str, content: bytes, n_bytes: int) -> bytes:
    """Return a log of about `n_bytes` that one of the families of its kind makes of the content."""
    return rng.choice(BY_KIND[kind])(rng, content, n_bytes)


def _up_to(n_bytes: int, parts: Iterator[bytes]) -> bytes:
    """Join parts until they fill the size."""
    joined = bytearray()
    while len(joined) < n_bytes:
        joined += next(parts)
    return bytes(joined)


def _name(number: int) -> str:
    """Return a short name, another one for every number."""
    letters = _LETTERS[number % 26]
    while number := number // 26:
        letters += _LETTERS[number % 26]
    return letters


# ---- ULog


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _format(name: str, fields: list[str]) -> bytes:
    return _message("F", f"{name}:{''.join(f'{field};' for field in fields)}".encode())


def _subscribe(msg_id: int, name: str, instance: int = 0) -> bytes:
    return _message("A", struct.pack("<BH", instance, msg_id) + name.encode())


def _row(msg_id: int, payload: bytes) -> bytes:
    return _message("D", struct.pack("<H", msg_id) + payload)


def _after_header(content: bytes, messages: bytes) -> bytes:
    return content[:ULOG_HEADER] + messages + content[ULOG_HEADER:]


def ulog_nested(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Let formats hold arrays of formats that hold arrays, eight levels deep, each subscribed once."""
    n_fields, n_elements = rng.choice(((400, 4), (40, 0), (2, 2), (100, 1)))
    size = f"[{n_elements}]" if n_elements else ""

    def levels() -> Iterator[bytes]:
        for tree in count():
            # No padding and no clock: the smallest leaf lets most of them fit a row.
            yield _format(f"t{tree}_0", ["uint8_t x"])
            for level in range(1, 8):
                inner = f"t{tree}_{level - 1}{size}"
                yield _format(f"t{tree}_{level}", [f"{inner} {_name(k)}" for k in range(n_fields)])
            yield _subscribe(60_000 + tree % 5000, f"t{tree}_7")

    return _after_header(content, _up_to(n_bytes, levels()))


def ulog_wide(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Define formats with hundreds or thousands of fields, subscribe all, log two rows of each."""
    n_fields = rng.choice((300, 3000))

    def wide() -> Iterator[bytes]:
        fields = ["uint64_t timestamp", *(f"uint8_t {_name(k)}" for k in range(n_fields))]
        for number in count():
            yield _format(f"w{number}", fields)
            yield _subscribe(50_000 + number % 15_000, f"w{number}")
            yield _row(50_000 + number % 15_000, bytes(8 + n_fields)) * 2

    return _after_header(content, _up_to(n_bytes, wide()))


def ulog_subscriptions(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Announce a topic, log a row or none, announce the next: thousands of topics or instances."""
    again, n_rows = rng.random() < 0.3, rng.choice((0, 1, 3))

    def topics() -> Iterator[bytes]:
        yield _format("many", ["uint64_t timestamp", "float x"])
        for number in count():
            msg_id = 40_000 + number % 20_000
            if again:
                yield _format("many", ["uint64_t timestamp", "float x"])
            yield _subscribe(msg_id, "many", number % 256)
            yield _row(msg_id, struct.pack("<Qf", number, 0.0)) * n_rows

    return _after_header(content, _up_to(n_bytes, topics()))


def ulog_redefined(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Define a topic's format anew before every subscription: no layout holds for long."""

    def versions() -> Iterator[bytes]:
        yield _format("base", [f"float {_name(k)}" for k in range(400)])
        for number in count():
            yield _format("other", [f"float {_name(number)}"])
            yield _subscribe(40_000, "base", rng.randrange(4))

    return _after_header(content, _up_to(n_bytes, versions()))


def ulog_texts(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Log parameters, information, texts or dropouts by the thousand."""
    kind = rng.choice("PILOM")

    def messages() -> Iterator[bytes]:
        for number in count():
            key = f"float P_{_name(number)}".encode()
            bodies = {
                "P": bytes([len(key)]) + key + struct.pack("<f", number),
                "I": bytes([len(key)]) + key + struct.pack("<f", number),
                "M": bytes([0, len(key)]) + key + struct.pack("<f", number),
                "L": b"6" + struct.pack("<Q", 1000 * number) + f"text {number}".encode(),
                "O": struct.pack("<H", number % 60_000),
            }
            yield _message(kind, bodies[kind])

    frames = ulog_frames(bytearray(content))
    place = frames[rng.randrange(len(frames))][0] if frames else ULOG_HEADER
    return content[:place] + _up_to(n_bytes, messages()) + content[place:]


# ---- DataFlash


def _definition(type_id: int, length: int, name: str, format_: str, labels: str) -> bytes:
    return DATAFLASH_HEADER + struct.pack(
        "<BBB4s16s64s", 0x80, type_id, length, name.encode(), format_.encode(), labels.encode()
    )


def _in_dataflash(rng: random.Random, content: bytes, messages: bytes) -> bytes:
    """Put messages behind the definitions of a log, or at its end."""
    frames = [(b, e) for b, e in dataflash_frames(bytearray(content)) if content[b + 2] == 0x80]
    place = rng.choice((frames[-1][1] if frames else 0, len(content)))
    return content[:place] + messages + content[place:]


def dataflash_versions(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Define one or all message types anew over and over, with other labels, a row or none of each."""
    n_ids, n_rows, longer = rng.choice((1, 50)), rng.choice((0, 1)), rng.choice((0, 1))
    names = rng.choice((("RATE",), ("RATE", "ATT", "IMU", "PARM", "MODE"), tuple(map(_name, range(50)))))

    def versions() -> Iterator[bytes]:
        for number in count():
            type_id = 200 + number % n_ids
            labels = "TimeUS," + ",".join(_name(number + k) for k in range(6))
            yield _definition(type_id, 35 + longer, names[number % len(names)], "Qffffff", labels)
            yield (
                DATAFLASH_HEADER + bytes([type_id]) + struct.pack("<Q6f", number, *range(6)) + bytes(longer)
            ) * n_rows

    return _in_dataflash(rng, content, _up_to(n_bytes, versions()))


def dataflash_texts(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Log parameters, texts, modes or units by the thousand, each different."""
    name, format_, labels = rng.choice(
        (
            ("PARM", "QNff", "TimeUS,Name,Value,Default"),
            ("MSG", "QZ", "TimeUS,Message"),
            ("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
            ("UNIT", "QbZ", "TimeUS,Id,Label"),
            ("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
            ("VER", "QZ", "TimeUS,FWS"),
            ("ERR", "QBB", "TimeUS,Subsys,ECode"),
            ("EV", "QB", "TimeUS,Id"),
        )
    )
    sizes = {"Q": 8, "N": 16, "Z": 64, "f": 4, "M": 1, "B": 1, "b": 1}
    length = 3 + sum(sizes[character] for character in format_)

    def rows() -> Iterator[bytes]:
        yield _definition(250, length, name, format_, labels)
        for number in count():
            body = struct.pack("<Q", 1000 * number)
            for character in format_[1:]:
                text = f"{_name(number)}".encode().ljust(sizes[character], b"\0")
                body += text if character in "NZ" else bytes([number % 200] + [0] * (sizes[character] - 1))
            yield DATAFLASH_HEADER + bytes([250]) + body

    return _in_dataflash(rng, content, _up_to(n_bytes, rows()))


# ---- DataFlash as text


def text_versions(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Define one message type, or thousands, with a line or none of each."""
    names = rng.choice((("RATE",), ("RATE", "ATT", "PARM"), tuple(_name(k).upper() for k in range(20_000))))
    n_rows = rng.choice((0, 1))

    def lines() -> Iterator[bytes]:
        for number in count():
            name = names[number % len(names)]
            labels = ",".join(_name(number + k) for k in range(3))
            yield f"FMT, {number % 256}, 15, {name}, fff, {labels}\n".encode()
            yield f"{name}, 1.0, 2.0, 3.0\n".encode() * n_rows

    head = (
        b"" if content.startswith(b"FMT,") else b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n"
    )
    return head + _up_to(n_bytes, lines()) + content


def text_wide(rng: random.Random, content: bytes, n_bytes: int) -> bytes:  # noqa: ARG001
    """Write a table with as many columns as its header can hold, and cells or none in its rows."""
    n_columns = rng.choice((100, 3000, 12_000))
    names = [
        "time_s",
        "p_rad_s",
        "q_rad_s",
        "r_rad_s",
        "L_command",
        "M_command",
        "N_command",
        *map(_name, range(n_columns)),
    ]
    cells = rng.choice(("", "0", "x"))

    def rows() -> Iterator[bytes]:
        yield (",".join(names) + "\n").encode()
        for number in count():
            first = [f"{number / 50:.2f}", *(rng.choice(("0.1", "-0.2", "x")) for _ in range(6))]
            yield (",".join([*first, *([cells] * n_columns)]) + "\n").encode()

    return _up_to(n_bytes, rows())


def text_gaps(rng: random.Random, content: bytes, n_bytes: int) -> bytes:  # noqa: ARG001
    """Write a table whose rows come in segments of some seconds, or single, with gaps between."""
    rate_hz, segment_s, gap_s = 50.0, rng.choice((0.1, 2.1, 5.0)), rng.choice((0.5, 3.0, 1000.0))

    def rows() -> Iterator[bytes]:
        yield b"time_s,p_rad_s,q_rad_s,r_rad_s,phi_rad,theta_rad,psi_rad,"
        yield b"L_command,M_command,N_command,throttle\n"
        time_s, rate = 0.0, [0.0, 0.0, 0.0]
        for number in count():
            torque = [rng.uniform(-1.0, 1.0) for _ in range(3)]
            rate = [0.9 * p + 100.0 * u / rate_hz for p, u in zip(rate, torque, strict=True)]
            cells = [time_s, *rate, 0.0, 0.0, 0.0, *torque, 0.4]
            yield (",".join(f"{cell:.4f}" for cell in cells) + "\n").encode()
            time_s += 1.0 / rate_hz
            if number % round(segment_s * rate_hz) == 0:
                time_s += gap_s

    return _up_to(n_bytes, rows())


# ---- MAVLink


def _packet(msg_id: int, payload: bytes, system: int, component: int, time_us: int) -> bytes:
    head = bytes([0xFE, len(payload), 0, system, component, msg_id])
    return struct.pack(">Q", time_us) + bytes(sealed(bytearray(head + payload + b"\0\0")))


def tlog_senders(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Let up to 65 025 systems and components speak."""
    with_heartbeat = rng.random() < 0.7

    def packets() -> Iterator[bytes]:
        for number in count():
            who = (1 + number % 255, number // 255 % 256)
            if with_heartbeat:
                yield _packet(0, struct.pack("<IBBBBB", 0, 2, 3, 0, 0, 3), *who, 1_000_000 + number)
            else:
                yield _packet(30, struct.pack("<I6f", number, *[0.0] * 6), *who, 1_000_000 + number)

    return content + _up_to(n_bytes, packets())


def tlog_texts(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Send parameters, texts or modes by the thousand, each different."""
    kind = rng.choice(("parameter", "text", "mode"))
    frames = tlog_frames(bytearray(content))
    who = (content[frames[0][0] + 3], content[frames[0][0] + 4]) if frames else (1, 1)

    def packets() -> Iterator[bytes]:
        for number in count():
            name = _name(number).encode()
            msg_id, payload = {
                "parameter": (22, struct.pack("<fHH16sB", float(number), 9, 9, name, 9)),
                "text": (253, struct.pack("<B50s", 6, name)),
                "mode": (0, struct.pack("<IBBBBB", number, 2, 3, 217, 4, 3)),
            }[kind]
            yield _packet(msg_id, payload, *who, 1_000_000 + 1000 * number)

    return content + _up_to(n_bytes, packets())


# ---- Parquet


def parquet_columns(rng: random.Random, content: bytes, n_bytes: int) -> bytes:  # noqa: ARG001
    """Write a table whose columns unfold: long texts, dictionaries, many columns, lists, zeros."""
    import pyarrow as pa
    from pyarrow import parquet

    n_rows = rng.choice((1000, 100_000))
    unfold = rng.choice(("dictionary", "text", "columns", "list", "zeros"))
    needed = ["time_s", "p_rad_s", "q_rad_s", "r_rad_s", "L_command", "M_command", "N_command"]
    data = {name: pa.array([0.02 * k for k in range(n_rows)]) for name in needed}
    if unfold in ("dictionary", "text"):
        cell = "x" * rng.choice((10, 10_000, 200_000 if n_rows == 1000 else 20_000))
        text = pa.DictionaryArray.from_arrays(pa.array([0] * n_rows, pa.int32()), pa.array([cell]))
        data[rng.choice(needed)] = text
    elif unfold == "list":
        data["L_command"] = pa.ListArray.from_arrays(
            pa.array([0] + [1000 * (k + 1) for k in range(1000)], pa.int32()), pa.array([0.0] * 1_000_000)
        )
        data = {name: column[:1000] for name, column in data.items()}
    elif unfold == "columns":
        data = {name: column[:100] for name, column in data.items()}
        data |= {_name(k): data["L_command"] for k in range(min(2000, n_bytes // 300))}
    else:
        data |= dict.fromkeys(needed, pa.array([0.0] * (n_rows * 10)))
    sink = pa.BufferOutputStream()
    parquet.write_table(pa.table(data), sink, compression="zstd", store_schema=False)
    return bytes(sink.getvalue())


_BLACKBOX = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n"


def blackbox_wide(rng: random.Random, _content: bytes, n_bytes: int) -> bytes:
    """Return a log of frames of as many fields as can be, each a byte long, or of next to none."""
    n = rng.choice((2, 3, 60, 255, 256, 257))
    names = ["loopIteration", "time", *(f"x[{k}]" for k in range(n - 2))]
    lists = {"name": names, "signed": [0] * n, "predictor": [0] * n, "encoding": [1] * n}
    lines = [f"H Field I {about}:{','.join(map(str, each))}" for about, each in lists.items()]
    for about, value in (("predictor", rng.choice((0, 1, 2, 3))), ("encoding", rng.choice((0, 1, 9)))):
        lines.append(f"H Field P {about}:{','.join([str(value)] * n)}")
    lines += [f"H I interval:{rng.choice((1, 32, 32767))}", "H Firmware revision:Betaflight 4.5.1 (x) Y"]
    body = b"I" + bytes(n) + (b"P" + (b"" if value == 9 else bytes(n))) * 31
    return _BLACKBOX + ("\n".join(lines) + "\n").encode() + body * (n_bytes // len(body))


def blackbox_logs(rng: random.Random, content: bytes, n_bytes: int) -> bytes:
    """Return a file of very many logs, empty or with the header only."""
    header = content[: content.find(b"\nI") + 1]
    one = rng.choice((_BLACKBOX, header, header[:200], _BLACKBOX + b"\n"))
    return one * (n_bytes // max(len(one), 1))


def _usd_kind(number: int, name: str, fields: list[str]) -> bytes:
    listed = b"".join(f"{field}\0".encode() for field in fields)
    return struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(fields)) + listed


def usd_wide(rng: random.Random, _content: bytes, n_bytes: int) -> bytes:
    """Return a log of very many fields or kinds, of which few events or none are there."""
    n_kinds, n_fields = rng.choice(((1, 1000), (1, 1001), (1000, 1), (1000, 0), (40, 200), (1001, 1)))
    fields = [f"gyro.{'xyz'[k % 3]}{'' if k < 3 else k}(f)" for k in range(n_fields)]
    kinds = b"".join(_usd_kind(k, f"event{k}", fields) for k in range(n_kinds))
    body, at = [], 0
    size = 10 + 4 * n_fields
    while at < n_bytes:
        body.append(struct.pack("<HQ", rng.randrange(n_kinds), 1000 * len(body)) + bytes(4 * n_fields))
        at += size
    return struct.pack("<BHH", 0xBC, 2, n_kinds) + kinds + b"".join(body)


def usd_turns(rng: random.Random, _content: bytes, n_bytes: int) -> bytes:
    """Return a log of events that are their number and time only, in turns, or all damaged."""
    version = rng.choice((1, 2))
    head = struct.Struct("<HI" if version == 1 else "<HQ")
    kinds = b"".join(_usd_kind(k, f"event{k}", []) for k in range(2))
    step = rng.choice((0, 1, 4000, 2**31, -4000))
    body = b"".join(
        head.pack(k % rng.choice((1, 2, 3)), max(k * step, 0) % 2**32) for k in range(n_bytes // head.size)
    )
    return struct.pack("<BHH", 0xBC, version, 2) + kinds + body


BY_KIND: dict[str, tuple[Extreme, ...]] = {
    "dataflash": (dataflash_versions, dataflash_texts),
    "ulog": (ulog_nested, ulog_wide, ulog_subscriptions, ulog_redefined, ulog_texts),
    "tlog": (tlog_senders, tlog_texts),
    "blackbox": (blackbox_wide, blackbox_logs),
    "usd": (usd_wide, usd_turns),
    "text": (text_versions, text_wide, text_gaps),
    "plain": (parquet_columns,),
}
