"""The benchmark that others can enter: the format's reader, what is counted, the formulas, the command."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from benchmarks.methods import __main__ as command
from benchmarks.methods import data_sets, entrants, export, measure, page, regressions, score
from benchmarks.methods.entry import Entry, EntryError, Estimate, Outcome, read_entry, write_entry
from benchmarks.methods.score import Facts, accuracy, errors, repeated
from quadid_logs.data.flight import FlightData, Segment
from tests.conftest import REPOSITORY

RMS = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


def outcome(*values: Estimate | None, **changes) -> Outcome:
    """Return what a method gave for roll, pitch and yaw on a data set of 100 rows."""
    axes = dict(zip(("roll", "pitch", "yaw"), values, strict=True))
    return Outcome(**{"n_samples": 100, "rms": RMS, "seconds": 0.5, "axes": axes} | changes)


def entry(method: str = "a method", **results: Outcome) -> Entry:
    """Return an entry of these results."""
    return Entry(
        method=method, version="1", description="d", tuned_on="none", machine="a machine", results=results
    )


def facts(**changes) -> Facts:
    """Return a simulated data set whose truth is 100, 200 and 10."""
    known = {"roll": 100.0, "pitch": 200.0, "yaw": 10.0}
    return Facts(**{"kind": "simulated", "n_samples": 100, "rms": RMS, "truth": known} | changes)


def content(**changes) -> dict:
    """Return a small sound file's content."""
    result = {
        "data_set": "one",
        "n_samples": 100,
        "rms": list(RMS),
        "seconds": None,
        "axes": {
            "roll": {"value": 5.0, "ci95": [4.0, 6.0]},
            "pitch": {"value": 7.0, "ci95": None},
            "yaw": None,
        },
    }
    words = {"method": "m", "version": "1", "description": "", "tuned_on": "none", "machine": "a machine"}
    return {"format": "quadid-logs-benchmark-entry/1", **words, "results": [result]} | changes


def read(tmp_path: Path, text: str | bytes) -> Entry:
    """Read a file with this text."""
    path = tmp_path / "entry.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_entry(path)


def test_a_sound_file_is_read(tmp_path: Path) -> None:
    """Value, interval, a value without one, and no number at all."""
    found = read(tmp_path, json.dumps(content())).results["one"]
    assert found.axes == {"roll": Estimate(5.0, (4.0, 6.0)), "pitch": Estimate(7.0), "yaw": None}
    assert found.seconds is None


FINITE = st.floats(-1e9, 1e9)


@given(value=FINITE, below=st.floats(0, 1e9), above=st.floats(0, 1e9), seconds=st.none() | st.floats(0, 1e6))
def test_what_is_written_is_read_back(tmp_path_factory, value, below, above, seconds) -> None:
    """The command counts its own methods by what it reads back."""
    given_entry = entry(
        one=outcome(Estimate(value, (value - below, value + above)), Estimate(value), None, seconds=seconds)
    )
    path = tmp_path_factory.mktemp("entry") / "entry.json"
    write_entry(given_entry, path)
    assert read_entry(path) == given_entry


@given(st.binary(max_size=200))
def test_any_bytes_are_an_entry_or_refused(tmp_path_factory, raw: bytes) -> None:
    """Files come from anybody."""
    with pytest.raises(EntryError):
        read(tmp_path_factory.mktemp("entry"), raw)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
)


@pytest.mark.thorough
@given(place=st.sampled_from([*content(), *content()["results"][0], "roll", "value", "ci95"]), value=JSON)
def test_any_value_at_any_place_is_read_or_refused(tmp_path_factory, place: str, value: object) -> None:
    """Nothing but the reader's own error is ever raised."""
    changed = content()
    result = changed["results"][0]
    holders = (changed, result, result["axes"], result["axes"]["roll"])
    for holder in holders:
        if place in holder:
            holder[place] = value
    with suppress(EntryError):
        read(tmp_path_factory.mktemp("entry"), json.dumps(changed))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (json.dumps(content()).replace("5.0", "NaN"), "NaN is no number"),
        (json.dumps(content()).replace("5.0", "1e999"), "too large"),
        (json.dumps(content()).replace("[4.0, 6.0]", "[5.5, 6.0]"), "does not hold the value"),
        (json.dumps(content(results=content()["results"] * 2)), "there twice"),
        (json.dumps(content(format="another/1")), "quadid-logs-benchmark-entry/1"),
        (json.dumps(content(url="javascript:alert(1)")), "url"),
        (json.dumps({key: value for key, value in content().items() if key != "tuned_on"}), "tuned_on"),
        ("[" * 100_000, "no entry"),
        (" " * 4_000_001, "larger"),
        ("1" * 10_000, "no entry"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, why: str) -> None:
    """The sentence is what the sender reads."""
    with pytest.raises(EntryError) as refused:
        read(tmp_path, text)
    assert why in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """Also a folder of that name."""
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(EntryError):
            read_entry(path)


