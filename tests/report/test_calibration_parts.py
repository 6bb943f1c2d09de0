"""Both parts of the uncertainty of an effectiveness per newton metre are told apart."""

from __future__ import annotations

import json
import math

import pytest

from quadid_logs.data.flight import InputDescription
from quadid_logs.data.model import Parameter
from quadid_logs.data.result import Result
from quadid_logs.data.torque import Calibration
from quadid_logs.report import json_text
from quadid_logs.report.calibration_parts import calibration_half_width, flight_interval


def described(unit: str) -> InputDescription:
    """Return an input whose calibration is known to 10, 20 and an unknown per cent (1 sigma)."""
    calibration = Calibration(route="given", relative_sigma=(0.1, 0.2, math.nan))
    kind = "torque_command" if unit == "1" else "torque_n_m"
    return InputDescription(kind=kind, unit=unit, source="x", saturated_fraction=0.0, calibration=calibration)


def parameter(regressor: str, half: float) -> Parameter:
    """Return an effectiveness of -50 with a symmetric interval."""
    ci95 = (-50.0 - half, -50.0 + half)
    return Parameter(
        name="B", target="q_dot", regressor=regressor, value=-50.0, unit="", ci95=ci95, identifiable=True
    )


@pytest.mark.parametrize(("regressor", "spread"), [("L", 9.8), ("M", 19.6), ("N", 0.0), ("q", 0.0)])
def test_the_calibrations_part_is_that_of_the_input(regressor: str, spread: float) -> None:
    """1.96 sigma of 50; none for A, and where nobody knows it."""
    found = calibration_half_width(parameter(regressor, 20.0), described("N m"))
    assert found == pytest.approx(spread, rel=1e-4)


def test_the_flights_part_and_the_calibrations_add_up_as_squares_to_the_interval() -> None:
    """0.15 of the flight under 19.6 of the calibration: 20 % hid what the flight knows to 0.3 %."""
    hidden = parameter("M", math.hypot(0.15, 1.959964 * 0.2 * 50.0))
    low, high = flight_interval(hidden, described("N m"))
    assert (low, high) == pytest.approx((-50.15, -49.85), abs=1e-6)


def test_a_normalised_command_has_no_part_of_a_calibration() -> None:
    """Its interval is the flight's."""
    assert flight_interval(parameter("M", 2.0), described("1")) == (-52.0, -48.0)


def test_an_interval_without_bound_stays_without() -> None:
    """Not NaN."""
    unknown = parameter("M", math.inf)
    assert flight_interval(unknown, described("N m")) == (-math.inf, math.inf)


def test_result_json_gives_the_flights_part_only_where_there_is_another(usable: Result) -> None:
    """A normalised log keeps its keys."""
    has_part = [
        "ci95_flight" in each
        for model in json.loads(json_text(usable))["models"]
        for each in model["parameters"]
        if each["regressor"] in "LMN"
    ]
    given = usable.data.input
    assert given is not None
    assert has_part
    assert all(has_part) == any(has_part) == (given.unit != "1")
