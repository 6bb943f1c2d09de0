"""Body rates some steps ahead: what a horizon is told, and intervals that hold in other flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from quadid_logs.data.flight import FlightData
from quadid_logs.errors import EmptyLogError, SettingsError
from quadid_logs.identify.horizons import RatePredictor, fit_predictor
from tests.marks import thorough

from .vehicles import QUAD, Truth, flight_data, fly

HORIZONS = (1, 40, 200)
#: Of a body that the air turns back [rad/(m s)]: a nano-drone's is 18.
BY_SPEED = 4.0


def pushed(seed: int, truth: Truth = QUAD, size: float = 0.4) -> FlightData:
    """Return 25 s at 400 Hz under torques of up to some hertz, other ones for each seed."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((10_000, 3))
    slow = lfilter([0.02], [1.0, -0.98], white, axis=0)
    return fly(truth, size * slow, seed=seed)


def carried(seed: int) -> FlightData:
    """Return 40 s of rates that only the speed through the air moves, and its speed."""
    rng = np.random.default_rng(seed)
    speed = lfilter([0.03], [1.0, -0.998], rng.standard_normal((16_000, 3)), axis=0)
    turned = BY_SPEED * speed[:, [1, 0, 2]] * np.array([-1.0, 1.0, 0.0])
    rate = lfilter([0.0025], [1.0, -0.995], turned, axis=0) + 1e-4 * rng.standard_normal((16_000, 3))
    flight = flight_data(rate, 1e-4 * rng.standard_normal((16_000, 3)))
    (segment,) = flight.segments
    return replace(flight, segments=(replace(segment, velocity_m_s=speed),))


def without_velocity(flight: FlightData) -> FlightData:
    """Return the flight as a log without an estimator has it."""
    (segment,) = flight.segments
    return replace(flight, segments=(replace(segment, velocity_m_s=None),))


@pytest.fixture(scope="module")
def ahead() -> RatePredictor:
    """Six flights of one vehicle."""
    return fit_predictor([pushed(seed) for seed in range(6)], HORIZONS)


@pytest.mark.parametrize("seed", [100, thorough(101), thorough(102)])
def test_intervals_hold_in_flights_that_were_not_fitted(ahead: RatePredictor, seed: int) -> None:
    """95 % of the starts, as far as a flight of 25 s tells: half a second is 50 horizons of it."""
    for found in ahead.predict(pushed(seed)):
        assert 0.92 <= found.coverage.mean() <= 0.98
        assert found.coverage.min() >= 0.87


def test_predictions_are_far_better_than_rates_that_stay(ahead: RatePredictor) -> None:
    """A tenth of the error a tenth of a second ahead; a fifth half a second ahead, where axes couple."""
    first, tenth, half = ahead.predict(pushed(100))
    # One sample ahead nothing is left but the gyro's noise, 2 mrad/s on each of three axes and on the start.
    assert first.error_rad_s < 0.005
    assert tenth.error_rad_s < 0.1 * tenth.kept_error_rad_s
    assert half.error_rad_s < 0.2 * half.kept_error_rad_s


def test_a_prediction_is_held_against_the_rate_at_the_end_of_its_horizon(ahead: RatePredictor) -> None:
    """And every horizon begins at the same samples."""
    flight = pushed(100)
    rate = flight.segments[0].body_rate_rad_s
    for found in ahead.predict(flight):
        # A tenth of a second is what a horizon is told of.
        start = slice(40, len(rate) - HORIZONS[-1])
        end = slice(start.start + found.n_steps, start.stop + found.n_steps)
        np.testing.assert_array_equal(found.kept, rate[start])
        np.testing.assert_allclose(found.measured, rate[end], rtol=1e-12)
        assert found.horizon_s == pytest.approx(0.0025 * found.n_steps)


def test_torque_after_the_horizon_tells_it_nothing(ahead: RatePredictor) -> None:
    """A torque that changes later changes no prediction before."""
    flight = pushed(100)
    (segment,) = flight.segments
    torque = segment.torque.copy()
    torque[5000:] += 1.0
    changed = replace(flight, segments=(replace(segment, torque=torque),))
    for before, after in zip(ahead.predict(flight), ahead.predict(changed), strict=True):
        same = 5000 - 40 - before.n_steps
        np.testing.assert_allclose(after.predicted[: same + 1], before.predicted[: same + 1], atol=1e-9)
        assert np.abs(after.predicted[same + 10] - before.predicted[same + 10]).max() > 0.0


