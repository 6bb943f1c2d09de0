"""Filters are left as they are where gains alone do better."""

from __future__ import annotations

from pathlib import Path

import pytest

from quadid_logs import analyze
from quadid_logs.control import recommend as recommend_module
from quadid_logs.control.filter_guard import is_no_worse, with_flown_filters
from quadid_logs.data.tuning import AxisTuning
from quadid_logs.simulator import fly
from quadid_logs.simulator.logger import log_flights
from quadid_logs.tuning import recommend
from quadid_logs.writers import write_log
from study import filters as study


# Half a minute of search over three axes; what decides is held, quickly, in `test_filter_design.py`.
@pytest.mark.thorough
def test_filters_stay_where_gains_alone_leave_less_of_gusts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of this vehicle the search's own choice leaves more on one axis at least, whose filters stay."""
    scenario, setting, _ = study.draw_vehicle(1, 4)
    record = fly(study._setup(scenario, setting, 1))
    write_log(log_flights((record,), scenario.logging), tmp_path / "flight.bin")
    flown = analyze(tmp_path / "flight.bin")
    held: list[tuple[AxisTuning, AxisTuning]] = []

    def noted(filtered: AxisTuning, alone: AxisTuning, in_the_end: float) -> bool:
        held.append((filtered, alone))
        return is_no_worse(filtered, alone, in_the_end)

    stayed = {}

    def stay(axis: str, alone: AxisTuning) -> AxisTuning:
        stayed[axis] = alone.gains
        return with_flown_filters(axis, alone)

    monkeypatch.setattr(recommend_module, "is_no_worse", noted)
    monkeypatch.setattr(recommend_module, "with_flown_filters", stay)
    found = recommend(flown, filters=True)
    assert any(searched.attitude_error > alone.attitude_error for searched, alone in held)
    assert stayed
    for axis, gains in stayed.items():
        assert found.axes[axis].filters == {}
        assert found.axes[axis].gains == gains
        assert "QL674" in [reason.code for reason in found.axes[axis].reasons]
