"""Filters are left as they are where gains alone do better."""

from __future__ import annotations

from pathlib import Path

import pytest

from quadid_logs import analyze
from quadid_logs.control import recommend as recommend_module
from quadid_logs.simulate import fly
from quadid_logs.simulate.logger import log_flights
from quadid_logs.tuning import recommend
from quadid_logs.writers import write_log
from study import filters as study


def test_filters_stay_where_gains_alone_leave_less_of_gusts(tmp_path: Path) -> None:
    """Of this vehicle the search's own choice leaves more on roll."""
    scenario, setting, _ = study.draw_vehicle(1, 46)
    record = fly(study._setup(scenario, setting, 1))
    write_log(log_flights((record,), scenario.logging), tmp_path / "flight.bin")
    flown = analyze(tmp_path / "flight.bin")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recommend_module, "is_no_worse", lambda *_: True)
        searched = recommend(flown, filters=True)
    alone, found = recommend(flown), recommend(flown, filters=True)
    assert searched.axes["roll"].attitude_error > alone.axes["roll"].attitude_error
    for axis, one in found.axes.items():
        assert one.filters == {}
        assert one.gains == alone.axes[axis].gains
        assert "QL674" in [reason.code for reason in one.reasons]
