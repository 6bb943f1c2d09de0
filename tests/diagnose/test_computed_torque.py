"""Which axes a torque that was computed from the rates takes with it."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.model import Excitation, TorquePath
from quadid_logs.diagnose.structural_findings import _computed_from_rates

NOTHING = np.zeros(0)


def axis(
    *,
    p_value: float,
    explained: float = 0.95,
    difference_r2: float = 0.6,
) -> Excitation:
    """Return an axis with a path of that p-value."""
    path = TorquePath(
        lag_s=0.0,
        lag_error_s=1e-4,
        roll_off_s2=0.0,
        roll_off_error_s2=1e-6,
        explained=explained,
        p_value=p_value,
    )
    return Excitation(
        axis="roll",
        torque_rms=1.0,
        rate_rms_rad_s=1.0,
        signal_to_noise=9.0,
        frequency_hz=NOTHING,
        rate_psd=NOTHING,
        torque_psd=NOTHING,
        coherence=NOTHING,
        difference_r2=difference_r2,
        path=path,
    )


FLOWN, COMPUTED = axis(p_value=1.0), axis(p_value=1e-6)


@pytest.mark.parametrize(
    ("axes", "computed"),
    [
        ((FLOWN, FLOWN, FLOWN), ()),
        ((COMPUTED, FLOWN, FLOWN), (0, 1, 2)),
        ((FLOWN, COMPUTED, FLOWN), (0, 1, 2)),
        # Rotors whose reaction leads by as much as they lag look like that in yaw.
        ((FLOWN, FLOWN, COMPUTED), ()),
        ((FLOWN, FLOWN, axis(p_value=1e-6, difference_r2=0.99)), (2,)),
        ((axis(p_value=1e-6, explained=0.2), FLOWN, FLOWN), ()),
        # Even the noise of the gyro is in a torque that is a difference of the rates.
        ((FLOWN, axis(p_value=0.3, difference_r2=0.98), FLOWN), (0, 1, 2)),
        ((FLOWN, FLOWN, axis(p_value=0.3, difference_r2=0.98)), ()),
        ((axis(p_value=0.3, difference_r2=float("nan")), FLOWN, FLOWN), ()),
    ],
)
def test_roll_and_pitch_tell_of_all_axes_and_yaw_of_itself(
    axes: tuple[Excitation, ...], computed: tuple[int, ...]
) -> None:
    """One program computed all columns."""
    assert _computed_from_rates(axes) == computed
