"""The verbs simulate and paper."""

from __future__ import annotations

import json

import numpy as np
import pytest

from quadid_logs.cli.paper import paper
from quadid_logs.cli.simulate import simulate
from quadid_logs.errors import OutputError, SettingsError, SimulationError
from quadid_logs.load import read_log
from quadid_logs.simulator import SCENARIOS


def test_the_list_has_a_line_per_scenario(capsys):
    """Its name, then a sentence."""
    assert simulate(list_scenarios=True) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(SCENARIOS)
    assert all(line.endswith(".") for line in lines)


@pytest.mark.parametrize("suffix", ["bin", "ulg", "tlog"])
def test_a_written_flight_reads_back(tmp_path, suffix):
    """File and truth stand side by side, and the file is the flight."""
    path = tmp_path / f"flight.{suffix}"
    assert simulate("sysid-quad-x", path, duration_s=15.0, rate_hz=100.0) == 0
    truth = json.loads((tmp_path / "flight.truth.json").read_text())
    log = read_log(path)
    assert truth["autopilot"] == log.autopilot
    assert log.corrupt_bytes == 0
    (begin, end) = truth["segments_s"][0]
    rate = log.candidates("body_rate")[0]
    in_flight = (rate.time_s > begin) & (rate.time_s < end)
    rms = np.sqrt(np.mean(rate.values[in_flight] ** 2, axis=0))
    np.testing.assert_allclose(rms, truth["excitation"]["rms_rate_rad_s"], rtol=0.05)


@pytest.mark.thorough
@pytest.mark.usefixtures("flown_each_time")
def test_the_same_seed_writes_the_same_bytes(tmp_path):
    """Two runs, one file."""
    for name in ("a.bin", "b.bin"):
        simulate("wind", tmp_path / name, seed=9, duration_s=15.0, rate_hz=50.0)
    assert (tmp_path / "a.bin").read_bytes() == (tmp_path / "b.bin").read_bytes()
    assert (tmp_path / "a.truth.json").read_bytes() == (tmp_path / "b.truth.json").read_bytes()


def test_the_damaged_scenario_writes_a_damaged_file(tmp_path):
    """The reader finds lost bytes, and still a flight."""
    simulate("damaged", tmp_path / "flight.bin", duration_s=15.0)
    log = read_log(tmp_path / "flight.bin")
    assert log.corrupt_bytes > 1000
    assert log.candidates("torque_command")[0].n_samples > 4000


def test_nothing_is_overwritten_without_force(tmp_path):
    """Neither the log nor the truth."""
    (tmp_path / "flight.truth.json").write_text("mine")
    with pytest.raises(OutputError, match="exists"):
        simulate("hover", tmp_path / "flight.bin")
    assert simulate("hover", tmp_path / "flight.bin", duration_s=15.0, rate_hz=10.0, force=True) == 0
    assert (tmp_path / "flight.truth.json").read_text() != "mine"


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("hover", "flight.csv"), SettingsError),
        (("", "flight.bin"), SettingsError),
        (("no-such", "flight.bin"), SimulationError),
    ],
)
def test_wrong_usage_is_refused_and_writes_nothing(tmp_path, arguments, error):
    """A wrong ending, no scenario, an unknown one."""
    name, file = arguments
    with pytest.raises(error):
        simulate(name, tmp_path / file)
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
def test_paper_prints_its_page_and_writes_it(tmp_path, capsys):
    """Page, table of windows and three figures; a second run needs --force."""
    assert paper(tmp_path / "page") == 0
    assert "What cannot be identified" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "page").iterdir()}
    assert names == {"paper.md", "paper.html", "windows.csv", "fig4.png", "windows.png", "tables.png"}
    with pytest.raises(OutputError, match="exists"):
        paper(tmp_path / "page")
