"""Drawn numbers that fill their space evenly: quantiles over some hundred hardly depend on the draw.

`scipy.stats.qmc` draws such numbers, too, and takes longer to import than a slow log to analyze.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray

#: Primitive polynomials over two elements, with the first odd numbers of each dimension after the first,
#: which is van der Corput's (Joe and Kuo 2008, the set for pairs of dimensions, criterion D6).
_DIRECTIONS: Final = (
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
    (103, (1, 1, 1, 15, 7, 5)),
    (109, (1, 3, 1, 15, 13, 25)),
    (115, (1, 1, 5, 5, 19, 61)),
    (131, (1, 3, 7, 11, 23, 15, 103)),
    (137, (1, 3, 7, 13, 13, 15, 69)),
    (143, (1, 1, 3, 13, 7, 35, 63)),
    (145, (1, 3, 5, 9, 1, 25, 53)),
)
_BITS: Final = 30


class Drawn(Enum):
    """What is drawn of a vehicle: first dimension and number of dimensions, none of them shared."""

    NUMBERS = (0, 5)
    LAG_OR_DELAY = (5, 1)
    STAMPS = (6, 1)
    NEXT_FLIGHT = (7, 3)
    MODE = (10, 1)
    MEASURED = (11, 6)
    MOTORS = (17, 3)
    BETWEEN_FLIGHTS = (20, 3)


def even_uniform(what: Drawn, n: int, seed: int = 0) -> FloatArray:
    """Return points of a Sobol sequence in some of its dimensions, each uniform between 0 and 1.

    Parameters
    ----------
    what : Drawn
        Of the same vehicles, whatever else of them is drawn: points of one number belong together.
    n : int
        How many. The first of more are the same ones.
    seed : int
        Of the shift that makes them random.

    Returns
    -------
    ndarray, shape (n, n_dimensions)

    Notes
    -----
    I. M. Sobol, USSR Computational Mathematics and Mathematical Physics 7(4), 1967; direction numbers by
    S. Joe and F. Y. Kuo, SIAM Journal on Scientific Computing 30, 2008; in the order of their Gray code
    (Antonov and Saleev 1979), scrambled digit by digit (a random linear map of the digits, then a shift by
    exclusive or: J. Matousek, Journal of Complexity 14, 1998). Each dimension is scrambled by itself, so that
    none depends on how many are drawn.
    """
    first, n_dimensions = what.value
    columns = []
    for dimension in range(first, first + n_dimensions):
        # Directions behind a random lower triangular map of their digits, with ones on its diagonal.
        random = np.random.default_rng([seed, dimension])
        rows = [
            (1 << (_BITS - 1 - place)) | (int(random.integers(1 << place)) << (_BITS - place))
            for place in range(_BITS)
        ]
        directions = [
            sum(((row & one).bit_count() & 1) << (_BITS - 1 - place) for place, row in enumerate(rows))
            for one in _directions(dimension)
        ]
        shift = int(random.integers(1 << _BITS))
        # Each point differs from the one before by the direction of the lowest zero of its number.
        numbers = np.arange(n, dtype=np.int64)
        gray = numbers ^ (numbers >> 1)
        digits = np.full(n, shift, dtype=np.int64)
        for place, direction in enumerate(directions[: max(n, 1).bit_length()]):
            digits ^= ((gray >> place) & 1) * direction
        columns.append(np.asarray((digits + 0.5) / (1 << _BITS), dtype=np.float64))
    return np.stack(columns, axis=1)


def even_normal(what: Drawn, n: int, seed: int = 0) -> FloatArray:
    """Return standard normal numbers from the points of `even_uniform`.

    Parameters
    ----------
    what : Drawn
    n, seed : int
        As of `even_uniform`.

    Returns
    -------
    ndarray, shape (n, n_dimensions)
    """
    from scipy.special import ndtri

    return np.asarray(ndtri(even_uniform(what, n, seed)), dtype=np.float64)


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root of a covariance, along which covariances that are almost alike draw alike.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Of numbers that may be of very different sizes.

    Returns
    -------
    ndarray, shape (n, n)
        Standard normal rows times it have the covariance.
    """
    # Of numbers of one size; one for none.
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(deviation > 0.0, deviation, 1.0)
    variance, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray((axes * np.sqrt(np.maximum(variance, 0.0))) @ axes.T * scale, dtype=np.float64)


def _directions(dimension: int) -> list[int]:
    """Return the direction numbers of a dimension, the highest digit first."""
    if dimension == 0:
        return [1 << (_BITS - 1 - place) for place in range(_BITS)]
    polynomial, start = _DIRECTIONS[dimension - 1]
    degree = polynomial.bit_length() - 1
    odd = list(start)
    for place in range(degree, _BITS):
        new = odd[place - degree] ^ (odd[place - degree] << degree)
        for back in range(1, degree):
            if (polynomial >> (degree - back)) & 1:
                new ^= odd[place - back] << back
        odd.append(new)
    return [one << (_BITS - 1 - place) for place, one in enumerate(odd)]
