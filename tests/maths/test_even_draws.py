"""Even draws: each number fills its range evenly, alone and with every other number of the same vehicle."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from quadid_logs.maths.even_draws import Drawn, even_normal, even_uniform

#: Of the normal distribution at 2.5 %; numpy's of 80 values lies nearer to the middle by 0.08.
NORMAL_QUANTILE = -1.96

EVERY = np.hstack([even_uniform(what, 256, seed=3) for what in Drawn])


def test_each_number_falls_once_into_each_of_as_many_equal_parts() -> None:
    """The first 256 points of a Sobol sequence, in any one dimension."""
    parts = np.sort(np.floor(256 * EVERY), axis=0)
    np.testing.assert_array_equal(parts, np.tile(np.arange(256.0)[:, np.newaxis], EVERY.shape[1]))


def test_effectiveness_and_damping_fall_once_into_each_square_of_any_shape() -> None:
    """The first two dimensions are a net in base 2 of quality 0: no other pair of sequences is more even."""
    for bits in range(9):
        high, low = (np.floor(2.0**power * EVERY[:, place]) for place, power in ((0, bits), (1, 8 - bits)))
        assert np.unique(high * 2.0 ** (8 - bits) + low).size == 256


def test_no_two_numbers_of_a_vehicle_go_together() -> None:
    """Whatever they are drawn for: of random ones, the two most alike of all pairs are correlated by 0.19."""
    every = np.hstack([even_uniform(what, 400, seed=3) for what in Drawn])
    correlation = np.corrcoef(every.T) - np.eye(every.shape[1])
    assert np.abs(correlation).max() < 0.13


def test_the_first_of_more_vehicles_are_the_same_ones() -> None:
    few, many = (even_uniform(Drawn.NUMBERS, n) for n in (81, 400))
    np.testing.assert_array_equal(few, many[:81])


@pytest.mark.parametrize(("n", "most"), [(400, 0.09), (80, 0.19)])
def test_the_worst_of_evenly_drawn_vehicles_hardly_depends_on_the_draw(n: int, most: float) -> None:
    """The 2.5 % quantile of a sum of five numbers: random ones scatter by 0.13 and 0.30 of its deviation."""
    ends = [
        np.quantile(even_normal(Drawn.NUMBERS, n, seed) @ np.array(signs) / np.sqrt(5.0), 0.025)
        for seed, signs in itertools.product(range(4), itertools.product((1.0, -1.0), repeat=4))
        for signs in [(1.0, *signs)]
    ]
    assert np.std(ends) < most
    assert np.mean(ends) == pytest.approx(NORMAL_QUANTILE, abs=0.1)
