"""The Python interface: a flight analyzed reads like the maths."""

from __future__ import annotations

import inspect
import pkgutil
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import quadid_logs
from quadid_logs import Analysis, RateTerm, own_structure
from quadid_logs.data.result import Result
from quadid_logs.errors import EmptyLogError, SettingsError, ShapeError, UnknownFormatError
from quadid_logs.figures import figures_of
from tests.synthetic_results import hostile_result, refused_result

#: Of damping that goes with the square: a term that the package does not have.
DRAG = RateTerm(symbol="p|p|", units=("1", "s"), of_rate=lambda rate: rate[:, 0] * np.abs(rate[:, 0]))
OWN = own_structure("own", ["p", "q", "r", DRAG, "1"])


@pytest.fixture(scope="module")
def flown() -> Analysis:
    """Return a short simulated flight, analyzed without a file; other tests fly it, too."""
    return quadid_logs.analyze(quadid_logs.simulate("sysid-quad-x", seed=2, duration_s=25.0, rate_hz=200.0))


@pytest.fixture(scope="module")
def again(flown: Analysis) -> Analysis:
    """Return its aligned series as a DataFrame, analyzed with a structure of our own."""
    return quadid_logs.analyze(flown.to_pandas(), structure=OWN)


@pytest.fixture(scope="module")
def refused() -> Analysis:
    """Return a log that never flew."""
    return as_analysis(refused_result())


def as_analysis(result: Result) -> Analysis:
    """Return a result made by hand with the methods of an analysis."""
    return Analysis(**{each.name: getattr(result, each.name) for each in fields(Result)})


def test_a_parameter_is_found_by_axis_and_input_target_and_regressor_or_name(flown: Analysis) -> None:
    """All three name the same element of B."""
    model = flown.model
    assert model["roll", "L"] is model["p_dot", "L"] is model["B11"]
    assert model["roll", "L"].value == model.B[0, 0]
    assert model["pitch", "M"] is model["q_dot", "M"] is model["B22"]
    with pytest.raises(KeyError, match="p_dot"):
        model["roll", "X"]


def test_the_verdict_is_by_axis(flown: Analysis) -> None:
    """As in result.json."""
    assert flown.verdict == {axis: each.verdict for axis, each in flown.diagnosis.axes.items()}
    assert flown.usable == flown.diagnosis.usable


def test_parameters_are_a_table_of_every_element_with_its_interval(flown: Analysis) -> None:
    """One row each, found by name."""
    table, model = flown.parameters, flown.model
    assert len(table) == model.A.size + model.B.size
    row = table.loc["B22"]
    assert (row["axis"], row["regressor"], row["unit"]) == ("pitch", "M", "rad/s^2")
    assert (row["ci95_low"], row["ci95_high"]) == model["pitch", "M"].ci95


def test_the_aligned_series_are_a_table_by_time(flown: Analysis) -> None:
    """As exported."""
    frame = flown.to_pandas()
    assert frame.index.name == "time_s"
    assert len(frame) == flown.data.n_samples
    np.testing.assert_array_equal(frame["q_rad_s"], flown.data.segments[0].body_rate_rad_s[:, 1])


def test_a_table_in_memory_gives_the_flight_that_it_was_taken_from(flown: Analysis, again: Analysis) -> None:
    """Nothing is lost between the DataFrame and the fit: the same effectiveness within both intervals."""
    for axis, torque in (("roll", "L"), ("pitch", "M")):
        first, second = flown.models["damped"][axis, torque], again.models["damped"][axis, torque]
        assert second.value == pytest.approx(first.value, rel=0.01)


def test_arrays_are_a_log_too(flown: Analysis) -> None:
    """By canonical name, as the DataFrame's columns."""
    frame = flown.to_pandas().reset_index()
    table = {name: frame[name].tolist() for name in frame}
    from quadid_logs.api.analysis import as_log

    log = as_log(table)
    assert not isinstance(log, str | Path)
    np.testing.assert_array_equal(log.signals["body_rate"][0].values[:, 0], frame["p_rad_s"])


@pytest.mark.parametrize(
    ("table", "error"),
    [
        ({"p_rad_s": [0.0]}, UnknownFormatError),
        ({"time_s": [0.0], "p_rad_s": [0.0]}, UnknownFormatError),
        ({"time_s": []}, EmptyLogError),
        ({"time_s": [0.0, 1.0], "throttle": [0.0]}, ShapeError),
        ({"time_s": ["now"]}, ShapeError),
        ({"time_s": [[0.0]]}, ShapeError),
        (3.0, TypeError),
    ],
)
def test_a_table_that_is_none_is_refused(table: object, error: type[Exception]) -> None:
    """With one clear line."""
    with pytest.raises(error):
        quadid_logs.analyze(table)


def test_a_structure_of_ones_own_is_fitted_and_recommended(again: Analysis) -> None:
    """Beside those of the package, with a term that the package does not have."""
    assert again.model.structure == "own"
    assert again.model.regressors == OWN.regressors
    assert {"own", "damped", "quadrotor-6", "linear-9"} <= again.models.keys()
    assert abs(again.model["roll", "p|p|"].value) < 1.0


def test_a_model_with_terms_of_ones_own_simulates(again: Analysis) -> None:
    """Its terms are asked, whatever they are."""
    push = np.outer(np.ones(50), [0.02, 0.0, 0.0])
    rates = again.model.simulate(push, 0.01 * np.arange(50))
    assert rates[-1, 0] == pytest.approx(0.02 * again.model.B[0, 0] * 0.5, rel=0.5)


def test_tables_and_figures_take_a_structure_of_ones_own(again: Analysis) -> None:
    """Terms that they do not know are columns like others."""
    assert "p|p|" in again._repr_html_()
    assert "own" in quadid_logs.result_dict(again)["models"][0]["structure"]
    assert figures_of(again).shown


