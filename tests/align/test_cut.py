"""What is cut out: torque between its samples, saturation around its marks, steps of the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.align import Prepared, assemble, clean, cut
from quadid_logs.align.series import TorqueSeries
from quadid_logs.autopilots import named
from quadid_logs.data.settings import AlignSettings
from quadid_logs.maths import resampling

from .flights import align, flight_log, flown, motion, signal


def prepared(time_s: np.ndarray, *, limited: int = -1, loop_rate_hz: float = 0.0) -> Prepared:
    """Return a log with torque at these times, one row of which is marked as limited."""
    log = flown(time_s)
    cleaned = clean(log)
    torque = cleaned.sources("torque_command")[0]
    marks = np.zeros((torque.n_samples, 3))
    marks[limited] = float(limited >= 0)
    saturated = replace(torque, name="torque_saturation", stored=marks)
    return assemble(log, cleaned, [TorqueSeries(series=torque, saturated=saturated)], loop_rate_hz)


def stairs(rate_hz: float) -> np.ndarray:
    """Return a torque that steps from 0 to 1, logged at a rate, on a grid four times as fine."""
    time_s = np.arange(10.0, 40.0, 1.0 / rate_hz)
    step = np.zeros((time_s.size, 3))
    step[time_s.size // 2 :] = 1.0
    log = flight_log(
        signal("body_rate", time_s, motion(time_s)),
        signal("torque_command", time_s, step),
        signal("throttle", time_s, np.full((time_s.size, 1), 0.4)),
    )
    (segment,) = align(log, AlignSettings(sample_rate_hz=4.0 * rate_hz)).segments
    return segment.torque[:, 0]


def test_torque_of_a_fast_loop_is_held_until_the_next_output() -> None:
    """The motors obey an output until the next one comes: nothing lies between 0 and 1."""
    torque = stairs(250.0)
    assert np.count_nonzero((torque > 0.01) & (torque < 0.99)) == 0


def test_torque_of_a_loop_of_nominal_rate_is_held_however_its_clock_runs() -> None:
    """A loop of 200 Hz measures 199.99 Hz by its own stamps."""
    torque = stairs(199.9)
    assert np.count_nonzero((torque > 0.01) & (torque < 0.99)) == 0


def test_torque_logged_more_slowly_than_any_loop_is_interpolated() -> None:
    """What came between two rows is not known; a straight line is the best guess."""
    torque = stairs(100.0)
    assert np.count_nonzero((torque > 0.01) & (torque < 0.99)) == 3


def test_grid_points_beside_a_saturated_sample_are_marked() -> None:
    """Up to one period away."""
    time_s = np.arange(10.0, 40.0, 0.0025)
    (segment,) = cut(prepared(time_s, limited=5000), AlignSettings()).segments
    marked = segment.time_s[segment.saturated]
    assert np.abs(marked - time_s[5000]).max() == pytest.approx(0.0025, abs=1e-4)


@pytest.mark.parametrize(("loop_rate_hz", "every"), [(400.0, True), (1000.0, False), (0.0, False)])
def test_a_log_as_fast_as_the_loop_holds_every_step(loop_rate_hz: float, every: bool) -> None:
    """400 rows per second are all of 400, some of 1000, and nobody knows where no parameter tells."""
    described = cut(prepared(np.arange(10.0, 40.0, 0.0025), loop_rate_hz=loop_rate_hz), AlignSettings()).input
    assert described is not None
    assert described.every_step is every


@pytest.mark.parametrize(("enabled", "every"), [(0.0, True), (1.0, False)])
def test_a_fast_rate_thread_steps_between_the_rows_of_its_log(enabled: float, every: bool) -> None:
    """The mixer obeys each step of a loop at 1000 Hz, of which a log at 400 Hz does not hold them all."""
    parameters = {"SCHED_LOOP_RATE": 400.0, "FSTRATE_ENABLE": enabled}
    loop_rate_hz = named("ardupilot").loop_rate_hz(parameters)
    described = cut(prepared(np.arange(10.0, 40.0, 0.0025), loop_rate_hz=loop_rate_hz), AlignSettings()).input
    assert described is not None
    assert described.every_step is every


def test_a_segment_costs_what_it_holds_and_not_what_the_log_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten times as many segments read ten times as many samples."""
    looked_at: list[int] = []

    def counted(time_s: np.ndarray, values: np.ndarray, grid_s: np.ndarray) -> np.ndarray:
        looked_at.append(time_s.size)
        return np.zeros((grid_s.size, values.shape[1]))

    monkeypatch.setattr(resampling, "_interpolate", counted)
    monkeypatch.setattr(resampling, "_hold", counted)
    samples = []
    for n_segments in (4, 40):
        looked_at.clear()
        time_s = np.concatenate(
            [10.0 + 3.0 * number + np.arange(250) / 100.0 for number in range(n_segments)]
        )
        assert len(cut(prepared(time_s), AlignSettings()).segments) == n_segments - 2
        samples.append(sum(looked_at) / (n_segments - 2))
    assert samples[1] == pytest.approx(samples[0], rel=0.05)


def test_an_event_minutes_from_other_rows_is_believed() -> None:
    """Disarmed half an hour before the logging of rates began."""
    time_s = np.arange(2000.0, 2030.0, 0.0025)
    log = flown(time_s)
    signals = [each for name in log.signals for each in log.candidates(name)]
    armed = signal("armed", np.array([200.0, 2010.0]), np.array([[0.0], [1.0]]), start=-1000)
    (segment,) = align(flight_log(*signals, armed), AlignSettings()).segments
    assert segment.start_s == pytest.approx(2011.0, abs=0.2)


def test_torque_in_newton_metres_is_preferred_to_a_command() -> None:
    """Where both are known."""
    log = flown(np.arange(10.0, 40.0, 0.0025))
    command = log.candidates("torque_command")[0]
    both = flight_log(
        *(each for name in log.signals for each in log.candidates(name)),
        replace(command, name="torque_n_m", source="calibrated"),
    )
    described = align(both, AlignSettings()).input
    assert described is not None
    assert described.kind == "torque_n_m"


def test_less_than_two_seconds_between_gaps_is_no_segment() -> None:
    """Shorter parts hold no full cycle of the slowest motion."""
    time_s = np.arange(10.0, 40.0, 0.0025)
    kept = (time_s < 20.0) | ((time_s > 20.5) & (time_s < 22.3)) | (time_s > 22.8)
    starts_s = [segment.start_s for segment in align(flown(time_s[kept]), AlignSettings()).segments]
    np.testing.assert_allclose(starts_s, [11.0, 22.8], atol=0.11)
