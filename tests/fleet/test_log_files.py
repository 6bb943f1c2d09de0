"""Which files are taken, from where, and what happens to those that cannot be fetched."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import ClassVar
from urllib.parse import urlsplit

import fsspec
import pytest

from quadid_logs.errors import LogError, LogNotFoundError
from quadid_logs.fleets import log_files
from quadid_logs.fleets.log_files import FetchError, LogFile, fetched, find_logs, without_secrets
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.tasks import Task
from quadid_logs.fleets.work import work


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


def test_a_text_file_of_a_folder_is_taken_if_it_begins_like_a_log(folder):
    """Sixteen of 65 logs ended in .TXT, as firmware names them on its card, and were left out in silence."""
    (folder / "LOG00001.TXT").write_bytes(b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n")
    (folder / "settings.txt").write_text("set p_roll = 45")
    names = {Path(file.url).name for file in find_logs([str(folder)])}
    assert "LOG00001.TXT" in names
    assert "settings.txt" not in names


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


class Vault(fsspec.get_filesystem_class("memory")):
    """A file system behind user and password, which names files without saying where it is connected to."""

    protocol = "vault"
    store: ClassVar = {"/fleet/one.bin": None}
    pseudo_dirs: ClassVar = [""]

    @staticmethod
    def _get_kwargs_from_urls(path):
        parts = urlsplit(path)
        return {"user": parts.username, "password": parts.password}

    @classmethod
    def _strip_protocol(cls, path):
        return urlsplit(path).path if "://" in path else super()._strip_protocol(path)

    def __init__(self, *arguments, user=None, password=None, **options):
        super().__init__(*arguments, **options)
        if password != "pass%40word":
            raise PermissionError(f"{user}:{password} is not welcome at vault://{user}:{password}@host/fleet")


@pytest.fixture
def vault():
    """An address with user and password, of a folder with one log."""
    fsspec.register_implementation("vault", Vault, clobber=True)
    files = fsspec.filesystem("memory")
    files.pipe("/fleet/one.bin", b"no log")
    Vault.store = {"/fleet/one.bin": files.store["/fleet/one.bin"]}
    yield "vault://me:pass%40word@host/fleet"
    files.rm("/fleet", recursive=True)


def test_user_and_password_fetch_and_are_stored_nowhere(vault):
    """Neither in the name of the log, nor in its row, nor in what a print shows."""
    (found,) = find_logs([vault])
    assert found.url == "vault://host/fleet/one.bin"
    outcome = work(Task(file=found, options=Options()))
    assert outcome.sha256 == hashlib.sha256(b"no log").hexdigest()
    shown = f"{found} {outcome} {outcome.rows}"
    assert "word" not in shown
    assert "me:" not in shown


@pytest.mark.parametrize("act", [lambda place: find_logs([place]), lambda place: _fetch(place)])
def test_errors_do_not_show_user_and_password(vault, act, monkeypatch):
    """Whatever the library says, also where it quotes the address."""
    monkeypatch.setattr(log_files, "_PAUSES_S", (0.0,))
    with pytest.raises(FetchError) as caught:
        act(vault.replace("pass%40word", "wrong%40word"))
    assert "wrong" not in str(caught.value)
    assert "me:" not in str(caught.value)
    assert "host/fleet" in str(caught.value)
    assert caught.value.__cause__ is None


def _fetch(place):
    with fetched(LogFile(url="vault://host/fleet/one.bin", secret=f"{place}/one.bin"), 100):
        pass


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("https://a:b@host/x.bin", "https://host/x.bin"),
        ("https://token@host/x.bin", "https://host/x.bin"),
        ("ftp://a:b@c@host/x.bin", "ftp://host/x.bin"),
        ("https://host/x.bin?X-Amz-Signature=abc&log=7", "https://host/x.bin?X-Amz-Signature=...&log=7"),
        ("simplecache::sftp://a:b@host/x.bin", "simplecache::sftp://host/x.bin"),
        ("s3://bucket/a@b.bin", "s3://bucket/a@b.bin"),
        ("/home/me:b@c/x.bin", "/home/me:b@c/x.bin"),
    ],
)
def test_only_what_is_secret_is_taken_out_of_an_address(address, shown):
    """Host, path and the number of a log stay."""
    assert without_secrets(address) == shown


def test_an_address_that_makes_no_sense_is_one_clear_line():
    """Each file system raises what it likes."""
    for address in ("s3://", "zip://x", "simplecache::", "://x", "http://["):
        with pytest.raises(LogError):
            find_logs([f"{address}://" if "://" not in address else address])


def test_a_pipe_is_no_file(tmp_path):
    """Reading it would never end."""
    os.mkfifo(tmp_path / "pipe.bin")
    with (
        pytest.raises(FetchError, match="not a regular file"),
        fetched(LogFile(url=str(tmp_path / "pipe.bin")), 9),
    ):
        pass
