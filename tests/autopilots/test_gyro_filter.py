"""The gyro's filters from parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from quadid_logs.autopilots.ardupilot.filters import parameter_filter as ardupilot_gyro_filter
from quadid_logs.autopilots.px4.filters import parameter_filter as px4_gyro_filter

_FIXED = {
    "INS_HNTCH_ENABLE": 1.0,
    "INS_HNTCH_MODE": 0.0,
    "INS_HNTCH_FREQ": 80.0,
    "INS_HNTCH_BW": 40.0,
    "INS_HNTCH_ATT": 40.0,
    "INS_HNTCH_HMNCS": 3.0,
}


def test_each_harmonic_of_a_fixed_notch_is_one() -> None:
    """Bits 0 and 1: 80 and 160 Hz, of the same Q."""
    first, second = ardupilot_gyro_filter(_FIXED).notches
    assert (first.frequency_hz, second.frequency_hz) == (80.0, 160.0)
    # Two octaves log2(80 / 60) wide: 1 / Q = (2^o - 1) / sqrt(2^o).
    assert first.inverse_q == pytest.approx(80.0 / 60.0 - 60.0 / 80.0)
    assert second.inverse_q == first.inverse_q
    assert first.depth == pytest.approx(0.01)


def test_a_notch_that_follows_the_rotors_is_not_known() -> None:
    """Its frequency is the rotors', which the parameters do not tell."""
    assert ardupilot_gyro_filter(_FIXED | {"INS_HNTCH_MODE": 3.0, "INS_HNTCH_REF": 1.0}).notches == ()


def test_a_notch_that_is_switched_off_is_none() -> None:
    """Its parameters stay in the log."""
    assert ardupilot_gyro_filter(_FIXED | {"INS_HNTCH_ENABLE": 0.0}).notches == ()


def test_a_double_notch_shares_its_width_between_two() -> None:
    """INS_HNTCH_OPTS bit 0."""
    found = ardupilot_gyro_filter(_FIXED | {"INS_HNTCH_HMNCS": 1.0, "INS_HNTCH_OPTS": 1.0}).notches
    assert len(found) == 2
    assert found[0].inverse_q == pytest.approx(80.0 / 70.0 - 70.0 / 80.0)


def test_the_low_pass_is_that_of_the_parameter() -> None:
    """INS_GYRO_FILTER and IMU_GYRO_CUTOFF are cut-offs in hertz."""
    assert ardupilot_gyro_filter({"INS_GYRO_FILTER": 40.0}).low_pass_hz == 40.0
    assert px4_gyro_filter({"IMU_GYRO_CUTOFF": 30.0}).low_pass_hz == 30.0


def test_notches_count_without_a_low_pass() -> None:
    """INS_GYRO_FILTER 0 switches the low-pass off, and nothing else."""
    found = ardupilot_gyro_filter(_FIXED | {"INS_GYRO_FILTER": 0.0})
    assert math.isnan(found.low_pass_hz)
    assert len(found.notches) == 2


def test_px4_has_two_notches_of_infinite_depth() -> None:
    """IMU_GYRO_NF0 and NF1; a frequency of 0 is none."""
    parameters = {
        "IMU_GYRO_NF0_FRQ": 90.0,
        "IMU_GYRO_NF0_BW": 20.0,
        "IMU_GYRO_NF1_FRQ": 0.0,
        "IMU_GYRO_NF1_BW": 20.0,
    }
    (notch,) = px4_gyro_filter(parameters).notches
    assert notch == (90.0, pytest.approx(20.0 / 90.0), 0.0)


@example({"INS_HNTCH_BW": 6.2e-204})
@example({"INS_HNTCH_ATT": 4.7e-299})
@given(
    st.dictionaries(
        st.sampled_from(
            [
                *_FIXED,
                "INS_HNTCH_OPTS",
                "INS_HNTCH_REF",
                "IMU_GYRO_NF0_FRQ",
                "IMU_GYRO_NF0_BW",
            ]
        ),
        st.floats(),
    )
)
def test_no_parameter_makes_a_notch_that_is_no_number(parameters: dict[str, float]) -> None:
    """Logs hold anything: NaN, infinities, negative widths."""
    for notch in (*ardupilot_gyro_filter(_FIXED | parameters).notches, *px4_gyro_filter(parameters).notches):
        assert all(map(math.isfinite, notch))
        assert notch.frequency_hz > 0.0
        assert notch.inverse_q > 0.0
        assert 0.0 <= notch.depth < 1.0
        assert np.isfinite(1.0 / notch.frequency_hz)
