"""The verbs for Python take a path, a log in memory, a table or a result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import quadid_logs
from quadid_logs.data.promise import Outcome
from quadid_logs.data.result import Result
from quadid_logs.errors import EmptyLogError, LogNotFoundError, SettingsError
from quadid_logs.promise import promise_of
from quadid_logs.report.promise_file import PROMISE_FILE, promise_text
from quadid_logs.report.provenance import Provenance
from quadid_logs.tuning import tuning_of
from tests.conftest import REPOSITORY
from tests.tuned_flights import as_flown, flown, of_axes

SAMPLE = REPOSITORY / "sample_logs" / "sysid-quad-x.bin"


@pytest.fixture(scope="module")
def analysis() -> quadid_logs.Analysis:
    """A log of the repository."""
    return quadid_logs.analyze(SAMPLE)


@pytest.fixture(scope="module")
def tuned() -> Result:
    """A flight that the gains of the next one follow from."""
    return of_axes(flown("ardupilot"), "roll")


@pytest.fixture(scope="module")
def followed(tuned: Result) -> Result:
    """The same flight as if the recommended gains had flown."""
    return as_flown(tuned, **{name: one.next for name, one in tuning_of(tuned).changes.items()})


def test_a_result_is_returned_by_analyze_as_it_is(analysis: quadid_logs.Analysis) -> None:
    """Nothing is computed twice."""
    assert quadid_logs.analyze(analysis) is analysis


def test_a_plain_result_gets_the_methods_of_an_analysis(tuned: Result) -> None:
    """Of what other programs keep."""
    assert quadid_logs.analyze(tuned).model.structure == tuned.identification.recommended.structure


@pytest.mark.parametrize(
    "given",
    [
        {"settings": quadid_logs.Settings()},
        {"vehicle": quadid_logs.Vehicle(mass_kg=1.0)},
        {"structure": "damped"},
    ],
)
def test_what_cannot_change_a_result_is_refused(
    given: dict[str, object], analysis: quadid_logs.Analysis
) -> None:
    """It would silently be ignored."""
    with pytest.raises(SettingsError, match="analyzed already"):
        quadid_logs.analyze(analysis, **given)


def test_a_path_a_log_in_memory_and_a_result_compare_alike(analysis: quadid_logs.Analysis) -> None:
    """Three ways to name one flight."""
    log = quadid_logs.read_log(SAMPLE)
    for before, after in ((SAMPLE, analysis), (analysis, log)):
        found = quadid_logs.compare(before, after)
        assert found.verdict == "same"
        assert all(one.difference == 0.0 for one in found.quantities)


def test_settings_are_those_of_the_flights_that_are_no_results_yet(analysis: quadid_logs.Analysis) -> None:
    """A part of the log that holds no flight is refused, where there is a log to take it from."""
    part = quadid_logs.Settings(align=quadid_logs.AlignSettings(start_s=5000.0))
    assert quadid_logs.compare(analysis, analysis, part).verdict == "same"
    with pytest.raises(SettingsError, match="the log runs from"):
        quadid_logs.compare(analysis, SAMPLE, part)


def test_a_table_compares_with_a_table(analysis: quadid_logs.Analysis) -> None:
    """Of one flight: no quantity differs."""
    frame = analysis.to_pandas()
    assert quadid_logs.compare(frame, frame).verdict == "same"


def test_flights_repeat_by_path_and_result(analysis: quadid_logs.Analysis) -> None:
    """The second is the same flight, and says so."""
    found = quadid_logs.repeat([analysis, str(SAMPLE)])
    assert found.reasons[1]["roll"] == "it repeats the flight of log 1"


def test_an_analysis_is_tuned_once(tuned: Result) -> None:
    """With the default limits: as its pages and sentences are."""
    analysis = quadid_logs.analyze(tuned)
    assert quadid_logs.tune(analysis) is tuning_of(analysis)


def test_other_limits_are_kept(tuned: Result) -> None:
    """They are those of the promise."""
    limits = quadid_logs.Limits(12.0, 50.0, 0.5)
    # Refused at once: what is found costs nothing here.
    assert quadid_logs.tune(replace(tuned, closed_loop=None), limits).limits == limits


def test_a_promise_is_checked_from_a_file_its_folder_and_the_flight_before(
    tuned: Result, followed: Result, tmp_path: Path
) -> None:
    """One outcome, however it is given."""
    promise = promise_of(tuned, tuning_of(tuned))
    assert promise is not None
    file = tmp_path / PROMISE_FILE
    file.write_text(promise_text(promise, Provenance(version="0", command="", log_sha256="")))
    found = [quadid_logs.check(followed, each) for each in (promise, file, str(tmp_path), tuned)]
    assert {each.outcome for each in found} == {Outcome.KEPT}


def test_a_flight_that_promises_nothing_cannot_be_checked_against(analysis: quadid_logs.Analysis) -> None:
    """Its controller is not known well enough."""
    with pytest.raises(SettingsError, match="no promise to check"):
        quadid_logs.check(analysis, analysis)


def test_a_plan_like_a_flight_is_that_of_its_log(analysis: quadid_logs.Analysis) -> None:
    """By path or result: autopilot, firmware and parameters of the vehicle."""
    by_path, by_result = (quadid_logs.plan(each, ["roll"]) for each in (SAMPLE, analysis))
    assert by_path.autopilot == by_result.autopilot == "ardupilot"
    assert by_path.version == by_result.version == analysis.log.version
    assert by_path.parameters == analysis.log.parameters


def test_a_plan_for_a_log_that_is_not_there_says_so() -> None:
    """It said that there is no autopilot of that name."""
    with pytest.raises(LogNotFoundError):
        quadid_logs.plan("flight.bin")


def test_a_plan_for_an_unknown_autopilot_names_those_that_are_known() -> None:
    """A name has no ending."""
    with pytest.raises(SettingsError, match="ardupilot"):
        quadid_logs.plan("kiss")


def test_a_folder_with_the_name_of_an_autopilot_is_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where logs are sorted by autopilot."""
    (tmp_path / "px4").mkdir()
    monkeypatch.chdir(tmp_path)
    assert quadid_logs.plan("px4").autopilot == "px4"


