"""result.json: the contract's keys, strict JSON, and the schema in docs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from quadid_logs.data.closed_loop import FrameModes, Modes
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.result import Result
from quadid_logs.report import json_text, result_dict
from quadid_logs.report.provenance import provenance_of
from tests.analyses import Analyzed
from tests.conftest import corpus_logs
from tests.marks import thorough_but

SCHEMA = json.loads((Path(__file__).parents[2] / "docs" / "result.schema.json").read_text(encoding="utf-8"))


def strict(text: str) -> Any:
    """Parse JSON and refuse NaN and infinity, which Python would accept."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("name", ["usable", "refused", "hostile"])
def test_the_result_validates_against_the_schema(name: str, request: pytest.FixtureRequest) -> None:
    """Whatever the verdict, the keys, types and words are those of docs/result.schema.json."""
    result = request.getfixturevalue(name)
    content = strict(json_text(result, provenance_of(result.log.path, "quadid-log analyze")))
    jsonschema.Draft202012Validator(SCHEMA).validate(content)


def test_the_schema_refuses_a_missing_key(usable: Result) -> None:
    """The schema is no rubber stamp."""
    content = result_dict(usable)
    del content["models"][0]["validation"]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(SCHEMA).validate(strict(json.dumps(content)))


def test_the_contract_s_keys_are_all_there(usable: Result) -> None:
    """Spelled out once by hand, apart from the schema, as outsiders rely on them."""
    content = result_dict(usable)
    assert {"schema_version", "log", "data", "models", "axes", "findings", "timings_s"} <= content.keys()
    assert {"path", "format", "autopilot", "firmware", "vehicle_type", "frame"} <= content["log"].keys()
    assert {"start_s", "duration_s", "corrupt_bytes", "clock_resets"} <= content["log"].keys()
    assert {"sample_period_s", "segments", "n_samples", "rates", "input"} <= content["data"].keys()
    assert {"source", "rate_hz", "longest_gap_s"} <= content["data"]["rates"]["body_rate"].keys()
    model = content["models"][0]
    assert {"structure", "recommended", "states", "regressors", "targets", "inputs", "A", "B"} <= model.keys()
    assert {"parameters", "actuator", "inertia_kg_m2", "windows", "validation", "discrete"} <= model.keys()
    assert {"n", "width", "stride", "period_s", "used", "condition_number"} <= model["windows"].keys()
    assert model["windows"]["condition_number"].keys() == {"median", "p05", "p95"}
    assert set(content["axes"]) == {"roll", "pitch", "yaw"}
    assert {"read", "align", "identify", "report", "total"} <= content["timings_s"].keys()


def test_the_recommended_model_comes_first(usable: Result) -> None:
    """A script may take models[0]."""
    assert [model["recommended"] for model in result_dict(usable)["models"]] == [True, False, False]


def test_matrices_arrive_as_they_are(usable: Result) -> None:
    """No rounding, no transposition."""
    model = usable.identification.models[0]
    content = strict(json_text(usable))["models"][0]
    np.testing.assert_array_equal(content["B"], model.B)
    np.testing.assert_array_equal(content["A"], model.A)


def test_window_estimates_are_those_of_the_named_parameter(usable: Result) -> None:
    """B22 is the second target over the second input, whatever stands before."""
    model = usable.identification.models[0]
    assert model.windows is not None
    expected = np.median(model.windows.coefficients[model.windows.used, 1, len(model.regressors) + 1])
    assert result_dict(usable)["models"][0]["windows"]["estimates"]["B22"]["median"] == pytest.approx(
        expected
    )


def test_a_median_condition_number_is_given_although_some_are_infinite(usable: Result) -> None:
    """Rank-deficient windows count as the worst ones and do not spoil the median."""
    condition = result_dict(usable)["models"][0]["windows"]["condition_number"]
    assert 10.0 < condition["median"] < 25.0


def test_the_checks_of_the_gains_are_in_the_result(usable: Result) -> None:
    """Gains by name, the model's own band first."""
    model = usable.identification.models[0]
    assert model.band is not None
    assert model.change is not None
    content = strict(json_text(usable))["models"][0]
    assert content["band_check"]["gain"]["B22"] == list(model.band.on_axis_gain[:, 1])
    assert content["band_check"]["spread"]["B33"] == pytest.approx(model.band.spread[2])
    assert content["change_check"]["B11"]["before"] == model.change.before[0]


