"""The grid of other gains and filters: what a page looks up."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import pytest

from quadid_logs.control.scaled_loop import scaled_loops
from quadid_logs.control.what_if import what_if
from quadid_logs.data.controller import AxisController
from quadid_logs.data.what_if import WhatIf
from quadid_logs.report.what_if import what_if_parts
from tests.control.test_autotune import VEHICLE, controller, plants

GAINS = {"P": VEHICLE.P, "D": VEHICLE.D}


@pytest.fixture(scope="module")
def grid() -> WhatIf:
    found = what_if(GAINS, {}, controller({}), plants(300.0), controller)
    assert found is not None
    return found


def test_each_place_of_the_grid_is_the_loop_of_its_gains(grid: WhatIf) -> None:
    """In the order of the product, as the page counts."""
    for combination, loop in zip(itertools.product(*grid.values.values()), grid.loops, strict=True):
        other = controller(dict(zip(grid.values, combination, strict=True)))
        margins = scaled_loops(other, plants(300.0), np.inf).margins().full
        assert margins is not None
        assert margins.phase_margin_deg is not None
        assert loop is not None
        assert loop.phase_margin_deg == pytest.approx(margins.phase_margin_deg.value)


def test_the_middle_of_each_value_is_the_flown_one(grid: WhatIf) -> None:
    """The page marks it."""
    assert {name: values[1] for name, values in grid.values.items()} == pytest.approx(GAINS, rel=1e-3)


def test_a_gain_that_is_none_is_not_varied() -> None:
    """D in yaw: any factor of nothing is nothing."""
    found = what_if({"P": VEHICLE.P, "D": 0.0}, {}, controller({"D": 0.0}), plants(300.0), controller)
    assert found is not None
    assert list(found.values) == ["P"]


def test_an_unstable_combination_has_no_figures() -> None:
    """The page says so instead."""

    def rebuild(changes: Mapping[str, float]) -> AxisController:
        return controller(
            {name: 100.0 * value if value > VEHICLE.P else value for name, value in changes.items()}
        )

    found = what_if({"P": VEHICLE.P}, {}, controller({}), plants(300.0), rebuild)
    assert found is not None
    assert found.loops[-1] is None


def test_only_the_script_of_the_page_may_run(grid: WhatIf) -> None:
    """By its hash; without a grid there is none."""
    assert what_if_parts({"roll": grid})["script_hash"].startswith("'sha256-")
    assert not what_if_parts({})["script"]