def test_what_every_verb_returns_shows_itself_in_a_few_lines(
    analysis: quadid_logs.Analysis, tuned: Result, followed: Result
) -> None:
    """At a prompt."""
    tuning = quadid_logs.tune(tuned)
    shown = (
        tuning,
        *tuning.axes.values(),
        quadid_logs.compare(tuned, followed),
        quadid_logs.repeat([analysis, SAMPLE]),
        quadid_logs.check(followed, tuned),
        quadid_logs.plan("ardupilot"),
        *analysis.figures.values(),
    )
    for each in shown:
        assert repr(each).startswith("<")
        assert len(repr(each)) < 600
        assert repr(each).count("\n") < 5


def test_what_an_analysis_holds_shows_itself_in_a_few_lines(analysis: quadid_logs.Analysis) -> None:
    """A diagnosis or the health of a flight filled a screen with arrays."""
    signal = analysis.log.signals["body_rate"][0]
    shown = (
        analysis.diagnosis,
        *analysis.diagnosis.findings,
        *analysis.diagnosis.axes.values(),
        analysis.health,
        *analysis.loop.margins.values(),
        *analysis.data.segments,
        analysis.model["roll", "L"],
        analysis.model.posterior,
        signal,
        signal.rows,
    )
    for each in shown:
        assert len(repr(each)) < 600
        assert repr(each).count("\n") < 4
    assert analysis.health is not None
    for name, topic in analysis.health.topics.items():
        assert topic.sentence[:40] in repr(topic)
        assert f"{name} {topic.level}" in repr(analysis.health)
    assert "roll" in repr(analysis.diagnosis)
    assert analysis.diagnosis.findings[0].code in repr(analysis.diagnosis)


def test_a_table_is_told_that_it_names_no_autopilot_to_plan_for(analysis: quadid_logs.Analysis) -> None:
    """ "There is no plan for 'other'" names nothing that the user gave."""
    with pytest.raises(SettingsError, match=r"does not say which autopilot.*ardupilot"):
        quadid_logs.plan(analysis.to_pandas())


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_fleet_of_a_table_is_told_to_write_it_first(
    wrapped: bool, tmp_path: Path, analysis: quadid_logs.Analysis
) -> None:
    """Its columns were taken for paths of logs."""
    table = analysis.to_pandas()
    with pytest.raises(SettingsError, match="needs files"):
        quadid_logs.fleet([table] if wrapped else table, tmp_path / "store")


def test_a_tuning_shows_each_gain_that_changes(tuned: Result) -> None:
    """From the value that flew to the next one."""
    tuning = quadid_logs.tune(tuned)
    assert tuning.changes
    for name, one in tuning.changes.items():
        assert f"{name} {one.now:g} -> {one.next:g}" in repr(tuning)


@pytest.mark.thorough
def test_a_figure_shows_itself_in_a_notebook_and_is_written(
    analysis: quadid_logs.Analysis, tmp_path: Path
) -> None:
    """As the same picture."""
    figure = analysis.figures["flight"]
    drawn = figure._repr_png_()
    assert drawn.startswith(b"\x89PNG")
    figure.save(tmp_path / "flight.png")
    assert (tmp_path / "flight.png").read_bytes() == drawn
    assert figure.to_matplotlib().axes


def test_figures_are_computed_once(analysis: quadid_logs.Analysis) -> None:
    """They take seconds of a long log."""
    assert analysis.figures["flight"] is analysis.figures["flight"]


