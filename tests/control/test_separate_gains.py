"""The search for gains, each by itself."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.control.separate_gains import SeparateGains


class TwoGains(SeparateGains):
    """Two gains that are to be high, at most e; either is a burden as far as it is above the other."""

    def __init__(self) -> None:
        pass

    def _weighed(
        self,
        factors: Mapping[str, FloatArray],
        most_up: float = np.inf,  # noqa: ARG002
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        first, second = np.log(factors["first"]), np.log(factors["second"])
        above = 3.0 * (first - second)
        return -first - second, 1.0 - first[:, np.newaxis], np.stack([above, -above], axis=1)


@pytest.mark.parametrize("begin", [0.5, 1.0, 2.0])
def test_a_search_leaves_gains_at_which_burdens_begin(begin: float) -> None:
    """The cost has an edge there: any one gain alone makes it worse, both together better."""
    bounds = {"first": (0.25, 4.0), "second": (0.25, 4.0)}
    found = TwoGains()._search([{"first": begin, "second": begin}], bounds, np.inf)
    assert found == pytest.approx({"first": np.e, "second": np.e}, rel=0.01)
