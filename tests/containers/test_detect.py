"""The content decides the format, and every other file gets one clear line."""

from __future__ import annotations

import gzip
import os
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quadid_logs.errors import EmptyLogError, LogError, LogNotFoundError, UnknownFormatError
from quadid_logs.load import read_log

from . import mavlink_maker, ulog_maker


def write(folder: Path, content: bytes, name: str = "file.bin") -> Path:
    """Write a file under a name that means nothing."""
    path = folder / name
    path.write_bytes(content)
    return path


TABLE = b"time_s,p_rad_s,q_rad_s,r_rad_s\n0,0,0,0\n0.01,0,0,0\n"


@pytest.mark.parametrize("suffix", [".bin", ".ulg", ".tlog", ".csv", ".log", ""])
@pytest.mark.parametrize(
    ("content", "expected"),
    [(ulog_maker.small_log(), "ulog"), (mavlink_maker.small_log(), "tlog"), (TABLE, "table")],
    ids=["ulog", "tlog", "table"],
)
def test_the_suffix_does_not_matter(content: bytes, expected: str, suffix: str, tmp_path: Path) -> None:
    """Every format opens under every name."""
    assert read_log(write(tmp_path, content, f"log{suffix}")).format == expected


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("firmware/ac47_quadx_sid_roll.BIN", "dataflash"),
        ("real/ac311-quadx-nan.log", "dataflash-text"),
        ("firmware/ac47_quadx_doublets.tlog", "tlog"),
        ("real/ac32dev-quad-handrotated-52s.tlog", "tlog"),
        ("damaged/one-packet-70B.tlog", "tlog"),
        ("damaged/sitl-flightlogs-bad-packets-4MB.tlog", "tlog"),
        ("real/px4-1.9-quad-escstatus-39s.ulg", "ulog"),
        ("damaged/corrupt-format-not-utf8.ulg", "ulog"),
        ("real/x8coax_moments_hover.csv", "table"),
    ],
)
def test_logs_of_the_corpus_are_recognised(corpus: Path, name: str, expected: str, tmp_path: Path) -> None:
    """Read through a link whose name says nothing."""
    link = tmp_path / "unnamed"
    link.symlink_to(corpus / name)
    assert read_log(link).format == expected


@pytest.mark.corpus
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("damaged/git-lfs-pointer.bin", "git lfs pull"),
        ("damaged/eeprom.bin", "eeprom"),
        ("damaged/not-a-flightlog-aeroprobe.log", "text"),
    ],
)
def test_what_is_no_log_is_called_what_it_is(corpus: Path, name: str, words: str) -> None:
    """The hint names the likely cause."""
    with pytest.raises(UnknownFormatError, match=words):
        read_log(corpus / name)


def _zip(folder: Path) -> bytes:
    """Return a zip archive that holds a log."""
    with zipfile.ZipFile(folder / "made.zip", "w") as archive:
        archive.writestr("flight.ulg", ulog_maker.small_log())
    return (folder / "made.zip").read_bytes()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:07124add\nsize 5000\n", "git lfs pull"),
        (b"\n<!DOCTYPE html><html><body>Sign in</body></html>", "web page"),
        (gzip.compress(b"log"), "gzip"),
        (b"Dear diary, today I flew.\n", "text"),
        (b"loopIteration, time (us), axisP[0], axisP[1]\n 0, 49098688, -1, -11\n", r"the log itself \(.bbl"),
        (b'"loopIteration","time","axisP[0]"\n0,49098688,-1\n', r"the log itself \(.bbl"),
        (b'{"meta": {"timestamp": 1.5, "type": "FMT"}, "data": {}}\n', r"the log itself \(.bin"),
        (b"speed,height\n1,2\n", "time_s"),
        (bytes(5000), "zeros"),
        (b"\xff" * 5000, "erased flash"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "Known formats"),
    ],
    ids=[
        "lfs",
        "html",
        "gzip",
        "prose",
        "decoded",
        "exported",
        "dumped",
        "other-table",
        "zeros",
        "flash",
        "image",
    ],
)
def test_the_hint_says_what_a_foreign_file_looks_like(content: bytes, words: str, tmp_path: Path) -> None:
    """One sentence on what it is and what to do."""
    with pytest.raises(UnknownFormatError, match=words):
        read_log(write(tmp_path, content))


def test_an_archive_is_to_be_unpacked_first(tmp_path: Path) -> None:
    """A zip with a log inside is not opened behind the user's back."""
    with pytest.raises(UnknownFormatError, match="unpack"):
        read_log(write(tmp_path, _zip(tmp_path)))


def test_an_empty_file_is_called_empty(tmp_path: Path) -> None:
    """Zero bytes have no format."""
    with pytest.raises(EmptyLogError, match="0 bytes"):
        read_log(write(tmp_path, b""))


def test_a_missing_file_is_not_found(tmp_path: Path) -> None:
    """The message names the path."""
    with pytest.raises(LogNotFoundError, match=r"nothing\.bin"):
        read_log(tmp_path / "nothing.bin")


def test_a_directory_is_no_log(tmp_path: Path) -> None:
    """A folder of logs is not a log."""
    with pytest.raises(LogNotFoundError, match="directory"):
        read_log(tmp_path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs a device file")
def test_a_device_file_is_not_read(tmp_path: Path) -> None:
    """An endless device would never end."""
    with pytest.raises(LogNotFoundError, match="not a regular file"):
        read_log("/dev/zero")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    """Opening a pipe without a writer would hang."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(LogNotFoundError, match="not a regular file"):
        read_log(tmp_path / "pipe")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_an_unreadable_file_is_named(tmp_path: Path) -> None:
    """Missing permission is no traceback."""
    path = write(tmp_path, b"x")
    path.chmod(0)
    with pytest.raises(LogNotFoundError, match="cannot be read"):
        read_log(path)


@pytest.mark.parametrize("path", ["a\0b", "x" * 5000])
def test_an_impossible_path_is_no_traceback(path: str) -> None:
    """Null characters and endless names."""
    with pytest.raises(LogNotFoundError):
        read_log(path)


STARTS = st.sampled_from(
    [
        b"",
        b"\xa3\x95\x80\x80",
        b"ULog\x01\x12\x35",
        b"FMT, 128, 89, FMT",
        b"PAR1",
        b"time_s,p_rad_s\n",
        b"\0" * 8 + b"\xfe\x09",
    ]
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(start=STARTS, rest=st.binary(max_size=400))
def test_any_bytes_open_or_raise_a_log_error(start: bytes, rest: bytes, tmp_path: Path) -> None:
    """Whatever the file holds, there is no other exception."""
    path = write(tmp_path, start + rest)
    try:
        log = read_log(path)
    except LogError:
        return
    assert log.n_bytes == len(start + rest)


@pytest.mark.thorough
@pytest.mark.corpus
def test_every_log_of_the_corpus_opens_or_says_why_not(corpus: Path) -> None:
    """No file of the corpus ends in anything but a log or a LogError."""
    formats, refusals = set(), []
    for path in sorted((corpus / "real").iterdir()) + sorted((corpus / "damaged").iterdir()):
        try:
            formats.add(read_log(path).format)
        except LogError as error:
            refusals.append(error)
    assert all(error.hint for error in refusals)
    assert formats == {"dataflash", "dataflash-text", "ulog", "tlog", "blackbox", "table"}
