"""The noise of the moments that answers to commands are fitted to."""

from __future__ import annotations

import numpy as np

from quadid_logs.data.log import GyroFilter
from quadid_logs.identify.spectral import AxisMoments, SharedActuator, moment_noise
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.block_spectra import BlockSpectra

N_BLOCKS, N_LINES = 12, 80
ROLL_RATE, ROLL_TORQUE = 0, 3


def _axis(values: ComplexArray, told: ComplexArray) -> AxisMoments:
    """Return roll of blocks that do not overlap: each is a run of its own."""
    spectra = BlockSpectra(
        frequency_hz=0.25 * np.arange(2, N_LINES + 2),
        values=values,
        by_slope=np.zeros_like(values),
        start_s=8.0 * np.arange(N_BLOCKS),
        run=np.arange(N_BLOCKS),
        period_s=0.005,
    )
    return AxisMoments(spectra, 0, told, GyroFilter())


def test_two_blocks_that_hold_a_sweep_are_known_to_scatter_as_much_as_all() -> None:
    """What both have in common is no noise, and takes half of what each scatters."""
    rng = np.random.default_rng(0)
    instrument = np.zeros((N_BLOCKS, N_LINES), dtype=np.complex128)
    instrument[3:5] = 1.0
    axis = _axis(np.ones((N_BLOCKS, N_LINES, 15), dtype=np.complex128), instrument)
    lines = np.diff(axis.edges)
    ratios = []
    for _ in range(300):
        error = rng.standard_normal((N_BLOCKS, N_LINES)) + 1j * rng.standard_normal((N_BLOCKS, N_LINES))
        # Of two blocks of unit instruments, and noise of power two in each line.
        ratios.append(moment_noise(axis, instrument, error) / (2.0 * 2.0 * lines))
    assert abs(np.mean(ratios) - 1.0) < 0.05


def test_a_motion_at_one_frequency_makes_noise_at_all() -> None:
    """A hundredth of it, in amplitude, may be anywhere in the octaves: no band is known better than that."""
    values = np.zeros((N_BLOCKS, N_LINES, 15), dtype=np.complex128)
    values[:, 10, ROLL_RATE] = 1.0
    values[:, :, ROLL_TORQUE] = 1.0
    axis = _axis(values, np.ones((N_BLOCKS, N_LINES), dtype=np.complex128))
    actuator = SharedActuator(0.03, 0.0, 0.0)
    axis.instrument_behind(actuator)
    axis.weigh(None, actuator)
    motion = np.sum(np.abs(axis.acceleration) ** 2)
    of_instrument = axis.power(axis.instrument).sum(axis=0)
    assert np.all(axis.noise > (0.01**2 / 8.0) * motion * of_instrument)


def test_what_was_solved_is_solved_anew_under_other_weights() -> None:
    """An estimate weighs its moments by the noise of the one before."""
    rng = np.random.default_rng(0)
    values = rng.standard_normal((N_BLOCKS, N_LINES, 15)) + 1j * rng.standard_normal((N_BLOCKS, N_LINES, 15))
    told = values[:, :, ROLL_TORQUE]
    asked_twice, asked_once = _axis(values, told), _axis(values, told)
    first, then = SharedActuator(0.03, 0.0, 0.0), SharedActuator(0.05, 0.01, 0.0)
    for axis in (asked_twice, asked_once):
        axis.instrument_behind(first)
        axis.weigh(None, first)
        axis.prepare()
    before = asked_twice.solved(then)[0]
    for axis in (asked_twice, asked_once):
        axis.instrument_behind(then)
        axis.weigh(before, then)
        axis.prepare()
    np.testing.assert_array_equal(asked_twice.solved(then)[0], asked_once.solved(then)[0])
