"""What a controller's answer to the air may have taken of an effectiveness, by its set-points."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from quadid_logs.identify.design import build_design
from quadid_logs.identify.structural import _feedback
from quadid_logs.identify.structures import DAMPED
from tests.identify.vehicles import QUAD, fly, multisine


def test_setpoints_are_feedback_as_far_as_they_follow_the_attitude() -> None:
    """Roll holds an attitude, pitch does so for half of its set-point, yaw only commands."""
    built = build_design(fly(QUAD, multisine(20.0)), 5.0, (DAMPED,))
    assert built is not None
    rng = np.random.default_rng(9)
    phi, theta, psi, commanded = rng.standard_normal((4, built.time_s.size))
    design = dataclasses.replace(built, columns=built.columns | {"phi": phi, "theta": theta, "psi": psi})
    fit = SimpleNamespace(r2=np.full(3, 0.8))
    instruments = np.column_stack([-4.0 * phi, 4.0 * (commanded - theta), 4.0 * commanded])
    alone = _feedback(design.without_instruments(), fit)  # type: ignore[arg-type]
    told = _feedback(dataclasses.replace(design, instruments=instruments), fit)  # type: ignore[arg-type]
    assert told / alone == pytest.approx([1.0, 0.5, 0.0], abs=0.05)
