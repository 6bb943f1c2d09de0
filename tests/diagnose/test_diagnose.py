"""Verdicts: what may be trusted, what may not, and what to do about it."""

from __future__ import annotations

import dataclasses
import functools
import math
import re

import numpy as np
import pytest

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.diagnosis import Diagnosis, Finding
from quadid_logs.data.flight import FlightData, SourceChoice
from quadid_logs.data.log import FlightLog, LoggedSystem, LostBytes
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import AlignSettings, Settings
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.vocabulary import AXES, ON_AXIS, explained_words
from tests.align.flights import align, flight_log, flown, motion, signal
from tests.identify.vehicles import QUAD, fly, multisine

ROLL_ONLY = (0,)
MINUTE = np.arange(0.0, 60.0, 0.0025)


def judge(data: FlightData, log: FlightLog | None = None) -> Diagnosis:
    settings = Settings()
    return diagnose(log or flight_log(), data, identify(data, settings.identify))


@functools.cache
def identified() -> Identification:
    """Return what 15 s of the flight hold, at 400 Hz: what its file is like changes nothing of it."""
    return identify(align(flown(MINUTE[:6000]), AlignSettings()), Settings().identify)


def findings_of_file(**about_the_file: object) -> list[Finding]:
    """Return the findings about that flight in another file."""
    log = flown(MINUTE, **about_the_file)
    return list(diagnose(log, align(log, AlignSettings()), identified()).findings)


def logged_at(rate_hz: float) -> dict[str, SourceChoice]:
    """Return sources of that rate."""
    return {
        name: SourceChoice(
            signal=name, source="RATE", reason="", n_samples=100, rate_hz=rate_hz,
            mean_rate_hz=rate_hz, longest_gap_s=1.0 / rate_hz,
        )
        for name in ("torque_n_m", "body_rate")
    }  # fmt: skip


def codes(diagnosis: Diagnosis) -> set[str]:
    return {finding.code for finding in diagnosis.findings}


@pytest.fixture(scope="module")
def good() -> FlightData:
    return dataclasses.replace(fly(QUAD, multisine(30.0), feedback=8.0), sources=logged_at(400.0))


@pytest.fixture(scope="module")
def judged(good: FlightData) -> Diagnosis:
    return judge(good)


def test_a_good_flight_is_usable_on_all_axes(judged: Diagnosis) -> None:
    """And the exit code is 0."""
    assert {axis: verdict.verdict for axis, verdict in judged.axes.items()} == {
        "roll": "usable", "pitch": "usable", "yaw": "usable",
    }  # fmt: skip
    assert judged.usable


def test_axes_that_were_not_excited_are_refused_by_name() -> None:
    """Roll alone was excited."""
    data = dataclasses.replace(
        fly(QUAD, multisine(30.0, axes=ROLL_ONLY), feedback=8.0), sources=logged_at(400.0)
    )
    axes = judge(data).axes
    assert axes["roll"].verdict == "usable"
    assert axes["pitch"].reasons == ("QL403",)
    assert axes["yaw"].reasons == ("QL403",)


@pytest.mark.thorough
def test_motion_that_the_torque_does_not_explain_is_refused() -> None:
    """Wind shakes the vehicle by tens of degrees per second."""
    rng = np.random.default_rng(1)
    data = fly(QUAD, multisine(30.0, size=0.01))
    segment = data.segments[0]
    gusts = np.cumsum(rng.standard_normal((segment.n_samples, 3)), axis=0) * 0.03
    shaken = dataclasses.replace(segment, body_rate_rad_s=segment.body_rate_rad_s + gusts)
    diagnosis = judge(dataclasses.replace(data, segments=(shaken,), sources=logged_at(400.0)))
    assert not diagnosis.usable
    assert codes(diagnosis) & {"QL504", "QL505", "QL506"}


def test_ten_hertz_logging_is_refused_with_the_parameter_to_set() -> None:
    """LOG_BITMASK with the bit added to what the log says it was."""
    log = flown(np.arange(0.0, 60.0, 0.1), parameters={"LOG_BITMASK": 176126.0})
    settings = Settings()
    data = align(log, settings.align)
    diagnosis = diagnose(log, data, identify(data, settings.identify))
    finding = next(each for each in diagnosis.findings if each.code == "QL303")
    assert "LOG_BITMASK to 176127" in finding.advice
    assert not diagnosis.usable


def test_a_few_rows_without_a_flight_are_not_said_to_be_logged_at_no_rate() -> None:
    """That there was no flight is the reason; another way of logging would not help."""
    log = flown(np.array([33.0, 33.032]))
    data = align(log, AlignSettings())
    found = {each.code for each in diagnose(log, data, Identification()).findings}
    assert "QL401" in found
    assert "QL303" not in found


