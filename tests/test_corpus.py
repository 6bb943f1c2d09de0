"""The whole chain on flown and firmware-in-the-loop logs whose truth is known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from quadid_logs.data.result import Result
from quadid_logs.errors import LogError
from quadid_logs.load import read_log
from tests.analyses import Analyzed
from tests.marks import thorough, thorough_but

ARDUPILOT_TRUTH = ("at_segment_mean", "B_rad_s2_per_unit")


def codes(result: Result) -> set[str]:
    """Return the codes of all findings."""
    return {finding.code for finding in result.diagnosis.findings}


def true_gain(log: Path) -> tuple[float, float, float]:
    """Return the diagonal of B from the truth file beside a firmware log."""
    truth = json.loads(log.with_suffix(".truth.json").read_text())
    rows = (
        truth["B_rad_s2_per_torque_setpoint"]
        if "B_rad_s2_per_torque_setpoint" in truth
        else (truth["at_segment_mean"]["B_rad_s2_per_unit"])
    )
    return rows[0][0], rows[1][1], rows[2][2]


@pytest.mark.parametrize(
    "name",
    [
        thorough("ac47_quadx_multisine.BIN"),
        thorough("ac47_quadx_doublets.BIN"),
        thorough("ac47_quadx_esc_rpm.BIN"),
        thorough("ac47_two_flights.BIN"),
        thorough("ac47_rate_thread.BIN"),
        "px4_quad_multisine.ulg",
    ],
)
def test_roll_and_pitch_gains_of_firmware_logs_are_within_six_per_cent(
    corpus: Path, analyzed: Analyzed, name: str
) -> None:
    """The truth is the simulator's inertia and geometry."""
    log = corpus / "firmware" / name
    result = analyzed(log)
    model = result.identification.recommended
    assert model is not None
    expected = true_gain(log)
    assert result.diagnosis.usable
    for axis in (0, 1):
        assert model.B[axis, axis] == pytest.approx(expected[axis], rel=0.06)
    assert model.validation.held_out_s > 5.0


@pytest.mark.thorough
def test_a_system_id_run_on_roll_identifies_roll_and_refuses_the_rest(
    corpus: Path, analyzed: Analyzed
) -> None:
    """Pitch and yaw hover beside it."""
    result = analyzed(corpus / "firmware" / "ac47_quadx_sid_roll.BIN")
    model = result.identification.recommended
    assert model is not None
    assert model.B[0, 0] == pytest.approx(436.8, rel=0.015)
    verdicts = {axis: verdict.verdict for axis, verdict in result.diagnosis.axes.items()}
    assert verdicts == {"roll": "usable", "pitch": "refused", "yaw": "refused"}


@pytest.mark.thorough
def test_default_logging_of_ardupilot_gives_yaw_at_most_and_names_the_bitmask_to_set(
    corpus: Path, analyzed: Analyzed
) -> None:
    """10 Hz: too slow for roll and pitch."""
    result = analyzed(corpus / "firmware" / "ac47_quadx_default_logging.BIN")
    assert not result.diagnosis.usable
    assert any("LOG_BITMASK" in finding.advice for finding in result.diagnosis.findings)
    assert result.identification.only_yaw


@pytest.mark.thorough
def test_two_flights_in_one_file_are_two_segments(corpus: Path, analyzed: Analyzed) -> None:
    """Near the two manoeuvres that the truth names."""
    result = analyzed(corpus / "firmware" / "ac47_two_flights.BIN")
    (first, second) = result.data.flight_segments
    assert first[0] < 60.6
    assert first[1] > 95.5
    assert second[0] < 159.6
    assert second[1] > 194.5


#: What each flown log must be told about itself.
REASONS = {
    "ac34rc2-erlebrain3-quadx-265s.bin": {"QL303"},
    "ac413-quadx-goodprop-hover1.bin": {"QL303"},
    "ac413-quadx-25mmcut-hover1.bin": {"QL303"},
    "ac457-quadx-noATT-noRATE-50s.bin": {"QL303"},
    "ac364-quadx-RATE1Hz-700s.bin": {"QL303"},
    "ac313-y6b-331s.bin": {"QL302"},
    "ac41-quadplus-mission-113s.bin": {"QL303"},
    "plane423-fastlog-real.bin": {"QL201"},
    "rover246-real-61.bin": {"QL201"},
    "ac30-quadV-underpowered.log": {"QL104"},
    "ac301-octo-apm2-MOT.log": {"QL104"},
    "ac311-quadx-nan.log": {"QL302"},
    "ac32dev-quad-handrotated-52s.tlog": {"QL302"},
    "px4-1.16-quad-v6c-indoor-85s.ulg": {"QL403"},
    "px4-1.14-octocoax-cubeorange-75s.ulg": {"QL403"},
    "px4-1.9-quad-escstatus-39s.ulg": {"QL303"},
    "px4-1.12-f450-tumble-3s.ulg": {"QL302"},
    "px4-1.6-sample-auavx21-handheld-69s.ulg": {"QL401"},
    "px4-1.11-vtol-babyshark-sysid-branch-1174s.ulg": {"QL201"},
    "sdlog2-quad-70s.px4log": {"QL504"},
}


