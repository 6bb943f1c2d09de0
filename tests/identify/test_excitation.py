"""How the torque's power lies over the frequencies that are fitted."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.arrays import FloatArray
from quadid_logs.data.model import Excitation
from quadid_logs.identify.excitation import holds_one_frequency, measure_excitation

from .vehicles import PERIOD_S, flight_data


def excitation(*lines: tuple[float, float]) -> Excitation:
    """Of roll, torque the sum of lines of a frequency [Hz] and an amplitude each."""
    time_s = PERIOD_S * np.arange(round(30.0 / PERIOD_S))
    return measured(np.sum([size * np.sin(2.0 * np.pi * hz * time_s) for hz, size in lines], axis=0))


def measured(roll_torque: FloatArray) -> Excitation:
    """Of roll, with no other torque."""
    torque = np.zeros((roll_torque.size, 3))
    torque[:, 0] = roll_torque
    roll, *_ = measure_excitation(
        flight_data(0.1 * torque, torque),
        signal_to_noise=np.ones(3),
        rate_rms_rad_s=np.ones(3),
        band_hz=(0.3, 5.0),
    )
    return roll


def test_drift_below_the_band_is_no_second_frequency() -> None:
    """A trim that wanders says nothing of lag and delay; of two sinusoids each has its half."""
    assert excitation((4.0, 0.1), (0.1, 0.1)).bandwidth < 0.15
    assert excitation((4.0, 0.1), (2.0, 0.1)).bandwidth > 0.2


def test_nor_is_what_the_filter_takes_out() -> None:
    """Above the cut-off the controller makes torque of the gyro's noise."""
    assert excitation((3.0, 0.1), (20.0, 0.2)).bandwidth < 0.1


def test_a_strong_line_with_its_harmonics_is_no_single_frequency() -> None:
    """The torque of yaw doublets has nine tenths of its power about 1 Hz, the rest at several times that."""
    doublets = excitation((1.0, 0.2), (4.0, 0.05))
    assert doublets.line_fraction > 0.9
    assert not holds_one_frequency((doublets,), 0)
    tone = excitation((3.0, 0.2), (4.0, 0.05))
    assert holds_one_frequency((tone,), 0)


def test_beside_a_single_frequency_no_axis_flies_doublets() -> None:
    """A yaw at 1.5 Hz held a tenth at the frequencies of roll and pitch, and its gain was 15 % off."""
    yaw, roll = excitation((1.0, 0.2), (4.0, 0.05)), excitation((3.0, 0.2))
    assert holds_one_frequency(
        (
            roll,
            yaw,
        ),
        1,
    )


def test_the_strongest_line_is_told_with_its_fraction_of_the_power() -> None:
    """Three parts of four, and of the other part the filter takes more."""
    roll = excitation((1.5, 0.3), (3.0, 0.3 / np.sqrt(3.0)))
    assert roll.line_hz == pytest.approx(1.5)
    assert roll.line_fraction == pytest.approx(0.78, abs=0.01)