@pytest.mark.parametrize(
    ("r2", "words"),
    [
        (-4.9, "nothing"),
        (0.0, "nothing"),
        (math.nan, "nothing"),
        (0.003, "less than 1 %"),
        (0.6, "only 60 %"),
    ],
)
def test_a_model_that_does_worse_than_the_mean_explains_nothing(r2: float, words: str) -> None:
    """A coefficient of determination below zero is no 0 %."""
    assert explained_words(r2) == words


def test_px4_is_told_its_own_parameter() -> None:
    """SDLOG_PROFILE, not LOG_BITMASK."""
    log = flown(np.arange(0.0, 60.0, 0.1), autopilot="px4", format="ulog")
    data = align(log, AlignSettings())
    (finding, *_) = diagnose(log, data, Identification()).findings
    assert "SDLOG_PROFILE to 25" in finding.advice
    assert "LOG_BITMASK" not in finding.advice


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"vehicle_type": "rover"}, "QL201"),
        ({"vehicle_type": "unknown"}, "QL202"),
        ({"has_time": False}, "QL104"),
        ({"n_dropped": 12}, "QL102"),
        ({"lost": (LostBytes(offset=100, n_bytes=50, reason="no header"),)}, "QL101"),
    ],
)
def test_each_caveat_about_the_file_has_its_finding(changes: dict[str, object], code: str) -> None:
    """One cause, one code."""
    assert code in {finding.code for finding in findings_of_file(**changes)}


@pytest.mark.parametrize(
    ("offset", "n_bytes", "more", "only_the_end"),
    [(9980, 20, 0, True), (9480, 520, 0, False), (9000, 20, 0, False), (9980, 20, 1, False)],
    ids=["cut off", "a block at the end", "in the middle", "elsewhere too"],
)
def test_a_last_message_that_is_cut_off_asks_for_nothing(
    offset: int, n_bytes: int, more: int, only_the_end: bool
) -> None:
    """Nearly every log ends so; a copy would end there too."""
    blocks = (
        *(LostBytes(offset=100, n_bytes=50, reason="no header"),) * more,
        LostBytes(offset=offset, n_bytes=n_bytes, reason="cut off"),
    )
    found = findings_of_file(lost=blocks, n_bytes=10_000)
    finding = next(each for each in found if each.code == "QL101")
    assert ("Nothing to do" in finding.advice) is only_the_end


@pytest.mark.parametrize(("autopilot", "choice"), [("invalid", False), ("ardupilot", True)])
def test_a_ground_station_in_the_file_is_no_other_vehicle_to_choose(autopilot: str, choice: bool) -> None:
    """It flies nothing."""
    systems = tuple(
        LoggedSystem(
            system_id=n, component_id=1, autopilot=one, vehicle_type="gcs", n_messages=10, chosen=n == 1
        )
        for n, one in ((1, "ardupilot"), (255, autopilot))
    )
    finding = next(each for each in findings_of_file(systems=systems) if each.code == "QL105")
    assert ("--system" in finding.advice) is choice


def test_motor_outputs_without_torque_are_not_called_nothing() -> None:
    """A log that holds them at 5 Hz says more than that it holds no torque."""
    time_s = np.arange(0.0, 60.0, 0.2)
    outputs = signal("output_pwm", time_s, np.full((time_s.size, 4), 1500.0))
    rates = signal("body_rate", np.arange(0.0, 60.0, 0.01), motion(np.arange(0.0, 60.0, 0.01)))
    said = {}
    for name, signals in (("outputs", (rates, outputs)), ("none", (rates,))):
        log = flight_log(*signals, autopilot="other", format="tlog")
        findings = judge(align(log, AlignSettings()), log).findings
        said[name] = next(each.title for each in findings if each.code == "QL302")
    assert "motor outputs logged at 5 Hz" in said["outputs"]
    assert said["none"] == CATALOGUE["QL302"].title


def test_several_systems_in_one_file_are_named() -> None:
    """With which one was chosen."""
    systems = tuple(
        LoggedSystem(
            system_id=n, component_id=1, autopilot="ardupilot", vehicle_type="multirotor", n_messages=10 * n,
            chosen=n == 2,
        )
        for n in (1, 2)
    )  # fmt: skip
    finding = next(each for each in findings_of_file(systems=systems) if each.code == "QL105")
    assert "system 2 component 1: multirotor (ardupilot), 20 messages, chosen" in str(finding.evidence)


