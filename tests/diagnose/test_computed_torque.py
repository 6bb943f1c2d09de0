"""Which axes tell that a torque was computed from the rates."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.model import Excitation, TorquePath
from quadid_logs.diagnose.structural_findings import _computed_from_rates

NOTHING = np.zeros(0)


def axis(*, p_value: float, explained: float = 0.95) -> Excitation:
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
        path=path,
    )


FLOWN, COMPUTED = axis(p_value=1.0), axis(p_value=1e-6)


@pytest.mark.parametrize(
    ("axes", "computed"),
    [
        ((FLOWN, FLOWN, FLOWN), False),
        ((COMPUTED, FLOWN, FLOWN), True),
        ((FLOWN, COMPUTED, FLOWN), True),
        # Rotors whose reaction leads by as much as they lag look like that in yaw.
        ((FLOWN, FLOWN, COMPUTED), False),
        ((axis(p_value=1e-6, explained=0.2), FLOWN, FLOWN), False),
    ],
)
def test_roll_and_pitch_tell_of_all_axes(axes: tuple[Excitation, ...], computed: bool) -> None:
    """One program computed all columns."""
    assert _computed_from_rates(axes) is computed
