"""A page of recommended gains, made up: one axis changes, one is kept, one is refused."""

from __future__ import annotations

import numpy as np

from quadid_logs.data.closed_loop import Estimated, LoopMargins, Margins
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.tuning import GOOD, AxisTuning, GainChange, Tuning
from quadid_logs.data.what_if import WhatIf, WhatIfLoop
from quadid_logs.diagnose.findings import finding
from quadid_logs.report.provenance import Provenance
from quadid_logs.report.tune_page import tune_page
from tests.synthetic_results import usable_result

#: Of the grid's loops, in the order of its values: gain margins, and an unstable one.
GAINS_DB = (11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0, None)


_FILTER = finding(
    "QL636", "info", {}, axes=("roll",), title="A filter, not the gain, limits roll: with GYRO at 40 Hz"
)


def _margins(gain_db: float) -> LoopMargins:
    figures = {
        name: Estimated(value, (0.95 * value, 1.05 * value))
        for name, value in (
            ("gain_margin_db", gain_db),
            ("phase_margin_deg", 50.0),
            ("disk_margin", 0.8),
            ("crossover_hz", 4.0),
            ("oscillation_hz", 14.0),
        )
    }
    whole = Margins(stable=True, stable_fraction=1.0, extrapolated=False, **figures)
    return LoopMargins(rate=whole, full=whole)


def _grid() -> WhatIf:
    time_s = np.linspace(0.0, 0.5, 20)
    loops = (
        None if gain is None else WhatIfLoop(gain, 50.0, 0.05, 10.0, 1.0 - np.exp(-gain * time_s))
        for gain in GAINS_DB
    )
    values = {"ATC_RAT_RLL_P": (0.07, 0.1, 0.14), "INS_GYRO_FILTER": (20.0, 40.0, 80.0)}
    return WhatIf(values=values, time_s=time_s, loops=tuple(loops))


def _told(code: str, axis: str, **evidence: object) -> tuple[Finding, ...]:
    return (finding(code, "info", evidence, axes=(axis,)),)


def synthetic_tune_page() -> str:
    """Return the page."""
    gains = {f"ATC_RAT_RLL_{one}": GainChange(0.1, 0.13, 0.2) for one in "PID"}
    roll = AxisTuning(
        verdict="change", gains=gains,
        reasons=(*_told("QL631", "roll", factor=1.3, target_factor=2.0), _FILTER),
        now=_margins(15.0), next=_margins(13.0),
        attitude_error=0.75, torque_noise=0.01, torque_noise_next=0.012,
    )  # fmt: skip
    pitch = AxisTuning(verdict="keep", reasons=_told("QL634", "pitch"), now=_margins(9.0), next=_margins(9.0))
    yaw = AxisTuning(verdict="refused", reasons=_told("QL614", "yaw", known_to_hz=5.0), now=_margins(9.0))
    tuning = Tuning(axes={"roll": roll, "pitch": pitch, "yaw": yaw}, limits=GOOD)
    nowhere = Provenance(version="0", command="quadid-log tune flight.bin", log_sha256="")
    result = usable_result()
    assert result.closed_loop is not None
    curve = result.closed_loop.axes["roll"].curve
    assert curve is not None
    grids = {"roll": _grid(), "pitch": _grid()}
    return tune_page(result, tuning, nowhere, grids=grids, following={"roll": curve})
