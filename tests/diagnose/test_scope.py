"""What a finding judges stands in its entry of the catalogue."""

from __future__ import annotations

import pytest

from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.diagnose import with_findings
from quadid_logs.diagnose.findings import finding


def roll_with(code: str) -> str:
    """Return the verdict of roll after a warning, on a flight without any other."""
    warning = finding(code, "warning", {}, axes=("roll",))
    return with_findings(Diagnosis(findings=(), axes={}), [warning], "other").axes["roll"].verdict


@pytest.mark.parametrize("code", ["QL601", "QL603", "QL604", "QL607"])
def test_a_warning_about_the_loop_leaves_the_model_usable(code: str) -> None:
    """Thin margins say nothing against the numbers of the vehicle."""
    assert roll_with(code) == "usable"


def test_the_sentence_of_an_axis_is_about_this_axis_before_the_whole_file() -> None:
    """That several logs were pooled was the first thing said of an axis that only its plan tells."""
    pooled = finding("QL107", "warning", {})
    planned = finding("QL535", "warning", {}, axes=("roll",), title="It is the plan's")
    axes = with_findings(Diagnosis(findings=(), axes={}), [pooled, planned], "other").axes
    assert axes["roll"].sentence == "It is the plan's."
    assert axes["pitch"].sentence == f"{pooled.title}."
    assert axes["roll"].reasons == ("QL107", "QL535")


@pytest.mark.parametrize("code", ["QL501", "QL602", "QL403"])
def test_a_warning_about_the_model_is_a_caution(code: str) -> None:
    """QL602 too: the effectiveness itself is in doubt where two methods disagree about it."""
    assert roll_with(code) == "caution"