def test_the_example_of_the_page_is_an_entry(tmp_path: Path) -> None:
    """It is what people copy."""
    text = (REPOSITORY / "docs" / "benchmark.md").read_text(encoding="utf-8")
    example = text.split("```json\n")[1].split("```")[0]
    assert read(tmp_path, example).results


def test_an_error_is_over_the_truth() -> None:
    """10 % high of 100, 5 % low of 200, no number for yaw; the interval alike."""
    found = errors(
        entry(one=outcome(Estimate(110.0, (90.0, 130.0)), Estimate(190.0), None)),
        {"one": facts()},
        ["simulated"],
    )
    assert found[0].error == pytest.approx(0.1)
    assert found[0].interval == pytest.approx((-0.1, 0.3))
    assert found[1].error == pytest.approx(-0.05)
    assert math.isnan(found[2].error)


def test_an_axis_without_a_number_counts_as_infinitely_wrong() -> None:
    """Otherwise the method that answers the easiest axis only would win."""
    found = accuracy(errors(entry(one=outcome(Estimate(101.0), None, None)), {"one": facts()}, ["simulated"]))
    assert (found.n, found.answered) == (3, 1)
    assert math.isinf(found.median)


def test_the_median_and_nine_in_ten_are_those_of_the_errors() -> None:
    """Of 1 to 20 %: 11 and 19 %, the upper one where two are in the middle."""
    found = accuracy([score.Error("", "", (-1) ** k * k / 100.0, None) for k in range(1, 21)])
    assert found.median == pytest.approx(0.11)
    assert found.most == pytest.approx(0.19)


def test_intervals_are_counted_by_whether_they_hold_the_truth() -> None:
    """One that does, one above, one below, each about its own estimate; without one nothing is counted."""
    given_intervals = [(0.05, (-0.1, 0.2)), (0.1, (0.05, 0.2)), (-0.2, (-0.3, -0.1)), (0.0, None)]
    found = accuracy([score.Error("", "", error, interval) for error, interval in given_intervals])
    assert (found.n_intervals, found.held) == (3, 1)
    assert found.half_width == pytest.approx(0.1)


def test_the_interval_score_is_the_width_and_forty_times_the_miss() -> None:
    """Gneiting and Raftery's eq. 43 at 5 %: 0.3, 0.15 + 40 * 0.05, 0.2 + 40 * 0.1."""
    for interval, expected in (((-0.1, 0.2), 0.3), ((0.05, 0.2), 2.15), ((-0.3, -0.1), 4.2)):
        found = accuracy([score.Error("", "", 0.0, interval)])
        assert found.interval_score == pytest.approx(expected)


@pytest.mark.parametrize("changes", [{"n_samples": 101}, {"rms": (1.02, *RMS[1:])}])
def test_results_from_other_data_do_not_count(changes: dict) -> None:
    """Another seed, or a simulator that has changed since."""
    old = entry(one=outcome(Estimate(100.0), Estimate(200.0), Estimate(10.0), **changes))
    assert accuracy(errors(old, {"one": facts()}, ["simulated"])).answered == 0


def test_the_last_digits_of_another_machine_are_the_same_data() -> None:
    """A thousandth in the root mean square."""
    assert score.is_same_data(outcome(None, None, None, rms=tuple(1.001 * each for each in RMS)), facts())


def flown(*values: float, half: float | None = None) -> tuple[Entry, dict[str, Facts]]:
    """Return flights of one vehicle whose roll has these values and whose pitch has none."""
    names = [f"flight{number}" for number in range(len(values))]
    results = {
        name: outcome(Estimate(value, half and (value - half, value + half)), None, None)
        for name, value in zip(names, values, strict=True)
    }
    return entry(**results), {name: facts(kind="flown", truth=None, vehicle="v") for name in names}


def test_the_spread_of_flights_is_over_their_median() -> None:
    """Median 100, median absolute deviation 10, which is 14.8 of a normal distribution; one is far off."""
    found = repeated(*flown(90.0, 100.0, 110.0, 95.0, 900.0), "v")
    assert found.spread == pytest.approx(0.1483, abs=1e-4)
    assert (found.n, found.answered, found.n_pairs) == (10, 5, 0)


def test_two_flights_have_no_spread() -> None:
    """Their median lies between them whatever they are."""
    assert math.isnan(repeated(*flown(90.0, 100.0), "v").spread)


def test_pairs_agree_if_their_difference_is_within_both_intervals() -> None:
    """Half widths of 10 allow 14.1: 0 and 14 agree, 0 and 15 do not, 14 and 15 do."""
    found = repeated(*flown(100.0, 114.0, 115.0, half=10.0), "v")
    assert (found.n_pairs, found.agree) == (3, 2)


