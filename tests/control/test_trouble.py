"""Vehicles whose first log gives no model are flown again, after a step by rule, with better true loops."""

from __future__ import annotations

from typing import Any

import pytest

from quadid_logs.data.result import Result
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from study import filters as study

pytestmark = pytest.mark.thorough


def _changed(name: str) -> tuple[Result, list[str], dict[str, Any]]:
    """Return what the first flight shows, the codes that decide, and the true loops after the change."""
    scenario, begin = study.vehicle_in_trouble(name)
    result = study._analyzed(study._setup(scenario, begin, 7), scenario)
    tuning = recommend(result, filters=True)
    decisive = [tuning.axes[axis].reasons[0].code for axis in AXES]
    values = {parameter: one.next for parameter, one in tuning.changes.items()}
    return result, decisive, study.judged(study._setup(scenario, study.loaded(begin, values), 0))


def test_vibration_that_fills_the_command_is_filtered_by_rule_and_leaves_the_margins() -> None:
    _, codes, true = _changed("vibrating 500")
    assert codes == ["QL649"] * 3
    for one in true.values():
        assert one["noise"] < 0.05
        assert one["spare"] > 1.0


def test_a_limit_cycle_beside_manoeuvres_as_strong_is_stable_with_half_of_the_gains() -> None:
    result, codes, true = _changed("limit cycle of a 450")
    assert result.health is not None
    assert result.health.oscillation is not None
    assert [one.axis for one in result.health.oscillation.axes] == ["roll"]
    assert codes[0] == "QL648"
    assert true["roll"]["spare"] > 0.0
