"""The bound of the study of filters: what it says of a vehicle is what the true loop does."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.simulator.control import TrackingNotch
from study import filters as study
from study.filter_bound import Filters, TrueAxis, worth

#: A vehicle whose notch stands at a wrong place.
SEED, NUMBER = 11, 2
#: Other filters, and factors on P, I, D and the angle gain.
OTHER = Filters(70.0, TrackingNotch(80.0, 30.0))
DERIVATIVE_HZ = 45.0
FACTORS = np.array([1.3, 0.8, 0.6, 0.9])


@pytest.fixture(scope="module")
def drawn():
    """Return a vehicle, how it is set, and its flight."""
    scenario, flown, _ = study.draw_vehicle(SEED, NUMBER)
    return scenario, flown, study._setup(scenario, flown, 0)


@pytest.fixture(scope="module")
def roll(drawn):
    """Return the bound's view of its roll axis."""
    _, _, setup = drawn
    return TrueAxis(setup, 0, study.rotors_hz(setup))


def test_gusts_and_noise_behind_other_filters_and_gains_are_those_of_the_true_loop(drawn, roll):
    """The study judges flights by the true loop: a bound of another loop would bound nothing."""
    scenario, flown, _ = drawn
    gains = flown.gains.copy()
    gains[:, 0] *= FACTORS
    set_so = study.Flown(OTHER.gyro_hz, OTHER.notch, (DERIVATIVE_HZ, *flown.derivative_hz[1:]), gains)
    true = study.judged(study._setup(scenario, set_so, 0))["roll"]
    told = roll.point(OTHER, np.log([*FACTORS, DERIVATIVE_HZ]))
    assert told.gusts_rad == pytest.approx(true["gusts_rad"], rel=2e-3)
    assert told.noise == pytest.approx(true["noise"], rel=2e-3)


def test_the_best_gains_keep_the_margins_of_the_true_loop(drawn, roll):
    """Gains that no pilot may fly would make the bound too good."""
    scenario, flown, setup = drawn
    filters = Filters(setup.gyro_filter_hz, setup.tuning.notch)
    begin = np.log([1.0, 1.0, 1.0, 1.0, roll.flown])
    best = roll.best(filters, [begin], None, of_d=False)
    gains = flown.gains.copy()
    gains[:, 0] *= np.exp(best.logs[:4])
    true = study.judged(study._setup(scenario, flown._replace(gains=gains), 0))["roll"]
    assert true["spare"] > 0.99
    assert true["gusts_rad"] < roll.point(filters, begin).gusts_rad


def test_what_is_best_of_two_ratios_is_what_makes_the_larger_one_small(roll):
    """Half the noise at twice the gust error is no gain."""
    filters = Filters(40.0, None)
    old = roll.point(filters, np.log([1.0, 1.0, 1.0, 1.0, 20.0]))
    even = old._replace(cost=0.8 * old.cost, noise=0.8 * old.noise)
    uneven = old._replace(cost=0.5 * old.cost, noise=1.1 * old.noise)
    assert worth(even, old) < worth(uneven, old)