def rotation(lag_s: float, delay_s: float = 0.0) -> FlightData:
    """Return a minute of rotation without noise: gains 100, 80, 20, damping 1 / s, lag and delay."""
    period_s, gains = 0.005, (100.0, 80.0, 20.0)
    time_s = period_s * np.arange(12_000)
    rates, torques = [], []
    for axis, gain in enumerate(gains):
        w = 2.0 * np.pi * (np.linspace(0.2, 4.0, 12) + 0.02 * axis)
        phase = np.random.default_rng(axis).uniform(0.0, 2.0 * np.pi, 12)
        wave = 0.02 * np.exp(1j * (np.outer(time_s, w) + phase))
        # Each sinusoid's steady response, exactly.
        response = gain * np.exp(-1j * w * delay_s) / ((1j * w + 1.0) * (1j * w * lag_s + 1.0))
        torques.append(wave.real.sum(axis=1))
        rates.append((wave * response).real.sum(axis=1))
    segment = Segment(
        time_s=time_s,
        body_rate_rad_s=np.array(rates).T,
        torque=np.array(torques).T,
        attitude_rad=None,
        throttle=None,
        saturated=np.zeros(time_s.size, dtype=bool),
    )
    return FlightData(
        sample_period_s=period_s,
        segments=(segment,),
        flights=((0.0, 60.0),),
        sources={},
        input=None,
        start_s=0.0,
        duration_s=60.0,
    )


TRUTH = np.array([100.0, 80.0, 20.0])


def gains(estimates: tuple[Estimate | None, ...]) -> np.ndarray:
    """Return values over their truths."""
    return np.array([math.nan if each is None else each.value for each in estimates]) / TRUTH


def test_regression_finds_the_gain_where_motors_answer_at_once() -> None:
    """The model that it has."""
    assert gains(regressions.ordinary_least_squares(rotation(0.0))) == pytest.approx(np.ones(3), rel=0.01)


def test_regression_is_low_where_motors_lag() -> None:
    """What the table shows of it is its model's fault, not ours: 50 ms take a tenth or more."""
    assert (gains(regressions.ordinary_least_squares(rotation(0.05))) < 0.9).all()


def test_regression_with_the_best_lag_finds_the_gain() -> None:
    """Of a lag on its grid."""
    assert gains(regressions.least_squares_with_lag(rotation(0.05))) == pytest.approx(np.ones(3), rel=0.02)


def test_output_error_finds_the_gain_behind_lag_and_delay() -> None:
    """Of 40 ms and 30 ms: more than it may look ahead."""
    assert gains(regressions.output_error(rotation(0.04, 0.03))) == pytest.approx(np.ones(3), rel=0.02)


def test_the_covariance_of_coloured_residuals_is_that_of_repeated_noise() -> None:
    """Low-passed noise over 300 draws: white-noise intervals are three times too narrow, these are right."""
    generator = np.random.default_rng(1)
    x = lfilter([0.05], [1.0, -0.95], generator.standard_normal(2000))[:, np.newaxis]
    estimates, variances = [], []
    for _ in range(300):
        y = 2.0 * x[:, 0] + lfilter([0.1], [1.0, -0.9], generator.standard_normal(2000))
        fit = regressions._coloured(regressions._solve(x, y), x, y)
        estimates.append(fit.theta[0])
        variances.append(fit.covariance[0, 0])
    assert np.mean(variances) == pytest.approx(np.var(estimates), rel=0.25)


def test_a_flight_too_short_gives_no_number() -> None:
    """Shorter than the segments of the output-error method."""
    short = rotation(0.0)
    few = replace(short, segments=(short.segments[0].rows(slice(0, 300)),))
    assert regressions.output_error(few) == (None, None, None)


def test_texts_of_others_stay_text() -> None:
    """No markup, HTML or column of an entry reaches the page."""
    hostile = "<script>alert(1)</script> | ![x](y) [a](b) `c` **d**"
    mine = replace(entry("quadid-logs", one=outcome(Estimate(101.0), None, None)), description=hostile)
    other = replace(mine, method=hostile[:40], machine=hostile, tuned_on=hostile, version=hostile)
    lines = list(page.tables([mine, other], {"one": facts()}, missing=[hostile], refused=[hostile]))
    text = "\n".join(lines)
    assert "<script" not in text
    assert "](" not in text
    assert "`" not in text
    rows = [line for line in lines if line.startswith("|")]
    assert all(row.count("|") == rows[-1].count("|") for row in rows[-4:])