def test_the_states_of_the_system_have_names(analysis: quadid_logs.Analysis) -> None:
    """Rates, torques behind the lag, the approximation of the delay."""
    model = analysis.model
    assert model.to_statespace(0).state_labels == ["p", "q", "r", "L_lag", "M_lag", "N_lag"]
    system = model.to_statespace(1, delay_s=0.01)
    assert system.state_labels[6:] == ["L_delay1", "M_delay1", "N_delay1"]
    assert (system.input_labels, system.output_labels) == (["L", "M", "N"], ["p", "q", "r"])


@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_approximated_delay_turns_the_phase_as_the_delay_does(
    order: int, analysis: quadid_logs.Analysis
) -> None:
    """At half a radian over the delay; and it changes no gain."""
    delay_s = 0.02
    at = 1j * 0.5 / delay_s
    ratio = analysis.model.to_statespace(order, delay_s=delay_s)(at) / analysis.model.to_statespace(0)(at)
    np.testing.assert_allclose(np.diagonal(ratio), np.exp(-at * delay_s), rtol=2e-2 if order == 1 else 1e-3)


def test_the_identified_delay_is_the_default(analysis: quadid_logs.Analysis) -> None:
    """Where its interval does not hold zero; a given one of nothing is none."""
    model = analysis.model
    assert model.to_statespace(delay_s=0.0).nstates == 6
    at = 1j * 20.0
    actuator = model.actuator
    if actuator is not None and actuator.delay_ci95_s[0] > 0.0:
        assert model.to_statespace()(at)[0, 0] == pytest.approx(
            model.to_statespace(delay_s=actuator.delay_s)(at)[0, 0]
        )


@pytest.mark.parametrize(("order", "delay_s"), [(-1, None), (2, -0.01), (2, float("nan")), (2, float("inf"))])
def test_a_delay_that_cannot_be_is_refused(
    order: int, delay_s: float | None, analysis: quadid_logs.Analysis
) -> None:
    """With what to give."""
    with pytest.raises(SettingsError, match="0 or more"):
        analysis.model.to_statespace(order, delay_s=delay_s)


def test_drawn_vehicles_have_the_spread_of_the_posterior(analysis: quadid_logs.Analysis) -> None:
    """Mean and standard deviation of the effectiveness, to what four thousand draws tell."""
    posterior = analysis.model.posterior
    assert posterior is not None
    drawn = analysis.model.draws("pitch", 4000)["effectiveness"]
    sigma = float(np.sqrt(posterior.covariance[1, 0, 0]))
    assert drawn.shape == (4000,)
    assert drawn.mean() == pytest.approx(posterior.mean[1, 0], abs=4.0 * sigma / np.sqrt(4000))
    assert drawn.std() == pytest.approx(sigma, rel=0.06)


def test_another_seed_draws_other_vehicles_and_the_same_one_the_same(analysis: quadid_logs.Analysis) -> None:
    """A study can be repeated."""
    first, again = (analysis.model.draws("roll", 5, seed=3) for _ in range(2))
    np.testing.assert_array_equal(first["effectiveness"], again["effectiveness"])
    assert not np.array_equal(first["effectiveness"], analysis.model.draws("roll", 5)["effectiveness"])


def test_no_vehicle_is_drawn_of_an_axis_that_is_none_or_not_known(analysis: quadid_logs.Analysis) -> None:
    """With one clear line."""
    from dataclasses import replace

    with pytest.raises(SettingsError, match="roll, pitch, yaw"):
        analysis.model.draws("heave")
    with pytest.raises(EmptyLogError, match="too little"):
        replace(analysis.model, posterior=None).draws("roll")


def test_a_fleet_takes_a_result_by_its_file(
    analysis: quadid_logs.Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone or among paths: workers read it by themselves."""
    from quadid_logs.fleets import run

    asked: list[list[str]] = []
    monkeypatch.setattr("quadid_logs.fleets.log_files.find_logs", lambda places: asked.append(places) or [])
    monkeypatch.setattr(run, "run_fleet", lambda *_given, **_named: None)
    monkeypatch.setattr("quadid_logs.fleets.stored.StoredFleet", lambda store: store)
    quadid_logs.fleet(analysis, tmp_path)
    quadid_logs.fleet([str(SAMPLE), analysis.log], tmp_path)
    quadid_logs.fleet(SAMPLE, tmp_path)
    assert asked == [[str(SAMPLE)], [str(SAMPLE), str(SAMPLE)], [str(SAMPLE)]]


def test_a_fleet_cannot_read_what_is_in_memory_only(tmp_path: Path) -> None:
    """With what to do."""
    with pytest.raises(SettingsError, match="not read from one"):
        quadid_logs.fleet(flown("ardupilot"), tmp_path)
