"""Several logs of one vehicle, one model."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import analyze_pooled, pipeline
from quadid_logs.cli import main
from quadid_logs.data.result import Result
from quadid_logs.errors import SettingsError
from quadid_logs.report.verdict import flown_sentence
from quadid_logs.simulator import simulate
from quadid_logs.writers import write_log

pytestmark = pytest.mark.usefixtures("verdicts_only")


def written(folder: Path, name: str, scenario: str, **choices: object) -> Path:
    path = folder / name
    write_log(simulate(scenario, **choices).log, path)  # type: ignore[arg-type]
    return path


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two short flights of one vehicle: roll only, and all axes."""
    folder = tmp_path_factory.mktemp("flights")
    return [
        written(folder, "roll.bin", "single-axis", seed=1, duration_s=25.0),
        written(folder, "all.bin", "sysid-quad-x", seed=2, duration_s=25.0),
    ]


@pytest.fixture(scope="module")
def pooled(flights: list[Path]) -> Result:
    return analyze_pooled(flights)


def test_one_model_holds_what_all_flights_tell(pooled: Result) -> None:
    """Gains within half a per cent, from the flight of both logs."""
    truth = np.array(simulate("sysid-quad-x", seed=2, duration_s=25.0).truth["models"]["damped"]["B"])
    model = pooled.identification.recommended
    assert model is not None
    np.testing.assert_allclose(np.diag(model.B), np.diag(truth), rtol=0.005)
    assert len(pooled.data.flight_segments) == 2


def test_the_logs_and_what_was_used_of_them_are_named(pooled: Result) -> None:
    """In the result and as a finding."""
    assert [Path(each.path).name for each in pooled.pooled] == ["roll.bin", "all.bin"]
    assert all(each.used_s > 10.0 for each in pooled.pooled)
    assert "QL107" in {finding.code for finding in pooled.diagnosis.findings}


def test_times_of_the_second_log_follow_those_of_the_first(pooled: Result) -> None:
    """One clock that only rises."""
    ends = [time_s for span in pooled.data.flight_segments for time_s in span]
    assert ends == sorted(ends)


@pytest.mark.thorough
def test_logs_of_different_rates_are_pooled_at_the_slower_one(
    flights: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """400 Hz and 100 Hz."""
    monkeypatch.setattr("quadid_logs.pipeline.judge", lambda _log, data, *_given, **_named: data)
    slower = written(tmp_path, "slower.bin", "sysid-quad-x", seed=4, duration_s=25.0, rate_hz=100.0)
    data = pipeline.analyze([flights[1], slower])
    assert data.sample_period_s == pytest.approx(0.01, rel=0.01)
    assert len(data.flight_segments) == 2


@pytest.mark.thorough
def test_newton_metres_and_commands_are_not_pooled(flights: list[Path], tmp_path: Path) -> None:
    """A PX4 log with calibrated rotors beside one with commands."""
    other = written(tmp_path, "other.ulg", "sysid-quad-x", seed=5, duration_s=25.0, autopilot="px4")
    with pytest.raises(SettingsError, match="a normalised command"):
        analyze_pooled([flights[1], other])


def test_the_command_line_writes_one_result_for_all(
    flights: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder of its own, with the names of the logs."""
    arguments = ["analyze", str(flights[0]), str(flights[1]), "--pool", "--no-report", "-o", str(tmp_path)]
    assert main(arguments) == 0
    content = json.loads((tmp_path / "pooled" / "result.json").read_text())
    assert [Path(each["path"]).name for each in content["pooled"]] == ["roll.bin", "all.bin"]
    assert "and 1 more" in capsys.readouterr().out


def test_what_was_used_of_a_log_is_what_lies_in_its_segments(pooled: Result) -> None:
    """Not the time on the ground: the sums are those of the pooled flight."""
    used_s = [each.used_s for each in pooled.pooled]
    assert used_s == pytest.approx([end - start for start, end in pooled.data.flight_segments])
    assert 30.0 < sum(used_s) < pooled.data.duration_s


def test_the_terminal_counts_the_seconds_of_the_logs_only(pooled: Result) -> None:
    """Two logs of 25 s, a minute apart on the common clock."""
    assert 48.0 < pooled.data.duration_s <= 50.0
    assert flown_sentence(pooled).endswith(f"of {pooled.data.duration_s:.1f} s analyzed")


def test_what_is_told_of_the_vehicle_is_that_of_the_first_log_that_flew(
    flights: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log ahead of it ended on the ground."""
    monkeypatch.setattr("quadid_logs.pipeline.judge", lambda log, *_given, **_named: log)
    ground = tmp_path / "ground.bin"
    ground.write_bytes(flights[1].read_bytes()[:30_000])
    log = pipeline.analyze([ground, flights[1]])
    assert Path(log.path).name == "all.bin"
