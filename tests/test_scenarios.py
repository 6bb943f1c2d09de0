"""Every named scenario, written to a file and analyzed, gets the verdict that its truth demands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.pipeline import analyze
from quadid_logs.simulator import SCENARIOS, simulate
from quadid_logs.simulator.damage import damage_bytes
from quadid_logs.vocabulary import ON_AXIS
from quadid_logs.writers import write_log
from tests.marks import thorough_but

AXES = ("roll", "pitch", "yaw")
#: Of each analyzed flight: half of what a scenario flies by itself, for half the time of the tests [s].
FLIGHT_S = 30.0
#: Of each flight that is only flown: the shortest that there is [s].
SHORT_S = 15.0
#: All usable, and none for lack of rate.
ANALYZED = ("sysid-quad-x", "paper")
#: Flown only: a bad card, a clock, several flights, an airframe.
FLOWN = ("damaged", "clock-jump", "two-flights", "octa-coax")


@pytest.mark.parametrize("name", sorted(SCENARIOS))
def test_every_scenario_says_what_it_is_and_which_verdicts_are_right(name: str) -> None:
    """`simulate --list` prints the sentence."""
    assert set(SCENARIOS[name].verdicts) == {"roll", "pitch", "yaw"}
    assert SCENARIOS[name].sentence.endswith(".")


@pytest.mark.parametrize("name", thorough_but((*ANALYZED, *FLOWN), sorted(SCENARIOS)))
def test_every_scenario_flies_and_its_truth_is_json(name: str) -> None:
    """Each has a log with rates and torques, and a truth without NaN."""
    # Those that are analyzed below are flown for both claims.
    duration_s = FLIGHT_S if name in ANALYZED else SHORT_S
    flight = simulate(name, seed=3, duration_s=duration_s * SCENARIOS[name].n_flights)
    assert {"body_rate", "torque_command", "attitude", "armed"} <= set(flight.log.signals)
    assert json.loads(json.dumps(flight.truth, allow_nan=False))["scenario"] == name


@pytest.mark.parametrize("name", thorough_but(ANALYZED, sorted(SCENARIOS)))
def test_a_usable_axis_has_the_true_gain_and_the_others_are_not_usable(
    name: str, tmp_path: Path, verdicts_only: None
) -> None:
    """Truth -> file -> verdict: "usable" means in the interval, or within 5 %."""
    flight = simulate(name, seed=3, duration_s=FLIGHT_S * SCENARIOS[name].n_flights)
    path = tmp_path / "flight.bin"
    write_log(flight.log, path)
    if flight.damage:
        path.write_bytes(damage_bytes(path.read_bytes(), flight.damage, seed=3))
    result = analyze(path)
    truth = np.diag(np.array(flight.truth["models"]["damped"]["B"]))
    model = result.identification.recommended
    for number, axis in enumerate(AXES):
        verdict = result.diagnosis.axes[axis].verdict
        assert verdict in flight.truth["expected_verdicts"][axis], result.diagnosis.findings
        if verdict == "usable":
            assert model is not None
            low, high = model.entries[ON_AXIS[axis]].ci95
            inside = low <= truth[number] <= high
            assert inside or model.B[number, number] == pytest.approx(truth[number], rel=0.05)
