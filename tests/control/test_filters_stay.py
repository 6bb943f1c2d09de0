"""Filters are left as they are where an axis would lose by others."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from quadid_logs.control import recommend as recommend_module
from quadid_logs.control.filter_design import Changes, Together
from quadid_logs.control.filter_guard import Refiltered
from quadid_logs.data.tuning import AxisTuning, GainChange
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from tests import tuned_flights

#: What the search finds, for all axes and for one.
SHARED = Changes({"INS_GYRO_FILTER": 30.0}, {}, {}, {}, {}, {})
OWN = Changes({}, {axis: {"FLTD": 30.0} for axis in AXES}, {}, {}, {}, {})


def _recommended(
    monkeypatch: pytest.MonkeyPatch, chosen: Changes, in_the_end: Mapping[str, float]
) -> Mapping[str, AxisTuning]:
    """Return what is recommended where filters bring this much in the end, below zero for less gust error."""
    told = {axis: Together(one, one, max(one, 0.0)) for axis, one in in_the_end.items()}

    def alone(search: recommend_module._Search, *_: object, **__: object) -> object:
        return AxisTuning(verdict="keep", reasons=(), attitude_error=1.0), search

    def behind(search: recommend_module._Search, _: Changes) -> Refiltered:
        filters = {"FLTD": GainChange(20.0, 30.0, 30.0)}
        tuning = AxisTuning(verdict="change", reasons=(), attitude_error=0.9, filters=filters)
        return Refiltered(tuning, told[search._case.axis])

    monkeypatch.setattr(recommend_module, "_decided", alone)
    monkeypatch.setattr(recommend_module, "design_filters", lambda *_, **__: [chosen])
    monkeypatch.setattr(recommend_module._Search, "with_filters", behind)
    return recommend(tuned_flights.flown("ardupilot"), filters=True).axes


def test_filters_of_all_axes_stay_where_one_axis_loses_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _recommended(monkeypatch, SHARED, {"roll": -0.5, "pitch": -0.5, "yaw": 0.1})
    for one in found.values():
        assert not one.filters
        assert "QL674" in [reason.code for reason in one.reasons]


def test_filters_of_all_axes_change_where_one_gains_and_none_loses(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _recommended(monkeypatch, SHARED, {"roll": -0.5, "pitch": 0.0, "yaw": 0.0})
    assert all(one.filters for one in found.values())


def test_filters_of_one_axis_change_whatever_another_loses(monkeypatch: pytest.MonkeyPatch) -> None:
    found = _recommended(monkeypatch, OWN, {"roll": -0.5, "pitch": -0.05, "yaw": 0.1})
    assert [axis for axis, one in found.items() if one.filters] == ["roll"]
