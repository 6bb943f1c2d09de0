"""Held-out flight is flight that no fit has seen."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.identify.design import Design, build_design, lay_blocks
from quadid_logs.identify.structures import DAMPED
from quadid_logs.maths.band import gaussian_reach_s

from .vehicles import QUAD, fly, multisine


@pytest.fixture(scope="module")
def flight() -> FlightData:
    return fly(QUAD, multisine(60.0), feedback=8.0)


@pytest.fixture(scope="module")
def design(flight: FlightData) -> Design:
    found = build_design(flight, 5.0)
    assert found is not None
    return found


def with_torque_unknown_to_the_log(flight: FlightData, design: Design) -> FlightData:
    """Take from the logged torque what moved the vehicle well inside the held-out blocks, and only there."""
    (segment,) = flight.segments
    inside = np.zeros(segment.n_samples, dtype=bool)
    for number in np.unique(design.block[design.held_out]):
        time_s = design.time_s[design.block == number]
        # Further from their ends than the kernel and the actuator's memory reach.
        inside |= (segment.time_s > time_s[0] + 0.6) & (segment.time_s < time_s[-1] - 1.0)
    wave = np.sin(2.0 * np.pi * 1.3 * segment.time_s)[:, np.newaxis] * np.array([1.0, 1.0, 1.0])
    hidden = 1.5 * segment.torque.std(axis=0) * wave * inside[:, np.newaxis]
    changed = dataclasses.replace(segment, torque=segment.torque + hidden)
    return dataclasses.replace(flight, segments=(changed,))


@pytest.fixture(scope="module")
def models(flight: FlightData, design: Design) -> tuple[Model, Model]:
    """Of the flight, and of the same flight with an unmodelled torque in the held-out blocks alone."""
    flights = (flight, with_torque_unknown_to_the_log(flight, design))
    plain, pushed = (identify(each, IdentifySettings(), (DAMPED,)).models[0] for each in flights)
    return plain, pushed


@pytest.mark.thorough
def test_an_unmodelled_torque_in_held_out_blocks_shows_in_held_out_r2(models: tuple[Model, Model]) -> None:
    """Over all rows, most of which are fitted, R2 would stay above 0.5."""
    plain, pushed = models
    assert min(plain.validation.r2_acceleration.values()) > 0.98
    assert max(pushed.validation.r2_acceleration.values()) < 0.5


def test_an_unmodelled_torque_in_held_out_blocks_leaves_the_fit_as_it_is(
    models: tuple[Model, Model],
) -> None:
    """Otherwise it was no held-out flight."""
    plain, pushed = models
    np.testing.assert_allclose(np.diag(pushed.B), np.diag(plain.B), rtol=0.005)


def test_no_row_is_both_fitted_and_held_out(design: Design) -> None:
    """And there are rows of both kinds."""
    assert design.train.any()
    assert design.held_out.any()
    assert not (design.train & design.held_out).any()


@pytest.mark.parametrize("n_chunks", [1, 3])
def test_no_fitted_row_lies_within_the_kernels_reach_of_a_held_out_one(n_chunks: int) -> None:
    """Of the same chunk: across a gap no kernel reaches."""
    chunk = np.repeat(np.arange(n_chunks), 3000 // n_chunks)
    period_s, reach_s = 0.02, 0.35
    _, held_out, edge = lay_blocks(chunk, period_s, reach_s)
    train = ~(held_out | edge)
    for number in range(n_chunks):
        own = np.flatnonzero(train & (chunk == number))
        others = np.flatnonzero(held_out & (chunk == number))
        assert own.size
        assert others.size
        assert np.abs(own[:, np.newaxis] - others).min() * period_s >= reach_s


def test_about_a_third_of_a_flight_is_held_out_in_blocks_of_five_seconds() -> None:
    """Of five minutes, to a block; each block whole."""
    block, held_out, _ = lay_blocks(np.zeros(15_000, dtype=np.int64), 0.02, 0.35)
    assert np.mean(held_out) == pytest.approx(0.3, abs=5.0 / 300.0)
    lengths = np.bincount(block) * 0.02
    np.testing.assert_allclose(lengths[:-1], 5.0)
    for number in np.unique(block):
        assert np.unique(held_out[block == number]).size == 1


def test_what_happens_at_held_out_rows_reaches_no_fitted_row(flight: FlightData, design: Design) -> None:
    """Rates set to nonsense there leave the fitted rows as they are, to a thousandth of the nonsense."""
    (segment,) = flight.segments
    near = np.abs(segment.time_s[:, np.newaxis] - design.time_s[design.held_out]).min(axis=1)
    nonsense = segment.body_rate_rad_s + 100.0 * (near < 0.5 * design.period_s)[:, np.newaxis]
    changed = dataclasses.replace(segment, body_rate_rad_s=nonsense)
    again = build_design(dataclasses.replace(flight, segments=(changed,)), 5.0)
    assert again is not None
    difference = np.abs(again.columns["p"] - design.columns["p"])
    assert difference[design.train].max() < 0.1
    assert difference[design.held_out].max() > 50.0


def test_the_reach_is_where_the_kernel_has_died_out(design: Design) -> None:
    """At the design's own smoothing: a millionth of its peak."""
    assert gaussian_reach_s(design.smoothing_hz) > 5.0 * np.sqrt(np.log(2.0)) / (2.0 * np.pi * 5.0)