def test_a_log_without_torque_or_rates_says_which_is_missing() -> None:
    """Two findings, two codes."""
    log = flight_log(signal("throttle", MINUTE, np.full((len(MINUTE), 1), 0.4)))
    diagnosis = judge(align(log, AlignSettings()), log)
    assert {"QL301", "QL302"} <= codes(diagnosis)


def test_a_log_that_covers_no_time_is_not_said_to_be_logged_wrongly() -> None:
    """Its pilot was told to update the firmware and to log rates."""
    log = flight_log()
    diagnosis = judge(align(log, AlignSettings()), log)
    assert "QL401" in codes(diagnosis)
    assert not {"QL301", "QL302"} & codes(diagnosis)


def test_a_vehicle_that_stayed_on_the_ground_is_refused() -> None:
    """The evidence is quoted in the title."""
    log = flown(MINUTE)
    idle = dataclasses.replace(log.candidates("throttle")[0], values=np.zeros((24_000, 1)))
    grounded = dataclasses.replace(log, signals={**log.signals, "throttle": (idle,)})
    finding = next(f for f in judge(align(grounded, AlignSettings()), grounded).findings if f.code == "QL401")
    assert "the throttle never left idle" in finding.title


def test_effectiveness_of_the_wrong_sign_is_refused(good: FlightData) -> None:
    """Torque logged with its sign turned."""
    segment = good.segments[0]
    turned = dataclasses.replace(segment, torque=-segment.torque)
    diagnosis = judge(dataclasses.replace(good, segments=(turned,)))
    assert diagnosis.axes["roll"].reasons == ("QL506",)


def test_the_most_severe_finding_comes_first(good: FlightData) -> None:
    """Errors, then warnings, then information."""
    log = flown(np.arange(0.0, 60.0, 0.1), n_dropped=3)
    levels = [finding.level for finding in judge(align(log, AlignSettings()), log).findings]
    assert levels == sorted(levels, key=["error", "warning", "info"].index)


def test_every_catalogue_entry_says_what_it_means_and_what_to_do() -> None:
    """Full sentences, under a code of the scheme."""
    for code, entry in CATALOGUE.items():
        assert re.fullmatch(r"QL[1-6]\d\d", code)
        assert code == entry.code
        assert entry.meaning.endswith(".")
        assert entry.advice.endswith(".")


@pytest.mark.thorough
def test_a_vehicle_that_changes_in_mid_flight_is_reported() -> None:
    """A payload drop lowers the inertia by a quarter after the first half."""
    heavy = fly(QUAD, multisine(25.0), feedback=8.0).segments[0]
    light = fly(dataclasses.replace(QUAD, inertia=0.75 * QUAD.inertia), multisine(25.0), feedback=8.0)
    later = dataclasses.replace(light.segments[0], time_s=light.segments[0].time_s + 30.0, flight=1)
    both = dataclasses.replace(light, segments=(heavy, later), sources=logged_at(400.0))
    diagnosis = judge(both)
    assert "QL509" in codes(diagnosis)
    # To fly doublets on this axis, as was advised, would tell nothing.
    assert {each.advice for each in diagnosis.findings if each.code == "QL509"} == {CATALOGUE["QL509"].advice}


def test_a_vehicle_that_stays_the_same_is_not_reported(judged: Diagnosis) -> None:
    """No false alarm on the two halves of one flight."""
    assert "QL509" not in codes(judged)


def test_the_sentence_of_an_axis_does_not_say_the_verdict_again(judged: Diagnosis) -> None:
    """It stands beside the verdict everywhere: "roll usable Roll is usable"."""
    for axis in judged.axes.values():
        assert axis.verdict == "usable"
        assert axis.sentence == "The model predicts validation data."


@pytest.mark.thorough
def test_two_packs_eight_per_cent_apart_are_told_and_the_interval_holds_both() -> None:
    """Half of the flight each: the mean of both is neither."""
    fresh = fly(QUAD, multisine(25.0), feedback=8.0).segments[0]
    used = fly(dataclasses.replace(QUAD, inertia=QUAD.inertia / 0.92), multisine(25.0), feedback=8.0)
    later = dataclasses.replace(used.segments[0], time_s=used.segments[0].time_s + 25.0)
    both = dataclasses.replace(used, segments=(fresh, later), sources=logged_at(400.0))
    found = identify(both, Settings().identify)
    assert {one.code for one in diagnose(flight_log(), both, found).findings} >= {"QL509"}
    assert found.recommended is not None
    for number, axis in enumerate(AXES):
        low, high = found.recommended.entries[ON_AXIS[axis]].ci95
        true = np.linalg.inv(QUAD.inertia)[number, number] * np.array([0.92, 1.0])
        assert low < 1.01 * true[0]
        assert 0.99 * true[1] < high
