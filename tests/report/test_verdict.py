"""The verdict over all axes, in one sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest

from quadid_logs.data.result import Result
from quadid_logs.report.verdict import headline
from quadid_logs.vocabulary import AXES


@pytest.mark.parametrize(
    ("verdicts", "told"),
    [
        ("refused refused caution", "Yaw can be used with caution; roll and pitch must not be trusted."),
        ("usable caution refused", "Roll can be used, pitch with caution; yaw must not be trusted."),
        ("usable usable refused", "Roll and pitch can be used; yaw must not be trusted."),
        ("refused refused refused", "This log gives no model that can be trusted."),
    ],
)
def test_an_axis_with_a_caveat_is_not_told_to_be_usable_without(
    verdicts: str, told: str, usable: Result
) -> None:
    """ "Yaw can be used" was the headline of a yaw that was logged too slowly to be confirmed."""
    axes = {
        axis: replace(usable.diagnosis.axes[axis], verdict=verdict)
        for axis, verdict in zip(AXES, verdicts.split(), strict=True)
    }
    assert headline(replace(usable, diagnosis=replace(usable.diagnosis, axes=axes))) == told