def test_the_page_says_what_an_entry_ran_on_and_what_was_left_out() -> None:
    """Stale, unknown and missing are said, not hidden."""
    mine = entry("quadid-logs", one=outcome(Estimate(101.0), None, None), gone=outcome(None, None, None))
    stale = entry("old", one=outcome(Estimate(101.0), None, None, n_samples=7))
    text = "\n".join(
        page.tables([mine, stale], {"one": facts()}, missing=["pysindy"], refused=["bad.json is."])
    )
    assert "1 of 1; 1 not known here" in text
    assert "0 of 1; 1 left out: made from other data" in text
    assert "Not installed, and therefore not in the tables: pysindy." in text
    assert "Left out: bad.json is." in text


def test_another_method_that_wins_is_shown_as_winning() -> None:
    """In bold and in the count."""
    mine = entry("quadid-logs", one=outcome(Estimate(110.0), Estimate(200.0), None))
    better = entry("better", one=outcome(Estimate(99.0), Estimate(190.0), Estimate(10.0)))
    text = "\n".join(page.tables([mine, better], {"one": facts()}))
    assert "| one | +10.0, **+0.0**, (none) | **-1.0**, -5.0, (+0.0) |" in text


def test_the_picture_is_drawn_without_an_interval_or_an_answer() -> None:
    """An entry may have neither."""
    assert page.picture([entry(one=outcome(None, None, None))], {"one": facts()}).startswith(b"\x89PNG")


@pytest.fixture
def one_short_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave one simulated flight, two quick methods, one of them in our place, and one that is missing."""
    monkeypatch.setattr(data_sets, "SIMULATED", (("sysid-quad-x", "ardupilot", 100.0),))
    by_name = {each.name: each for each in entrants.ENTRANTS}
    kept = (replace(by_name["output error"], name="quadid-logs"), by_name["paper"])
    absent = replace(by_name["paper"], name="not here", package="no_such_package")
    for module in (command, measure):
        monkeypatch.setattr(module, "ENTRANTS", (*kept, absent))


@pytest.mark.thorough
def test_the_command_writes_page_picture_and_entries(
    one_short_flight: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With somebody else's entry, a broken one, a method that is not installed. Over 1 s: it flies."""
    others = tmp_path / "others"
    others.mkdir()
    (others / "broken.json").write_text("{")
    write_entry(entry("someone else"), others / "someone.json")
    monkeypatch.setattr(command, "OTHERS", others)
    folders = ["--output", str(tmp_path / "page"), "--build", str(tmp_path / "build")]
    assert command.main(["--short", "--processes", "1", *folders]) == 0
    table = (tmp_path / "page" / "table.md").read_text()
    assert "| quadid-logs |" in table
    assert "| someone else |" in table
    assert "not in the tables: not here." in table
    assert "Left out: broken.json is no entry" in table
    assert (tmp_path / "page" / "errors.png").stat().st_size < 250_000
    ours = read_entry(tmp_path / "build" / "quadid-logs.json")
    assert list(ours.results) == ["sysid-quad-x, ardupilot, 100 Hz"]


def test_a_method_that_breaks_down_gives_no_number_and_the_others_go_on() -> None:
    """Whatever a package raises."""

    def breaks(_data_set: object) -> tuple[Estimate | None, ...]:
        raise RuntimeError("no")

    broken = replace(entrants.ENTRANTS[0], run=breaks)
    data_set = data_sets.DataSet(
        source=data_sets.Source(name="x", kind="flown"),
        log=None,  # type: ignore[arg-type]
        data=rotation(0.0),
        truth=None,
    )
    found, problem = measure._outcome(broken, data_set)
    assert found.axes == {"roll": None, "pitch": None, "yaw": None}
    assert "RuntimeError" in problem


@pytest.mark.thorough
def test_an_exported_data_set_holds_the_series_and_no_truth(one_short_flight: None, tmp_path: Path) -> None:
    """An entry repeats its number of samples and its root mean squares."""
    assert export.export(data_sets.sources(tmp_path, short=True), tmp_path / "out") == 1
    (series,) = (tmp_path / "out").glob("*.csv")
    told = json.loads(series.with_suffix(".json").read_text())
    table = np.loadtxt(series, delimiter=",", skiprows=1)
    assert table.shape == (told["n_samples"], len(export.COLUMNS))
    assert np.sqrt(np.mean(table[:, 2:] ** 2, axis=0)) == pytest.approx(told["rms"], rel=1e-6)
    assert "truth" not in series.with_suffix(".json").read_text()


def test_without_a_corpus_the_simulated_flights_are_left(tmp_path: Path) -> None:
    """Anybody can run the command."""
    assert {each.kind for each in data_sets.sources(tmp_path)} == {"simulated"}


def test_the_corpus_has_flights_of_every_kind(corpus: Path) -> None:
    """Truths by firmware, and flights of one vehicle."""
    found = data_sets.sources(corpus)
    assert {each.kind for each in found} == {"simulated", "firmware", "flown"}
    assert len({each.name for each in found}) == len(found)
