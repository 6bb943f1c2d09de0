"""A printed command makes the analysis again that its page shows."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from quadid_logs import pipeline
from quadid_logs.cli import main
from quadid_logs.data.result import Result
from quadid_logs.data.settings import AlignSettings, IdentifySettings, Settings
from quadid_logs.errors import SettingsError
from quadid_logs.report.commands import filled, on_log, on_next_log, with_next_log
from tests.conftest import REPOSITORY

LOG = REPOSITORY / "sample_logs" / "sysid-quad-x.bin"
CHOSEN = Settings(
    system=1,
    log=2,
    align=AlignSettings(start_s=33.25, end_s=59.0),
    identify=IdentifySettings(high_pass_hz=0.7, smoothing_hz=8.0),
)
ONLY_ANALYZE = replace(
    CHOSEN,
    align=replace(CHOSEN.align, sample_rate_hz=50.0),
    identify=replace(CHOSEN.identify, structure="damped", window=30, stride=3),
)


def chosen(result: Result, settings: Settings = CHOSEN) -> Result:
    """Return a result as if it had been analyzed with these settings."""
    return replace(result, log=replace(result.log, path=str(LOG)), settings=settings)


def settings_by(line: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Settings:
    """Run a command up to its analysis, and return the settings that it has."""
    asked: list[Settings] = []

    def analyze(_log: Path, settings: Settings, **_named: Any) -> Result:
        asked.append(settings)
        raise SettingsError("enough")

    monkeypatch.setattr(pipeline, "analyze", analyze)
    monkeypatch.chdir(tmp_path)
    main(shlex.split(line)[1:])
    (settings,) = asked
    return settings


@pytest.mark.parametrize(
    ("verb", "words"), [("analyze", ()), ("tune", ()), ("export", ("--model", "-o", "model.mat"))]
)
def test_a_command_on_the_log_has_the_settings_of_the_analysis(
    verb: str, words: tuple[str, ...], usable: Result, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Part and band were lost: who pasted the command got another answer."""
    line = on_log(chosen(usable), verb, *words)
    assert settings_by(line, monkeypatch, tmp_path) == CHOSEN


def test_what_only_analyze_takes_is_repeated_by_analyze(
    usable: Result, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Structure, windows and sample rate."""
    line = on_log(chosen(usable, ONLY_ANALYZE), "analyze")
    assert settings_by(line, monkeypatch, tmp_path) == ONLY_ANALYZE


def test_a_time_is_printed_in_full(usable: Result, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A flight of many in one log begins at a time of many digits."""
    part = replace(CHOSEN, align=AlignSettings(start_s=1234567.0123456789))
    assert settings_by(on_log(chosen(usable, part), "tune"), monkeypatch, tmp_path) == part


def test_a_command_on_the_next_log_has_the_band_but_not_the_times_of_this_one(usable: Result) -> None:
    """The next log has a clock of its own, and may be the only one of its file."""
    assert on_next_log(chosen(usable), "tune") == "quadid-log tune NEXT-LOG --system 1 --band 0.7 8"


def test_a_comparison_with_the_next_log_cuts_neither(usable: Result) -> None:
    """`compare` has one start and end for both clocks."""
    words = shlex.split(with_next_log(chosen(usable)))
    assert "--start-s" not in words
    assert words[words.index("--band") :][:3] == ["--band", "0.7", "8"]


def test_advice_names_the_part_that_was_analyzed(usable: Result) -> None:
    """Where the catalogue knows no log; `info` has no band."""
    text = filled("See `quadid-log info LOG`.", chosen(usable))
    assert text == f"See `quadid-log info {LOG} --log 2 --system 1 --start-s 33.25 --end-s 59`."


def test_the_default_analysis_adds_no_option(usable: Result) -> None:
    """A command is as short as it can be."""
    assert on_log(chosen(usable, Settings()), "tune") == f"quadid-log tune {LOG}"
