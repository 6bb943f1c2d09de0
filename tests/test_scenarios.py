"""Every named scenario, written to a file and analyzed, gets the verdict that its truth demands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from quadid_logs import pipeline
from quadid_logs.simulate import SCENARIOS, simulate
from quadid_logs.simulate.damage import damage_bytes
from quadid_logs.writers import write_log

AXES = ("roll", "pitch", "yaw")
#: Of each flight: half of what a scenario flies by itself, for half the time of the tests [s].
FLIGHT_S = 30.0


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_a_usable_axis_has_the_true_gain_and_the_others_are_not_usable(name: str, tmp_path: Path) -> None:
    """Truth -> file -> verdict: "usable" means within 5 %, and no axis beyond what its flight allows."""
    flight = simulate(name, seed=3, duration_s=FLIGHT_S * SCENARIOS[name].n_flights)
    path = tmp_path / "flight.bin"
    write_log(flight.log, path)
    if flight.damage:
        path.write_bytes(damage_bytes(path.read_bytes(), flight.damage, seed=3))
    result = pipeline.analyze(path)
    truth = np.diag(np.array(flight.truth["models"]["damped"]["B"]))
    model = result.identification.recommended
    for number, axis in enumerate(AXES):
        verdict = result.diagnosis.axes[axis].verdict
        assert verdict in flight.truth["expected_verdicts"][axis], result.diagnosis.findings
        if verdict == "usable":
            assert model is not None
            assert model.B[number, number] == pytest.approx(truth[number], rel=0.05)