@pytest.mark.parametrize(
    ("name", "terms"), [("damped", ["p"]), ("", ["p"]), ("own", ["x"]), ("own", ["p", "p"]), ("own", ["L"])]
)
def test_a_structure_that_cannot_be_is_refused(name: str, terms: list[str]) -> None:
    """A name that is taken, a term that is not known or there twice."""
    with pytest.raises(SettingsError):
        own_structure(name, terms)


def test_a_model_predicts_another_flight_of_its_vehicle(flown: Analysis, again: Analysis) -> None:
    """Nothing is fitted to it, and all of it is held out."""
    prediction = flown.model.predict(replace(again, log=flown.log))
    assert prediction.validation.held_out_s > 15.0
    assert all(scores["r2_acceleration"] > 0.98 for scores in prediction.scores.values())
    frame = prediction.to_pandas()
    assert frame["p_dot_modelled_rad_s2"].corr(frame["p_dot_rad_s2"]) > 0.99


def test_a_wrong_model_predicts_badly(flown: Analysis) -> None:
    """The score of half the effectiveness is that of half the acceleration."""
    wrong = replace(flown.model, B=0.5 * flown.model.B)
    assert wrong.predict(flown).scores["roll"]["r2_acceleration"] == pytest.approx(0.75, abs=0.05)


def test_a_flight_in_another_unit_is_not_predicted(flown: Analysis, again: Analysis) -> None:
    """A table's command is no autopilot's command."""
    with pytest.raises(SettingsError, match="normalised command"):
        flown.model.predict(again)


def test_a_log_without_flight_is_not_predicted(flown: Analysis, refused: Analysis) -> None:
    """There is nothing to hold the model against."""
    with pytest.raises(EmptyLogError):
        flown.model.predict(replace(refused, log=flown.log))


def test_the_state_space_system_is_the_linear_part_behind_lag_and_delay(flown: Analysis) -> None:
    """At low frequency it is B / (s - A), and its outputs have their names."""
    system = flown.model.to_statespace()
    assert (system.input_labels, system.output_labels) == (["L", "M", "N"], ["p", "q", "r"])
    slow = 1j * 2.0 * np.pi * 0.5
    damping = flown.model["roll", "p"].value
    expected = flown.model.B[0, 0] / (slow - damping) / (1.0 + slow * flown.model.actuator.lag_s)
    assert system(slow)[0, 0] == pytest.approx(expected, rel=0.02)


def test_the_margins_of_the_loop_are_by_axis(flown: Analysis) -> None:
    """Each figure with its interval."""
    margin = flown.loop.margins["roll"].rate.phase_margin_deg
    assert margin is not None
    assert margin.ci95[0] <= margin.value <= margin.ci95[1]


def test_what_is_not_there_is_said_by_name(refused: Analysis) -> None:
    """No attribute of None."""
    with pytest.raises(EmptyLogError, match="no flight"):
        _ = refused.model
    with pytest.raises(EmptyLogError, match="controller"):
        _ = refused.loop


@pytest.mark.parametrize("library", ["pandas", "control"])
def test_a_missing_library_is_named_with_what_to_install(
    library: str, flown: Analysis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are optional."""
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(SettingsError, match=f"{library} is not installed.*pip install"):
        _ = flown.parameters if library == "pandas" else flown.model.to_statespace()


def test_everything_shows_itself_in_a_few_lines(flown: Analysis) -> None:
    """At a prompt: what can be read, not all that there is."""
    shown = (flown, flown.model, flown.loop, flown.data, flown.log, flown.identification)
    for each in (*shown, flown.model.predict(flown)):
        assert len(repr(each)) < 1000
        assert repr(each).count("\n") < 6


def test_a_simulated_flight_shows_itself_in_a_line() -> None:
    """Its samples and all of its truth were printed: pages of them."""
    shown = repr(quadid_logs.simulate("doublets", duration_s=15.0, rate_hz=10.0))
    assert shown == "<Simulation of 'doublets': dataflash of ardupilot, with its truth>"


def test_an_analysis_shows_itself_in_a_notebook_and_a_hostile_log_stays_text() -> None:
    """Nobody has to call `show`."""
    hostile = as_analysis(hostile_result("\x1b[31m.bin"))
    page = hostile._repr_html_()
    assert "<table" in page
    assert "<script" not in page
    assert "\x1b" not in repr(hostile)


def test_no_module_takes_the_place_of_a_public_name() -> None:
    """Importing `quadid_logs.simulate` would put the module where the function is."""
    modules = {module.name for module in pkgutil.iter_modules(quadid_logs.__path__)}
    assert not modules & set(quadid_logs.__all__)


@pytest.mark.parametrize(
    "verb", ["analyze", "tune", "compare", "repeat", "check", "plan", "fleet", "simulate", "swing"]
)
def test_a_verb_is_a_function(verb: str) -> None:
    """With its own signature and docstring, for `help` and a notebook's question mark."""
    assert inspect.isfunction(getattr(quadid_logs, verb))


def test_importing_the_package_imports_nothing_heavy() -> None:
    """Not even numpy: public names are imported when they are used."""
    script = (
        "import sys, quadid_logs; dir(quadid_logs);"
        "assert not {'numpy', 'scipy', 'pandas', 'pyarrow', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_a_plan_is_predicted_by_a_simulated_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    """`Plan.predict` flies it."""
    planned = quadid_logs.plan("px4", ["roll"], firmware="1.15")
    assert planned.version == (1, 15)
    monkeypatch.setattr("quadid_logs.planning.predict", lambda plan, vehicle: (plan, vehicle))
    assert planned.predict() == (planned, None)
