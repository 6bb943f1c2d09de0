"""Clean series: what the stamps of one message tell is found out once for all its signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.align import series
from quadid_logs.align.clock import find_clock
from quadid_logs.align.series import Cleaner, CleanSeries, TorqueSeries
from quadid_logs.data.log import Signal

from .flights import signal

STAMPS = np.arange(10.0, 20.0, 0.0025)
AS_THEY_ARE = np.arange(STAMPS.size)
SWAPPED = np.r_[0:100, 101, 100, 102 : STAMPS.size]
REPEATED = np.r_[0:200, 199, 200 : STAMPS.size]


def of_one_message(time_s: np.ndarray) -> tuple[Signal, Signal]:
    rates = signal("body_rate", time_s, np.cos(time_s)[:, np.newaxis] * [1.0, 2.0, 3.0])
    torque = Signal(
        name="torque_command",
        rows=rates.rows,
        values=0.1 * rates.values,
        source="RATE",
    )
    return rates, torque


def facts(one: CleanSeries) -> tuple[object, ...]:
    return one.period_s, one.n_duplicate, one.n_out_of_order, one.n_outliers, one.n_not_finite


@pytest.mark.parametrize("rows", [AS_THEY_ARE, SWAPPED, REPEATED, SWAPPED[REPEATED[:-1]]])
def test_signals_that_share_stamps_are_cleaned_as_each_would_be_alone(rows: np.ndarray) -> None:
    """In order, out of order, repeated, and both."""
    signals = of_one_message(STAMPS[rows])
    clock = find_clock(signals)
    together = Cleaner(clock)
    for each in signals:
        shared, alone = together.clean(each), Cleaner(clock).clean(each)
        assert facts(shared) == facts(alone)
        np.testing.assert_array_equal(shared.time_s, alone.time_s)
        np.testing.assert_array_equal(shared.values, alone.values)


def test_a_row_lost_to_one_signal_stays_with_the_other() -> None:
    """Not a number in the rates says nothing about the torque."""
    rates, torque = of_one_message(STAMPS)
    values = rates.values.copy()
    values[50, 1] = np.nan
    cleaner = Cleaner(find_clock([rates, torque]))
    assert cleaner.clean(replace(rates, values=values)).time_s.size == STAMPS.size - 1
    assert cleaner.clean(torque).time_s.size == STAMPS.size


def test_the_stamps_of_one_message_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four signals come from RATE."""
    looked_at = []
    order_of = series._order_of
    monkeypatch.setattr(series, "_order_of", lambda time_s: looked_at.append(1) or order_of(time_s))
    signals = of_one_message(STAMPS)
    cleaner = Cleaner(find_clock(signals))
    for each in signals:
        cleaner.clean(each)
    assert len(looked_at) == 1


def test_of_rows_with_one_stamp_the_last_stands() -> None:
    """It is what the autopilot knew last at that time."""
    stamps = STAMPS.copy()
    stamps[100:103] = stamps[100]
    throttle = signal("throttle", stamps, np.arange(stamps.size)[:, np.newaxis])
    cleaned = Cleaner(find_clock([throttle])).clean(throttle)
    assert cleaned.values[99:102, 0].tolist() == [99.0, 102.0, 103.0]


def test_values_that_no_vehicle_has_take_their_thrust_with_them() -> None:
    """A torque of ten million is dropped, counted, and the thrust beside it with it."""
    values = np.array([[0.1, 0.0, 0.0], [1e7, 0.0, 0.0], [0.3, 0.0, 0.0]])
    torque = signal("torque_command", STAMPS[:3], values)
    one = CleanSeries(
        name="torque_command",
        rows=torque.rows,
        time_s=STAMPS[:3],
        stored=values,
        period_s=0.0025,
        source="RATE",
    )
    found = TorqueSeries(series=one, rotor_thrust=np.array([[1.0], [2.0], [3.0]])).possible()
    assert found.rotor_thrust is not None
    assert (found.rotor_thrust[:, 0].tolist(), found.series.n_not_finite) == ([1.0, 3.0], 1)


def test_numbers_that_were_read_in_single_precision_are_stored_so_and_worked_with_in_double() -> None:
    """Blackbox logs hold whole numbers of few digits: twice their memory would tell nothing more."""
    rates, torque = of_one_message(STAMPS)
    single = replace(rates, values=rates.values.astype(np.float32))
    one = Cleaner(find_clock([rates, torque])).clean(single)
    assert (one.stored.dtype, one.values.dtype) == (np.float32, np.float64)
    assert one.of_rows(slice(0, 2)).dtype == np.float64
    np.testing.assert_array_equal(one.at(one.time_s, 1), one.stored[:, 1].astype(np.float64))
