"""Many figures on two processors: all are drawn, errors arrive, and nothing stays behind."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.figures import batch as batch_module
from quadid_logs.figures import png
from quadid_logs.figures.batch import PngBatch
from quadid_logs.figures.spec import Axis, Curve, Figure, Panel

_PATIENCE_S = 60.0


def small_figure(key: str) -> Figure:
    """Return a figure with one line."""
    curve = Curve(label="line", x=np.arange(3.0), y=np.arange(3.0), role="roll")
    panel = Panel(title=key, x=Axis(label="time", unit="s"), y=Axis(label="rate"), curves=(curve,))
    return Figure(key=key, title=key, caption="", panels=(panel,))


@pytest.fixture
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start the helper also where there is one processor only."""
    monkeypatch.setattr(batch_module, "_processors", lambda: 2)


def is_running(pid: int) -> bool:
    """Tell whether a process still does something; one that nobody has awaited does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def waits_until(condition: object) -> bool:
    """Tell whether a condition becomes true in time."""
    end = time.monotonic() + _PATIENCE_S
    while not condition():  # type: ignore[operator]
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


@pytest.mark.usefixtures("two_processors")
def test_the_helper_draws_what_this_process_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each figure is drawn once: here the first, while the helper draws the others."""
    figures = [small_figure(f"f{k}") for k in range(4)]
    drawn_here: list[Path] = []

    def slow(_figure: Figure, path: Path) -> None:
        drawn_here.append(path)
        assert waits_until(lambda: len(list(tmp_path.iterdir())) == len(figures) - 1)

    monkeypatch.setattr(png, "write_png", slow)
    with PngBatch() as batch:
        batch.write(figures, tmp_path)
    assert len(drawn_here) == 1
    others = {f"f{k}.png" for k in range(4)} - {drawn_here[0].name}
    assert {path.name for path in tmp_path.iterdir()} == others
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in tmp_path.iterdir())


@pytest.mark.usefixtures("two_processors")
def test_both_processes_draw_the_same(tmp_path: Path) -> None:
    """The helper's picture is that of this process, byte for byte."""
    figure = small_figure("same")
    png.write_png(figure, tmp_path / "here.png")
    batch = PngBatch()
    with batch:
        batch._feed(batch_module.deque([figure]), [], tmp_path)
    assert (tmp_path / "same.png").read_bytes() == (tmp_path / "here.png").read_bytes()


@pytest.mark.usefixtures("two_processors")
def test_what_a_dead_helper_does_not_draw_is_drawn_here(tmp_path: Path) -> None:
    """Killed by the system for want of memory, say: the report is complete all the same."""
    with PngBatch() as batch:
        assert batch._helper is not None
        batch._helper.kill()
        batch.write([small_figure(f"f{k}") for k in range(3)], tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"f0.png", "f1.png", "f2.png"}


@pytest.mark.usefixtures("two_processors")
def test_a_failure_of_the_helper_is_raised_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it cannot write, this process cannot write either, and says so."""
    batch = PngBatch()
    unconfirmed: list[Figure] = []
    with batch:
        batch._feed(batch_module.deque([small_figure("f")]), unconfirmed, tmp_path / "missing")
        assert [figure.key for figure in unconfirmed] == ["f"]
    with PngBatch() as batch, pytest.raises(FileNotFoundError):
        batch.write([small_figure("f")], tmp_path / "missing")


@pytest.mark.usefixtures("two_processors")
def test_no_helper_survives_ctrl_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The interrupt passes on, and the second process is gone."""

    def interrupted(_figure: Figure, _path: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(png, "write_png", interrupted)
    batch = PngBatch()
    with pytest.raises(KeyboardInterrupt), batch:
        batch.write([small_figure(f"f{k}") for k in range(9)], tmp_path)
    assert batch._helper is not None
    assert batch._helper.returncode is not None


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks /proc")
def test_no_helper_survives_its_killed_parent() -> None:
    """Even if nothing could be tidied up, the helper ends with its input."""
    command = (
        "import os; from quadid_logs.figures import batch; batch._processors = lambda: 2; "
        "print(batch.PngBatch()._helper.pid, flush=True); os._exit(9)"
    )
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 9, done.stderr
    assert waits_until(lambda: not is_running(int(done.stdout)))


def test_without_a_second_processor_all_is_drawn_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither is a process started, nor is a figure lost."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0}, raising=False)
    with PngBatch() as batch:
        assert batch._helper is None
        batch.write([small_figure("only")], tmp_path)
    assert (tmp_path / "only.png").exists()


@pytest.mark.usefixtures("two_processors")
@pytest.mark.parametrize("executable", ["", "/nowhere/python"])
def test_an_interpreter_that_cannot_be_started_is_done_without(
    executable: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Inside another program there may be no interpreter to start."""
    monkeypatch.setattr(sys, "executable", executable)
    with PngBatch() as batch:
        assert batch._helper is None
        batch.write([small_figure("only")], tmp_path)
    assert (tmp_path / "only.png").exists()
