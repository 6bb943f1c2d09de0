"""An axis that speeds itself up is never called usable."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.diagnose.test_diagnose import judge, logged_at
from tests.identify.vehicles import QUAD, fly, multisine


def test_an_axis_with_positive_damping_is_worth_a_warning() -> None:
    """Its simulation is fed back from the measured rate, and no rotating body gains energy by itself."""
    truth = dataclasses.replace(QUAD, damping=np.diag([-4.0, 1.2, 0.6]))
    data = dataclasses.replace(fly(truth, multisine(60.0), feedback=8.0), sources=logged_at(400.0))
    verdict = judge(data).axes["roll"]
    assert (verdict.verdict, verdict.reasons) == ("caution", ("QL511",))
