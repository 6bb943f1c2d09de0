"""Say what a file that is no flight log looks like."""

from __future__ import annotations

from typing import Final, NamedTuple


class _Foreign(NamedTuple):
    """A kind of file that people take for a log, known by how it begins."""

    begins: tuple[bytes, ...]
    hint: str


_KINDS: Final = (
    _Foreign(
        (b"version https://git-lfs",),
        'This is a Git-LFS pointer, not the log itself: run "git lfs pull" in its repository.',
    ),
    _Foreign(
        (b"<!doctype html", b"<html", b"<?xml"),
        "This is a web page that was saved instead of the log. Download the log itself.",
    ),
    _Foreign((b"PK\x03\x04", b"PK\x05\x06"), "This is a zip archive: unpack it first."),
    _Foreign((b"\x1f\x8b",), "This is gzip-compressed: unpack it first."),
    _Foreign((b"7z\xbc\xaf", b"Rar!", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd"),
             "This is an archive: unpack it."),
    _Foreign((b"PA\x05", b"PA\x06"), "This looks like a dump of ArduPilot's parameter storage (eeprom)."),
    _Foreign((b"\x89HDF", b"MATLAB"), "This is a MATLAB or HDF5 file: export the columns to CSV or Parquet."),
    _Foreign((b"loopIteration,", b'"loopIteration",', b'"Product",'),
             "This table was made from a Blackbox log. Use the log itself (.bbl, .bfl, .txt)."),
    _Foreign((b'{"meta":',), "This was made from an ArduPilot log. Use the log itself (.bin)."),
    _Foreign((b"#ROSBAG", b"\x89MCAP", b"SQLite"),
             "This is a ROS bag: export its columns to CSV or Parquet."),
)  # fmt: skip


def explain_foreign(head: bytes, known: str) -> str:
    """Return what a file beginning with `head` seems to be, and what to do.

    Parameters
    ----------
    head : bytes
        First bytes of the file, at least some hundred where it is that long.
    known : str
        The formats that can be read.

    Returns
    -------
    str
        One or two sentences.
    """
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    for kind in _KINDS:
        if any(start.startswith(begin.lower()) for begin in kind.begins):
            return kind.hint
    if not head.strip(b"\0"):
        return "Its beginning is all zeros: the card was full or the copy failed."
    if not head.strip(b"\xff"):
        return "Its beginning is erased flash memory (0xff)."
    # Tell whether the bytes are text: no control characters besides white space.
    sample = head[:4096]
    if not any(byte < 32 and byte not in b"\t\r\n\f\x1b" for byte in sample):
        return (
            "It is text, but neither a log nor a table with a column time_s (and p_rad_s, q_rad_s, "
            f"r_rad_s, ...). Known formats: {known}."
        )
    return f"Known formats: {known}."
