"""A file that holds several logs: every verb that reads one log takes its number."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from quadid_logs.cli import main
from quadid_logs.data.settings import Settings
from quadid_logs.report.next_flight import next_steps
from tests.containers import blackbox_maker as maker
from tests.synthetic_results import usable_result


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Two logs of some frames, too short to fly."""
    rows = [[loop, 1000 * loop + 1_000_000] + [0] * (len(maker.NAMES) - 2) for loop in range(64)]
    path = tmp_path / "two.bbl"
    path.write_bytes(2 * maker.log(rows, settings=maker.SETTINGS))
    return path


@pytest.mark.parametrize(
    "verb",
    [
        ("info", "FILE", "--log", "9"),
        ("analyze", "FILE", "--log", "9"),
        ("tune", "FILE", "--log", "9"),
        ("export", "FILE", "-o", "out.csv", "--log", "9"),
        ("compare", "FILE", "FILE", "--logs", "1", "9"),
    ],
    ids=lambda verb: verb[0],
)
def test_the_number_of_a_log_is_heard(
    verb: tuple[str, ...], file: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`tune` and `compare` could not choose: they said how to, and did not know the option."""
    monkeypatch.chdir(file.parent)
    assert main([str(file) if word == "FILE" else word for word in verb]) == 2
    assert "There is no log 9" in capsys.readouterr().err


def test_the_next_commands_name_the_log_of_the_file() -> None:
    """As they stood there, `tune` and `compare` would have refused the file."""
    result = usable_result()
    steps = " ".join(next_steps(replace(result, settings=Settings(log=4))))
    assert " --log 4 --model -o model.mat" in steps
    assert " NEXT-LOG --logs 4 0`" in steps