@pytest.mark.parametrize(
    ("seen", "line", "told"), [(True, (35.0, 640.0), [35.0, 640.0]), (False, (np.nan, np.nan), [None, None])]
)
def test_a_mode_of_the_frame_is_in_the_result(
    usable: Result, seen: bool, line: tuple[float, float], told: list[float | None]
) -> None:
    """Where its line stands, or null for no line; the schema knows it."""
    assert usable.closed_loop is not None
    modes = Modes(np.array([35.0]), np.array([0.02]), np.array([0.4]))
    frame = FrameModes(
        modes=modes, seen=seen, line_hz=line[0], line_height=line[1], absent=0.25, visible_hz=180.0
    )
    loop = replace(usable.closed_loop.axes["roll"], frame=frame)
    closed_loop = replace(usable.closed_loop, axes={**usable.closed_loop.axes, "roll": loop})
    content = strict(json_text(replace(usable, closed_loop=closed_loop)))
    found = content["closed_loop"]["axes"]["roll"]["frame"]
    assert [found["line_hz"], found["line_height"]] == told
    assert (found["seen"], found["absent_probability"], found["visible_hz"]) == (seen, 0.25, 180.0)


def test_what_the_instruments_explain_is_in_the_result(usable: Result) -> None:
    """By axis, beside what of the whole acceleration is explained."""
    model = usable.identification.models[0]
    told = replace(model, validation=replace(model.validation, r2_commanded={"p_dot": 0.75}))
    identification = replace(usable.identification, models=(told, *usable.identification.models[1:]))
    content = strict(json_text(replace(usable, identification=identification)))
    assert content["models"][0]["validation"]["r2_commanded"] == {"p_dot": 0.75}


def test_the_check_of_the_gyro_is_in_the_result(usable: Result) -> None:
    """The identity, within its own interval, where nothing is wrong."""
    content = strict(json_text(usable))["data"]["gyro_check"]
    np.testing.assert_allclose(content["attitude_over_rate"], np.eye(3), atol=0.03)
    assert content["lag_s"]["ci95"][0] < content["lag_s"]["value"] < content["lag_s"]["ci95"][1]


def test_what_is_not_finite_becomes_null(refused: Result) -> None:
    """NaN and infinity in any depth, numpy scalars and odd objects included."""
    finding = Finding(
        code="QL999",
        level="info",
        title="",
        evidence={"a": float("inf"), "b": np.float32(2.5), "c": {1: [np.nan]}, "d": Path("x"), "e": np.True_},
        advice="",
    )
    diagnosis = replace(refused.diagnosis, findings=(finding,))
    content = strict(json_text(replace(refused, diagnosis=diagnosis)))
    assert content["findings"][0]["evidence"] == {
        "a": None,
        "b": 2.5,
        "c": {"1": [None]},
        "d": "x",
        "e": True,
    }
    assert content["data"]["sample_period_s"] is None


def test_control_characters_are_escaped_in_the_text(hostile: Result) -> None:
    """A terminal that shows result.json is not steered by the log."""
    text = json_text(hostile)
    assert text.isascii()
    assert "\x1b" not in text


def strings(value: Any) -> Iterator[str]:
    """Yield every string in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for item in value.values():
            yield from strings(item)
    elif isinstance(value, list):
        for item in value:
            yield from strings(item)


def test_texts_of_the_log_survive_unchanged(hostile: Result) -> None:
    """For programs the text is data: nothing is cut or escaped."""
    assert hostile.log.firmware in set(strings(strict(json_text(hostile))))


#: One log of each kind that a reader makes: the autopilots, their ages and ways to log, and damage.
#: Where a kind has several, one that other tests analyze, too.
OF_EACH_KIND = (
    "damaged/one-packet-70B.tlog",
    "damaged/sitl-flightlogs-bad-packets-4MB.tlog",
    "damaged/truncated-80k-ac462-real.bin",
    "firmware/ac47_quadx_default_logging.BIN",
    "firmware/ac47_quadx_sid_roll.BIN",
    "firmware/bf_quad_sticks.bbl",
    "firmware/px4_quad_multisine.ulg",
    "real/ac30-quadV-underpowered.log",
    "real/ac32dev-quad-handrotated-52s.tlog",
    "real/ac413-quadx-goodprop-hover1.bin",
    "real/cfbl-square3-rotors.csv",
    "real/px4-1.15-quad-hover-80s.ulg",
    "real/rover246-real-61.bin",
)


@pytest.mark.thorough
@pytest.mark.corpus
@pytest.mark.parametrize(
    "corpus_log",
    thorough_but(OF_EACH_KIND, sorted({*OF_EACH_KIND, *corpus_logs("firmware", "real", "damaged")})),
    indirect=True,
)
def test_the_result_of_every_log_validates_against_the_schema(corpus_log: Path, analyzed: Analyzed) -> None:
    """Flown, damaged, refused, large: the same keys and types."""
    from quadid_logs.errors import LogError

    try:
        result = analyzed(corpus_log)
    except LogError:
        pytest.skip("not a flight log at all")
    jsonschema.Draft202012Validator(SCHEMA).validate(strict(json_text(result)))
