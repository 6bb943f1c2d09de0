"""Of a hundred intervals some ninety-five hold the truth: no fewer, and no more either."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.structures import DAMPED, RIGID_BODY
from quadid_logs.maths.normal import NORMAL_95

from .vehicles import Drawn, draw_flights

pytestmark = pytest.mark.thorough

#: Of 240 right intervals as few or as many miss the truth in one of a thousand studies (binomial, p = 0.05).
_FEWEST_MISSES, _MOST_MISSES = 3, 24


@pytest.fixture(scope="module")
def studied() -> list[tuple[Drawn, dict[str, Model]]]:
    """Forty flights of 24 s with gusts and with gyros as good as the intervals take them for."""
    flights = draw_flights(40, 24.0, seed=11, gyro_sigma=0.01 / NORMAL_95)
    structures = (DAMPED, RIGID_BODY)
    found = [identify(flight.data, IdentifySettings(), structures).models for flight in flights]
    return [
        (flight, {model.structure: model for model in models})
        for flight, models in zip(flights, found, strict=True)
    ]


def errors(studied: list[tuple[Drawn, dict[str, Model]]], structure: str) -> np.ndarray:
    """Return errors of effectiveness and damping in half widths of their intervals; shape (n_flights, 6)."""
    rows = []
    for flight, models in studied:
        known = models[structure].entries
        row = []
        for axis, (target, torque, rate) in enumerate(
            zip(("p_dot", "q_dot", "r_dot"), "LMN", "pqr", strict=True)
        ):
            for regressor, truth in ((torque, flight.gain[axis]), (rate, -flight.damping[axis])):
                parameter = known[target, regressor]
                low, high = parameter.ci95
                row.append((truth - 0.5 * (low + high)) / (0.5 * (high - low)))
        rows.append(row)
    return np.array(rows)


@pytest.mark.parametrize("structure", ["damped", "rigid-body"])
def test_as_many_intervals_hold_the_truth_as_they_promise(
    studied: list[tuple[Drawn, dict[str, Model]]], structure: str
) -> None:
    """On both sides: intervals that are twice as wide as they need to be are as wrong as narrow ones."""
    missed = int(np.count_nonzero(np.abs(errors(studied, structure)) > 1.0))
    assert _FEWEST_MISSES <= missed <= _MOST_MISSES


@pytest.mark.parametrize("structure", ["damped", "rigid-body"])
def test_errors_are_as_large_as_the_intervals_say(
    studied: list[tuple[Drawn, dict[str, Model]]], structure: str
) -> None:
    """Root mean square of 240 errors in standard deviations; chance moves it by a twentieth."""
    spread = NORMAL_95 * np.sqrt(np.mean(errors(studied, structure) ** 2))
    assert 0.85 < spread < 1.15
