"""Drawn vehicles that are moved to the response measured above the band that they were fitted in."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.control.conditioning import conditioned
from quadid_logs.control.frequency_response import Response
from quadid_logs.control.posterior import draw
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.model import Posterior

HOLD_S, FITTED_HZ = 0.0025, 5.0
BANDS_HZ = 6.0 * 2.0 ** (np.arange(9) / 3.0)
DEVIATION = np.array([3.0, 0.1, 2e-4, 4e-4])


def plants(
    lag_s: float = 0.02, delay_s: float = 0.004, reaction: float = 0.0, reaction_sigma: float = 0.0
) -> Plant:
    mean = np.array([300.0, -2.0, lag_s, delay_s + 0.5 * HOLD_S, reaction])
    variance = np.diag([*DEVIATION, reaction_sigma]) ** 2
    posterior = Posterior(
        mean=np.tile(mean, (3, 1)), covariance=np.tile(variance, (3, 1, 1)), lag_or_delay_s=0.0
    )
    drawn = draw(posterior, 0, HOLD_S)
    assert drawn is not None
    return drawn


def seen(truth: Plant, given: Plant, frequency_hz: np.ndarray = BANDS_HZ, error: float = 0.003) -> Response:
    """Return the true vehicle's response over that of the estimate."""
    ratio = truth.response(frequency_hz, HOLD_S)[0] / given.response(frequency_hz, HOLD_S)[0]
    return Response(frequency_hz, ratio, np.full(frequency_hz.size, error))


def late(plant: Plant, delay_s: float) -> Plant:
    one = plant.at(slice(0, 1))
    return one._replace(delay_s=one.delay_s + delay_s)


def waiting_s(plant: Plant) -> np.ndarray:
    return plant.lag_s + plant.delay_s


def test_a_delay_that_the_fit_missed_is_found_in_the_measured_response() -> None:
    """Half a millisecond is 3.6 degrees at 20 Hz; the draws leave twice that open."""
    given = plants()
    moved = conditioned(given, seen(late(given, 5e-4), given), HOLD_S, FITTED_HZ, crosses_above=False)
    assert waiting_s(moved)[0] - waiting_s(given)[0] == pytest.approx(5e-4, abs=1e-4)


def test_what_was_measured_makes_the_vehicles_more_alike() -> None:
    given = plants()
    moved = conditioned(given, seen(late(given, 0.0), given), HOLD_S, FITTED_HZ, crosses_above=False)
    assert np.std(waiting_s(moved)[1:]) < 0.7 * np.std(waiting_s(given)[1:])
    assert np.std(moved.effectiveness[1:]) < np.std(given.effectiveness[1:])


def test_a_reaction_that_the_fit_missed_is_sought_in_the_measured_response() -> None:
    """Above the corner of its lead yaw turns with the reaction alone; 3 % is within what a model may lack."""
    given = plants(reaction=20.0, reaction_sigma=0.4)
    truth = given.at(slice(0, 1))
    truth = truth._replace(lead_s=20.6 / truth.effectiveness)
    moved = conditioned(given, seen(truth, given), HOLD_S, FITTED_HZ, crosses_above=False)
    assert 20.2 < moved.reaction[0] < 20.6


def test_a_reaction_that_is_known_is_that_of_every_moved_vehicle() -> None:
    """Whatever its effectiveness is moved to."""
    given = plants(reaction=20.0)
    moved = conditioned(given, seen(late(given, 5e-4), given), HOLD_S, FITTED_HZ, crosses_above=False)
    np.testing.assert_allclose(moved.reaction, 20.0, rtol=1e-9)


def test_bands_of_the_fit_do_not_count_twice() -> None:
    given = plants()
    below = seen(late(given, 5e-4), given, 0.8 * BANDS_HZ[:1])
    assert conditioned(given, below, HOLD_S, FITTED_HZ, crosses_above=True) is given


def test_bands_that_scatter_leave_the_vehicles_as_uncertain_as_they_scatter() -> None:
    """A tenth of gain from band to band: the model does not know this vehicle."""
    given = plants()
    exact = seen(late(given, 0.0), given)
    rough = exact._replace(gain=exact.gain * np.exp(0.1 * (-1.0) ** np.arange(BANDS_HZ.size)))
    alike, apart = (
        conditioned(given, each, HOLD_S, FITTED_HZ, crosses_above=False) for each in (exact, rough)
    )
    assert np.std(waiting_s(apart)[1:]) > 1.2 * np.std(waiting_s(alike)[1:])


def test_above_the_fitted_band_the_measured_response_outweighs_a_sure_fit() -> None:
    """What a lag and a delay leave at 5 Hz, the fit may have taken for a delay, however sure it is."""
    given = plants()._replace(delay_s=np.full(401, 0.004))
    response = seen(late(given, 5e-4), given)
    bound, free = (
        conditioned(given, response, HOLD_S, FITTED_HZ, crosses_above=each) for each in (False, True)
    )
    assert waiting_s(free)[0] - waiting_s(bound)[0] > 2e-4


def test_no_vehicle_gets_a_negative_time() -> None:
    given = plants(lag_s=1e-4, delay_s=1e-4)
    moved = conditioned(given, seen(late(given, -1e-3), given), HOLD_S, FITTED_HZ, crosses_above=True)
    assert moved.lag_s.min() >= 0.0
    assert moved.delay_s.min() >= 0.0


def test_a_flight_that_tells_no_frequency_has_an_empty_response() -> None:
    """No line of the rate is above the noise: nothing is compared, and nothing ends."""
    assert plants().response(np.zeros(0), HOLD_S).shape[1] == 0