#: One for each reason, the one that is analyzed soonest; for QL504 none is.
OF_EACH_REASON = (
    "px4-1.9-quad-escstatus-39s.ulg",
    "ac364-quadx-RATE1Hz-700s.bin",
    "ac311-quadx-nan.log",
    "ac32dev-quad-handrotated-52s.tlog",
    "rover246-real-61.bin",
    "ac30-quadV-underpowered.log",
    "px4-1.6-sample-auavx21-handheld-69s.ulg",
)


@pytest.mark.parametrize("name", thorough_but(OF_EACH_REASON, sorted(REASONS)))
def test_each_flown_log_is_refused_for_its_own_reason(corpus: Path, analyzed: Analyzed, name: str) -> None:
    """None of them was flown or logged for this purpose."""
    result = analyzed(corpus / "real" / name)
    assert not result.diagnosis.usable
    assert REASONS[name] <= codes(result)


@pytest.mark.thorough
def test_repeated_stamps_leave_a_caution_on_every_axis(corpus: Path, analyzed: Analyzed) -> None:
    """50 Hz with a hole of 37 s; a sixth of the stamps is said twice, and the report says that."""
    result = analyzed(corpus / "real" / "ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin")
    assert {axis.verdict for axis in result.diagnosis.axes.values()} == {"caution"}
    assert "QL304" in codes(result)


def test_a_gentle_flight_with_moments_in_n_m_is_refused(corpus: Path, analyzed: Analyzed) -> None:
    """Plain least squares there gives inertias that slide by a factor of two with band and lag."""
    result = analyzed(corpus / "real" / "x8coax_moments_hover.csv")
    assert not result.diagnosis.usable


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("git-lfs-pointer.bin", "git lfs pull"),
        ("eeprom.bin", "eeprom"),
        ("not-a-flightlog-aeroprobe.log", "column time_s"),
        ("only-header-600B.bin", "not one row of data"),
    ],
)
def test_a_file_that_is_no_log_is_refused_with_a_hint(
    corpus: Path, analyzed: Analyzed, name: str, hint: str
) -> None:
    """One clear error, which the command line turns into exit code 2."""
    with pytest.raises(LogError, match=hint) as caught:
        analyzed(corpus / "damaged" / name)
    assert caught.value.hint


@pytest.mark.parametrize(
    "name",
    [
        "corrupt-format-not-utf8.ulg",
        "corrupt-wrong-size.ulg",
        "garbage-tail-ac47-sitl.bin",
        thorough("px4-1.17-x500-v6xrt-outdoor-89s-corrupt.ulg"),
        "sitl-flightlogs-bad-packets-4MB.tlog",
        "truncated-80k-ac462-real.bin",
        "one-packet-70B.tlog",
    ],
)
def test_a_damaged_log_is_judged_and_says_what_was_lost(corpus: Path, analyzed: Analyzed, name: str) -> None:
    """QL101 counts each byte once that no message could be read from."""
    path = corpus / "damaged" / name
    diagnosis = analyzed(path).diagnosis
    assert set(diagnosis.axes) == {"roll", "pitch", "yaw"}
    lost = sorted((part.offset, part.offset + part.n_bytes) for part in read_log(path).lost)
    edges = [edge for span in lost for edge in span]
    assert edges == sorted(edges)
    assert 0 <= edges[0] < edges[-1] <= path.stat().st_size
    (finding,) = (each for each in diagnosis.findings if each.code == "QL101")
    assert finding.evidence["corrupt_bytes"] == sum(end - begin for begin, end in lost) > 0


def test_a_log_to_which_others_were_appended_has_lost_nothing(corpus: Path, analyzed: Analyzed) -> None:
    """ULog's appended data is announced in the header: it is no damage."""
    path = corpus / "damaged" / "appended-multiple.ulg"
    assert "QL101" not in codes(analyzed(path))
    assert read_log(path).lost == ()


@pytest.mark.parametrize(
    ("name", "n_bytes"), [("truncated-80k-ac462-real.bin", 2), ("one-packet-70B.tlog", 14)]
)
def test_what_a_cut_leaves_of_the_last_message_is_lost(corpus: Path, name: str, n_bytes: int) -> None:
    """From the start of a message that the file's end cuts off, and nothing before it."""
    path = corpus / "damaged" / name
    (part,) = read_log(path).lost
    assert (part.offset, part.n_bytes) == (path.stat().st_size - n_bytes, n_bytes)
