"""Rows that we and the reference readers keep of damaged logs.

Run with ``python benchmarks/damage.py``; prints two Markdown tables. The logs are
the corpus' damaged ones, and its intact ones with 100 blocks of 512 bytes
overwritten with zeros, which is what a failing card leaves behind.
"""

from __future__ import annotations

import contextlib
import io
import os
import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from benchmarks.logs import corpus_folder
from quadid_logs.errors import QuadidError

DAMAGED = (
    "damaged/truncated-80k-ac462-real.bin",
    "damaged/garbage-tail-ac47-sitl.bin",
    "damaged/only-header-600B.bin",
    "damaged/sitl-flightlogs-bad-packets-4MB.tlog",
    "damaged/one-packet-70B.tlog",
    "damaged/px4-1.17-x500-v6xrt-outdoor-89s-corrupt.ulg",
    "damaged/appended-multiple.ulg",
    "damaged/corrupt-wrong-size.ulg",
    "damaged/corrupt-format-not-utf8.ulg",
)
INTACT = (
    "firmware/ac47_quadx_doublets.BIN",
    "firmware/ac47_quadx_multisine.tlog",
    "firmware/px4_quad_default_logging.ulg",
)
N_BLOCKS, BLOCK_BYTES = 100, 512


def main() -> None:
    """Print the tables."""
    # pymavlink writes a line for every byte that it skips.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    folder = corpus_folder()
    print("| log | damage | rows, quadid-logs | rows, reference | reference |")
    print("|---|---|---|---|---|")
    for name in DAMAGED:
        print(_line(folder / name, "as found"))
    with tempfile.TemporaryDirectory() as scratch:
        for name in INTACT:
            print(_line(folder / name, "none"))
            copy, _ = _with_holes(folder / name, Path(scratch))
            print(_line(copy, f"{N_BLOCKS} x {BLOCK_BYTES} B zeroed"))
        copy, starts = _with_holes(folder / INTACT[0], Path(scratch))
        print(f"\nRows of {copy.name} that reach into zeroed bytes and are handed out as data:")
        for reader, rows in (("quadid-logs", _ours_places), ("pymavlink", _pymavlink_places)):
            print(f"{reader} {_n_overlapping(*rows(str(copy)), starts)}")


def _n_overlapping(begin: np.ndarray, end: np.ndarray, starts: np.ndarray) -> int:
    """Count the rows that overlap a zeroed block."""
    return int(
        np.count_nonzero(np.searchsorted(starts + BLOCK_BYTES, begin, "right") < np.searchsorted(starts, end))
    )


def _ours_places(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Return where our rows begin and end."""
    from quadid_logs.containers.dataflash import DataFlashFile

    with DataFlashFile.open(path) as file:
        length = {definition.name: definition.length for definition in file.definitions}
        tables = file.read_messages().values()
    begin = np.concatenate([table.position for table in tables])
    return begin, begin + np.repeat([length[t.name] for t in tables], [t.n_rows for t in tables])


def _pymavlink_places(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Return where pymavlink's rows begin and end."""
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary(path)
    places = []
    while (message := reader.recv_msg()) is not None:
        places.append((reader.offset - message.fmt.len, reader.offset))
    begin, end = np.array(places).T
    return begin, end


def _with_holes(path: Path, folder: Path) -> tuple[Path, np.ndarray]:
    """Return a copy of the log with blocks of zeros, never at the very beginning, and where they are."""
    content, rng = bytearray(path.read_bytes()), random.Random(0)
    starts = sorted(rng.sample(range(len(content) // 20, len(content) - BLOCK_BYTES, BLOCK_BYTES), N_BLOCKS))
    for start in starts:
        content[start : start + BLOCK_BYTES] = bytes(BLOCK_BYTES)
    copy = folder / path.name
    copy.write_bytes(content)
    return copy, np.array(starts)


def _line(path: Path, damage: str) -> str:
    """Return one line of the table."""
    theirs, reference = {
        ".bin": (_pymavlink_dataflash, "pymavlink"),
        ".tlog": (_pymavlink_tlog, "pymavlink"),
        ".ulg": (_pyulog, "pyulog"),
    }[path.suffix.lower()]
    return f"| {path.name} | {damage} | {_rows(_ours, path)} | {_rows(theirs, path)} | {reference} |"


def _rows(count: Callable[[str], int], path: Path) -> str:
    """Return the number of rows, or how the reader gave up."""
    with contextlib.redirect_stdout(io.StringIO()):
        try:
            return str(count(str(path)))
        except QuadidError as error:
            return f"refused: {type(error).__name__}"
        except Exception as error:  # noqa: BLE001 - whatever the reference does is the result
            return f"stops with {type(error).__name__}"


def our_places(path: str | Path) -> np.ndarray:
    """Return where the rows that we read of a log begin, in file order."""
    from quadid_logs.containers.dataflash import read_messages as read_dataflash
    from quadid_logs.containers.tlog import read_messages as read_tlog
    from quadid_logs.containers.ulog import read_topics

    read = {".bin": read_dataflash, ".tlog": read_tlog, ".ulg": read_topics}[Path(path).suffix.lower()]
    tables = [table.position for table in read(path).values()]
    return np.sort(np.concatenate([np.zeros(0, np.int64), *tables]))


def _ours(path: str) -> int:
    return len(our_places(path))


def _pymavlink_dataflash(path: str) -> int:
    from pymavlink.DFReader import DFReader_binary

    return _count(DFReader_binary(path).recv_msg)


def _pymavlink_tlog(path: str) -> int:
    from pymavlink import mavutil

    connection = mavutil.mavlink_connection(path, dialect="ardupilotmega")
    receive = connection.recv_msg
    n_rows = 0
    while (message := receive()) is not None:
        n_rows += message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN")
    return n_rows


def _pyulog(path: str) -> int:
    from pyulog import ULog

    return sum(len(topic.data["timestamp"]) for topic in ULog(path).data_list)


def _count(receive: Callable[[], object]) -> int:
    """Count the messages that a reader hands out."""
    n_rows = 0
    while receive() is not None:
        n_rows += 1
    return n_rows


if __name__ == "__main__":
    main()