@pytest.mark.thorough
def test_logged_speed_tells_what_the_air_will_do() -> None:
    """Of rates that nothing but the speed moves, the model without it sees nothing."""
    flights = [carried(seed) for seed in range(4)]
    other = carried(10)
    (found,) = fit_predictor(flights, (20,), memory_s=0.0).predict(other)
    blind_flights = [without_velocity(each) for each in flights]
    (blind,) = fit_predictor(blind_flights, (20,), memory_s=0.0).predict(without_velocity(other))
    assert found.error_rad_s < 0.5 * blind.error_rad_s
    assert found.half_width[:, :2].mean() < 0.5 * blind.half_width[:, :2].mean()


def test_what_was_before_a_horizon_tells_what_the_rotors_still_follow(ahead: RatePredictor) -> None:
    """Of a command that lags by 30 ms, the state where a horizon begins tells little of the next sample."""
    flight = pushed(100)
    forgetful = fit_predictor([pushed(seed) for seed in range(3)], (1,), memory_s=0.0)
    assert ahead.predict(flight)[0].error_rad_s < 0.6 * forgetful.predict(flight)[0].error_rad_s


def test_one_flight_without_speed_leaves_it_out_for_all() -> None:
    """A model of signals that a flight lacks could not be held against it."""
    flights = [carried(0), without_velocity(carried(1)), carried(2)]
    assert not [name for name in fit_predictor(flights, (20,)).groups if "speed" in name]


@pytest.mark.thorough
def test_a_flight_that_lacks_what_the_others_have_is_refused() -> None:
    """With the name of what is missing."""
    ahead = fit_predictor([carried(seed) for seed in range(3)], (20,))
    with pytest.raises(EmptyLogError, match="speed"):
        ahead.predict(without_velocity(carried(10)))


@pytest.mark.thorough
def test_flights_that_repeat_each_other_vouch_for_nothing_else() -> None:
    """A pair of each kind: left out with its like, a flight is judged by the other kind alone."""
    heavy = replace(QUAD, inertia=2.0 * QUAD.inertia)
    flights = [pushed(0), pushed(1), pushed(2, heavy), pushed(3, heavy)]
    alone = fit_predictor(flights, (200,)).horizons[0]
    in_sets = fit_predictor(flights, (200,), ["light", "light", "heavy", "heavy"]).horizons[0]
    assert in_sets.unexplained > 1.5 * alone.unexplained


@pytest.mark.parametrize(
    ("n_flights", "sets"), [(1, None), (2, ["one", "one"]), (2, ["one"]), (3, ["one", "two"])]
)
def test_intervals_need_two_sets_of_flights(n_flights: int, sets: list[str] | None) -> None:
    """And the set of each flight."""
    with pytest.raises(SettingsError, match="two sets"):
        fit_predictor([pushed(seed) for seed in range(n_flights)], (10,), sets)


def test_flights_on_different_clocks_are_refused() -> None:
    """Ten steps would be two different times."""
    other = replace(pushed(1), sample_period_s=0.005)
    with pytest.raises(SettingsError, match="400 and 200 Hz"):
        fit_predictor([pushed(0), other], (10,))


def test_flights_whose_torques_are_different_quantities_are_refused(ahead: RatePredictor) -> None:
    """A newton metre is no fraction of full command."""
    flight = pushed(100)
    assert flight.input is not None
    with pytest.raises(SettingsError, match="N m"):
        ahead.predict(replace(flight, input=replace(flight.input, unit="1")))


def test_a_horizon_longer_than_the_flight_is_refused() -> None:
    """Without a start there is nothing to predict."""
    with pytest.raises(EmptyLogError, match="20040"):
        fit_predictor([pushed(0), pushed(1)], (20_000,))


def test_a_horizon_of_no_step_is_refused() -> None:
    """The rate now is known."""
    with pytest.raises(SettingsError):
        fit_predictor([pushed(0), pushed(1)], (0, 10))


@pytest.mark.thorough
def test_a_torque_that_never_moves_does_not_stop_the_fit() -> None:
    """An axis without a torque has columns of zeros."""
    flights = []
    for seed in range(3):
        flight = pushed(seed)
        (segment,) = flight.segments
        torque = segment.torque * np.array([1.0, 1.0, 0.0])
        flights.append(replace(flight, segments=(replace(segment, torque=torque),)))
    for found in fit_predictor(flights[:2], HORIZONS).predict(flights[2]):
        assert np.isfinite(found.predicted).all()
        assert (found.half_width > 0.0).all()
