"""Files for the user: what a failed, a killed and a following run leave behind."""

from __future__ import annotations

import errno
import os
import platform
import re
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.errors import OutputError
from quadid_logs.fleets import store as store_module
from quadid_logs.fleets.options import Options
from quadid_logs.fleets.store import Store
from quadid_logs.output import DOWNLOADS, beside_prefix, new_folder, remove_unfinished, write_together
from quadid_logs.report.folder import check_folder, report_folders, write_report
from tests.synthetic_results import usable_result

LOG = Path(__file__).parents[1] / "sample_logs" / "default-logging.bin"
_KILLED = """
import os, signal, sys, tempfile
from pathlib import Path
from quadid_logs.output import beside_prefix
folder = Path(sys.argv[1])
(folder / f"{beside_prefix()}x.html").write_text("half")
(Path(tempfile.mkdtemp(prefix=beside_prefix(), dir=folder)) / "report.html").write_text("half")
os.kill(os.getpid(), signal.SIGKILL)
"""


def full_disk(*_arguments, **_options):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_the_next_run_removes_what_a_killed_one_left(tmp_path):
    """Its half-written files and folders."""
    subprocess.run([sys.executable, "-c", _KILLED, str(tmp_path)], check=False)
    assert len(list(tmp_path.iterdir())) == 2
    write_together(tmp_path, {"y.html": b"whole"})
    assert [path.name for path in tmp_path.iterdir()] == ["y.html"]


def test_a_report_removes_what_a_killed_one_left(tmp_path):
    """In the folder beside which it lies."""
    subprocess.run([sys.executable, "-c", _KILLED, str(tmp_path)], check=False)
    write_report(usable_result(), tmp_path / "flight", drawings=False)
    assert [path.name for path in tmp_path.iterdir()] == ["flight"]


def test_what_another_run_is_writing_stays(tmp_path):
    """One that lives, one of another machine, and a file of the user."""
    host = re.sub(r"\W", "_", platform.node())
    for name in (f".quadid-{host}-{os.getppid()}-a", ".quadid-elsewhere-1-a", ".quadid-abc", "quadid-notes"):
        (tmp_path / name).write_text("x")
    remove_unfinished(tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


def test_what_nobody_has_touched_for_a_day_is_removed(tmp_path):
    """Of whatever machine and version."""
    for name in (".quadid-elsewhere-1-a", ".quadid-abc"):
        (tmp_path / name).write_text("x")
        os.utime(tmp_path / name, (time.time() - 90_000.0,) * 2)
    remove_unfinished(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_folder_of_a_report(tmp_path, monkeypatch):
    """Neither the report's nor those above it that it made."""
    monkeypatch.setattr(Path, "write_text", full_disk)
    with pytest.raises(OutputError, match="No space"):
        write_report(usable_result(), tmp_path / "out" / "flight", drawings=False)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_store(tmp_path, monkeypatch):
    """A next run finds a free place, not a store of nothing."""

    def full(self, options):
        self._database.execute("CREATE TABLE half (x)")
        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr(store_module.Store, "_open", full)
    with pytest.raises(OutputError, match="full"):
        Store(tmp_path / "deep" / "store", Options(), resume=False)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_removes_no_folder_that_was_there(tmp_path):
    """Nor one that holds something."""
    (tmp_path / "there").mkdir()

    def fail(folder, name=""):
        with new_folder(folder):
            if name:
                (folder / name).write_text("x")
            raise OutputError("no")

    for folder, name in ((tmp_path / "there", ""), (tmp_path / "new", "file")):
        with pytest.raises(OutputError, match="no"):
            fail(folder, name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "there"]


def test_an_output_folder_that_is_a_link_is_refused(tmp_path):
    """For reports and for stores, whether the link leads to an empty folder or not."""
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    with pytest.raises(OutputError, match="symbolic link"):
        check_folder(tmp_path / "link" / "flight", force=True)
    with pytest.raises(OutputError, match="symbolic link"):
        Store(tmp_path / "link", Options(), resume=False)
    assert list((tmp_path / "there").iterdir()) == []


def test_no_log_takes_the_place_of_the_index():
    """index.html.bin would, and the page be refused after all the work."""
    folders = report_folders([Path("index.html.bin"), Path("a/Index.html.ulg"), Path("b.bin")], Path("out"))
    assert [folder.name for folder in folders] == ["index.html-bin", "Index.html-ulg", "b"]


def test_every_verb_with_an_output_refuses_a_link(tmp_path, capsys):
    """Before the work: the folder of plan, compare and paper, the file of simulate."""
    (tmp_path / "there").mkdir()
    link, log = tmp_path / "link", tmp_path / "link.bin"
    link.symlink_to(tmp_path / "there")
    log.symlink_to(tmp_path / "there" / "flight.bin")
    sample = str(Path(__file__).parents[1] / "sample_logs" / "sysid-quad-x.bin")
    for command in (
        ["plan", "--autopilot", "px4", "-o", str(link)],
        ["compare", sample, sample, "-o", str(link)],
        ["repeat", sample, sample, "-o", str(link)],
        ["paper", "-o", str(link)],
        ["simulate", "hover", "-o", str(log), "--force"],
    ):
        assert main(command) == 2, command
        assert "symbolic link" in capsys.readouterr().err, command
    assert list((tmp_path / "there").iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
def test_a_terminated_run_leaves_no_half_written_folder(tmp_path):
    """As a batch queue or a shutdown ends it: while it writes, and nothing was there before."""
    script = (
        "import os, signal, sys\n"
        "from quadid_logs.cli import run\n"
        "from quadid_logs.report import folder\n"
        "folder.check_free = lambda *_, **__: os.kill(os.getpid(), signal.SIGTERM)\n"
        f"sys.argv = ['quadid-log', 'analyze', {str(LOG)!r}, '-o', {str(tmp_path / 'n')!r}, '--no-report']\n"
        "run()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 143
    assert "no file was left half-written" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_next_run_removes_the_downloads_of_a_killed_fleet(tmp_path):
    """They lie in the temporary folder, gigabytes of them; those of a run that goes on stay."""
    ours = tmp_path / f"{beside_prefix(DOWNLOADS)}x"
    dead = tmp_path / ours.name.replace(str(os.getpid()), "4194304999")
    for folder in (ours, dead):
        folder.mkdir()
        (folder / "log").write_text("log")
    remove_unfinished(tmp_path, DOWNLOADS)
    assert list(tmp_path.iterdir()) == [ours]
