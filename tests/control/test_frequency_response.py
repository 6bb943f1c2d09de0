"""What the log shows of the loop around its crossover, and whether it supports the model."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.control.closed_loop import close_loop
from quadid_logs.control.frequency_response import Lines, Response, confirm, lines_of, response
from quadid_logs.control.loop import close
from quadid_logs.data.closed_loop import AxisLoop, Plant
from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from tests.control.loop_flights import AXES, PERIOD_S, Vehicle, controllers, flight

TRUE = AXES["roll"]
PLANT = Plant(*(np.array([x]) for x in (TRUE.B, TRUE.A, TRUE.lag_s, TRUE.delay_steps * PERIOD_S)))


def over_model(lines: Lines) -> Response:
    """Return the measured vehicle over the true one, by set-points."""
    loop = close(TRUE.controller, PLANT, lines.frequency_hz)
    vehicle = loop.target_to_rate[0] / loop.target_to_torque[0]
    return response(lines.frequency_hz, lines.setpoint, lines.torque * vehicle, lines.rate).known()


def test_in_gusts_the_response_by_set_points_is_that_of_the_vehicle_within_its_error() -> None:
    """Torque and rate by themselves would show the controller's answer to the gusts."""
    lines = lines_of(flight(gust=2.0), 0, PERIOD_S)
    assert lines is not None
    ratio = over_model(lines)
    # Above, what happens between the samples is seen, too.
    near = ratio.frequency_hz < 20.0
    assert np.count_nonzero(near) >= 10
    z = (np.abs(ratio.gain - 1.0) / np.hypot(ratio.error, 0.01))[near]
    assert np.mean(z < 2.0) > 0.8


def test_the_error_is_that_of_repeated_flights() -> None:
    """Over random disturbances the estimate scatters by what it says of itself."""
    generator = np.random.default_rng(3)
    frequency_hz = np.linspace(0.0, 100.0, 401)
    gains, errors = [], []
    for _ in range(200):
        z, left = (
            generator.standard_normal((30, 401)) + 1j * generator.standard_normal((30, 401)) for _ in range(2)
        )
        found = response(frequency_hz, z, z, z + 0.5 * left)
        gains.append(found.gain[6])
        errors.append(found.error[6])
    # The taper's correlation between lines is allowed for: of independent lines half are enough.
    assert np.std(gains) == pytest.approx(np.median(errors) * np.sqrt(0.5), rel=0.15)


def test_where_an_instrument_has_only_leakage_nothing_is_known() -> None:
    """A chirp that ends at 8 Hz says nothing about 20 Hz, however small the residual is."""
    lines = lines_of(flight(seconds=60.0, chirp_hz=8.0), 0, PERIOD_S)
    assert lines is not None
    assert lines.chirp is not None
    found = response(lines.frequency_hz, lines.chirp, lines.torque, lines.rate).known()
    assert 6.0 < found.frequency_hz.max() < 9.0


def ratio(gain: complex, n: int = 6, centre_hz: float = 5.0, error: float = 0.01) -> Response:
    frequency_hz = centre_hz * 2.0 ** ((np.arange(n) - n // 2) / 3.0)
    return Response(frequency_hz, np.full(n, gain), np.full(n, error))


def test_a_response_near_the_models_supports_it_up_to_its_last_frequency() -> None:
    found = confirm(ratio(1.03 + 0.02j), 5.0, 2.0)
    assert not found.contradicted
    assert found.known_hz == pytest.approx(5.0 * 2.0 ** (2 / 3))


@pytest.mark.parametrize("gain", [1.3, 0.75, np.exp(-0.3j)])
def test_a_response_far_from_the_models_contradicts_it(gain: complex) -> None:
    """A quarter in gain or 17 degrees: more than a lag and a delay leave of a vehicle."""
    found = confirm(ratio(gain), 5.0, 2.0)
    assert found.contradicted
    assert found.known_hz == 0.0


def test_a_response_that_is_hardly_known_says_nothing() -> None:
    """Two bands are no evidence, and neither is a band that may be anything."""
    assert not confirm(ratio(1.3, n=2), 5.0, 2.0).contradicted
    assert not confirm(ratio(1.3, error=0.5), 5.0, 2.0).contradicted
    assert confirm(ratio(1.0, n=2, centre_hz=40.0), 5.0, 2.0).known_hz >= 2.0


@pytest.mark.parametrize(("spread", "contradicted"), [(0.25, False), (0.02, True)])
def test_what_the_fit_leaves_open_is_no_contradiction(spread: float, contradicted: bool) -> None:
    """A margin whose interval holds the measured loop is not called wrong; one that does not is."""
    drawn = 1.0 + spread * np.random.default_rng(1).standard_normal((400, 1)) * np.ones(6)
    assert confirm(ratio(1.3), 5.0, 2.0, drawn.astype(complex)).contradicted == contradicted


def closed(vehicle: Vehicle, model_of: Vehicle, **flown: float) -> AxisLoop:
    """Close the loop of a flight around the model of another."""
    model = identify(flight({**AXES, "roll": model_of}), IdentifySettings()).recommended
    assert isinstance(model, Model)
    data = flight({**AXES, "roll": vehicle}, **flown)
    return close_loop(data, model, controllers(), {}, low_hz=0.3).axes["roll"]


@pytest.mark.thorough
def test_a_second_lag_that_the_model_does_not_have_contradicts_it() -> None:
    """A frame or an output board that takes phase away at the crossover."""
    assert closed(Vehicle(extra_lag_s=0.03), TRUE).contradicted
    assert not closed(TRUE, TRUE).contradicted


@pytest.mark.thorough
def test_an_excitation_at_the_mixer_shows_the_broken_loop_itself() -> None:
    """From 1 to 19 Hz, within 3 % and 2 degrees of the loop that flew."""
    found = closed(TRUE, TRUE, seconds=90.0, chirp_hz=22.0)
    assert found.measured is not None
    assert found.measured.direct
    f = found.measured.frequency_hz
    loop = close(TRUE.controller, PLANT, f).rate[0]
    near = (f > 1.0) & (f < 19.0)
    off = (found.measured.response / loop)[near]
    assert np.count_nonzero(near) >= 10
    assert np.abs(np.abs(off) - 1.0).max() < 0.03
    assert np.degrees(np.abs(np.angle(off))).max() < 2.0
