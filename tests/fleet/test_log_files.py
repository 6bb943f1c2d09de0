"""Which files are taken, from where, and what happens to those that cannot be fetched."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import fsspec
import pytest

from quadid_logs.errors import LogNotFoundError
from quadid_logs.fleet import log_files
from quadid_logs.fleet.log_files import FetchError, LogFile, fetched, find_logs


@pytest.fixture
def folder(tmp_path):
    """Logs at two depths, and what lies beside them."""
    for name in ("b.BIN", "a.ulg", "deep/er/c.tlog", "deep/video.mp4", "deep/.hidden.bin", "table.csv"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    return tmp_path


def names(found):
    return [Path(file.url).name for file in found]


def test_a_folder_is_searched_to_the_bottom_for_logs(folder):
    """In the order of the names, and nothing but logs."""
    assert names(find_logs([str(folder)])) == ["a.ulg", "b.BIN", "c.tlog"]


def test_a_pattern_takes_what_it_matches(folder):
    """Whoever writes one knows what he wants."""
    assert names(find_logs([f"{folder}/**/*.mp4"])) == ["video.mp4"]


def test_a_file_named_twice_is_taken_once(folder, monkeypatch):
    """By name, by pattern, by folder, and relative."""
    monkeypatch.chdir(folder)
    assert names(find_logs(["a.ulg", f"{folder}/a.ulg", "./a.u*"])) == ["a.ulg"]


def test_a_name_that_looks_like_a_pattern_is_a_name(tmp_path):
    """As the phone numbered it."""
    (tmp_path / "log[1].bin").write_bytes(b"x")
    assert names(find_logs([str(tmp_path / "log[1].bin")])) == ["log[1].bin"]


@pytest.mark.parametrize("place", ["missing.bin", "*.nothing", "."])
def test_a_place_without_logs_is_named(tmp_path, monkeypatch, place):
    """A typing error must not end in an empty store."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LogNotFoundError, match="no log at"):
        find_logs([place])


@pytest.fixture
def memory():
    """A remote file system inside this process."""
    files = fsspec.filesystem("memory")
    for name in ("/fleet/one.bin", "/fleet/deep/two.ulg", "/fleet/notes.txt"):
        files.pipe(name, name.encode())
    yield files
    files.rm("/fleet", recursive=True)


def test_a_remote_folder_is_searched_like_a_local_one(memory):
    """With size and time of modification."""
    found = find_logs(["memory://fleet"])
    assert [file.url for file in found] == ["memory:///fleet/deep/two.ulg", "memory:///fleet/one.bin"]
    assert [file.n_bytes for file in found] == [19, 14]
    assert all(file.modified_s > 1.7e9 for file in found)


def test_remote_patterns_and_files_are_found(memory):
    """As local ones."""
    assert names(find_logs(["memory://fleet/*.txt"])) == ["notes.txt"]
    assert names(find_logs(["memory://fleet/one.bin"])) == ["one.bin"]


def test_a_protocol_that_nobody_knows_is_one_clear_line():
    """No traceback of a library."""
    with pytest.raises(FetchError, match="gopher"):
        find_logs(["gopher://host/fleet"])


def test_a_download_is_hashed_and_deleted(memory):
    """What the worker reads is what the store names it by."""
    with fetched(LogFile(url="memory:///fleet/one.bin"), 1000) as (path, sha256):
        assert path.read_bytes() == b"/fleet/one.bin"
        assert sha256 == hashlib.sha256(b"/fleet/one.bin").hexdigest()
    assert not path.exists()


def test_a_file_above_the_limit_is_not_fetched(memory):
    """The disk is not filled first."""
    with pytest.raises(FetchError, match="larger than"), fetched(LogFile(url="memory:///fleet/one.bin"), 13):
        pass


def test_a_network_that_fails_once_is_asked_again(memory, monkeypatch):
    """Two failures, then it works."""
    monkeypatch.setattr(log_files, "_PAUSES_S", (0.0, 0.0, 0.0))
    asked = []

    def unreliable(url, path, max_bytes):
        asked.append(url)
        if len(asked) < 3:
            raise TimeoutError("slow down")
        return whole(url, path, max_bytes)

    whole = log_files._download_once
    monkeypatch.setattr(log_files, "_download_once", unreliable)
    with fetched(LogFile(url="memory:///fleet/one.bin"), 1000) as (path, _):
        assert path.exists()
    assert len(asked) == 3


def test_a_network_that_is_down_is_a_reason(memory, monkeypatch):
    """With what the library said."""
    monkeypatch.setattr(log_files, "_PAUSES_S", (0.0, 0.0, 0.0))
    with (
        pytest.raises(FetchError, match="cannot be fetched: FileNotFoundError"),
        fetched(LogFile(url="memory:///fleet/gone.bin"), 1000),
    ):
        pass


def test_a_pipe_is_no_file(tmp_path):
    """Reading it would never end."""
    os.mkfifo(tmp_path / "pipe.bin")
    with (
        pytest.raises(FetchError, match="no regular file"),
        fetched(LogFile(url=str(tmp_path / "pipe.bin")), 9),
    ):
        pass
