"""What is said of the model on flight that it was not fitted to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from quadid_logs.data.model import SpectralFit
from quadid_logs.report.view import _validation_sentence
from tests.synthetic_results import usable_result


def test_an_axis_is_told_by_its_own_simulation_as_its_verdict_is() -> None:
    """A refused yaw drags roll away where all are simulated together: 'nothing of roll' beside 'usable'."""
    model = usable_result().identification.recommended
    assert model is not None
    validation = replace(
        model.validation,
        r2_simulated_rate={"p": -3.0, "q": -2.0, "r": -9.0},
        r2_high_passed_rate={"p": 0.92, "q": 0.9, "r": -1.0},
    )
    text = _validation_sentence(replace(model, validation=validation))
    assert text.endswith("reproduce 92 % of roll, 90 % of pitch and nothing of yaw.")


def test_an_axis_that_its_commands_tell_is_judged_by_them() -> None:
    """Beside "usable", that the simulation explains little of it needs a word."""
    fit = SpectralFit(
        mean=np.ones(5),
        covariance=np.eye(5),
        departure=0.03,
        commanded=0.9,
        r2_commanded=0.984,
        n_blocks=20,
        half_width=0.1,
        used=True,
    )
    model = usable_result().identification.recommended
    text = _validation_sentence(model, (fit, replace(fit, used=False)))
    assert text.endswith("Of the commanded acceleration, the model explains 98.4 % of roll.")
