"""Betaflight's torque in units of the PID sums, however coarsely the log holds their terms."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from quadid_logs.align.series import CleanSeries
from quadid_logs.autopilots.betaflight.airframe import find_airframe
from quadid_logs.autopilots.betaflight.signals import TO_FRD, middle
from quadid_logs.autopilots.betaflight.torque import rebuild
from quadid_logs.maths.recurrence import lag
from tests.autopilots.test_betaflight import MIX, mixed, rows_of

N_ROWS, STEPS = 20_000, 1889.0


class Flown:
    """A cleaned log of one long flight in airmode."""

    log = SimpleNamespace(autopilot="betaflight", parameters={"features": float(1 << 22)}, version=(2026, 12))

    def __init__(self, **signals: np.ndarray) -> None:
        self._signals = {name: rows_of(values) for name, values in signals.items()}

    def first(self, name: str) -> CleanSeries | None:
        """Return the source of a signal."""
        return self._signals.get(name)

    def flown(self, time_s: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Say that all of it was flown."""
        return np.ones(len(time_s), np.bool_)


def torque_per_sum(
    rms: float, logged: Callable[[np.ndarray], np.ndarray], range_left: float = 1.0
) -> np.ndarray:
    """Fly four terms of this size, in thousandths, through the mixer; return the torque over their sum."""
    random = np.random.default_rng(1)
    terms = lag(random.normal(size=(N_ROWS, 12)), 1e-3, 0.0125).reshape(N_ROWS, 4, 3)
    terms *= rms / terms.std()
    sums = terms.sum(axis=1) / 1000.0
    log = Flown(
        motor_thrust=np.rint(STEPS * range_left * (0.3 + sums @ MIX.T)) / STEPS,
        throttle=np.full((N_ROWS, 1), 0.3),
        torque_command=logged(terms).sum(axis=1) / 1000.0 * TO_FRD,
    )
    (series,) = rebuild(log, find_airframe(mixed(MIX))).series
    regressors = np.column_stack([sums * TO_FRD, np.ones(N_ROWS)])
    return np.diag(np.linalg.lstsq(regressors, series.command, rcond=None)[0][:3])


def exact(terms: np.ndarray) -> np.ndarray:
    """As no log has them."""
    return terms


def rounded(terms: np.ndarray) -> np.ndarray:
    """As since 4.4."""
    return np.rint(terms)


def cut(terms: np.ndarray) -> np.ndarray:
    """As before, read as the reader does."""
    return middle(np.trunc(terms), cut=True)


@pytest.mark.parametrize("logged", [rounded, cut])
@pytest.mark.parametrize("rms", [0.6, 2.0, 20.0])
def test_a_unit_of_torque_is_that_of_the_pid_sums_however_coarse_their_terms(
    rms: float, logged: Callable[[np.ndarray], np.ndarray]
) -> None:
    """On a light copter, or in a gentle flight, rounding is much of a term."""
    np.testing.assert_allclose(torque_per_sum(rms, logged) / torque_per_sum(rms, exact), 1.0, atol=0.01)


def test_outputs_of_less_range_than_the_header_says_make_the_torque_of_the_sums() -> None:
    """As with sag compensation, which leaves full batteries less: terms that are not coarse tell."""
    found = torque_per_sum(20.0, rounded, range_left=0.9) / torque_per_sum(20.0, exact)
    np.testing.assert_allclose(found, 1.0, atol=0.01)
