"""Every named scenario, written to a file and analyzed, gets the verdict that its truth demands."""

from __future__ import annotations

import json
import pickle
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from quadid_logs import pipeline
from quadid_logs import simulate as simulator
from quadid_logs.simulate import SCENARIOS, Record, Setup, Simulation, fly, simulate
from quadid_logs.simulate.damage import damage_bytes
from quadid_logs.writers import write_log

AXES = ("roll", "pitch", "yaw")
#: Of each flight: half of what a scenario flies by itself, for half the time of the tests [s].
FLIGHT_S = 30.0
Flown = tuple[str, Simulation]


@lru_cache(maxsize=16)
def _record(setup: bytes) -> Record:
    """Fly once what several scenarios log differently."""
    return fly(pickle.loads(setup))


def _fly(setup: Setup) -> Record:
    return _record(pickle.dumps(setup))


@pytest.fixture(scope="module", params=sorted(SCENARIOS))
def flown(request: pytest.FixtureRequest) -> Flown:
    """Return a scenario's name and its flight, for both claims about it."""
    name = str(request.param)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(simulator, "fly", _fly)
        return name, simulate(name, seed=3, duration_s=FLIGHT_S * SCENARIOS[name].n_flights)


def test_every_scenario_flies_and_its_truth_is_json(flown: Flown) -> None:
    """Each has a log with rates and torques, and a truth without NaN."""
    name, flight = flown
    assert {"body_rate", "torque_command", "attitude", "armed"} <= set(flight.log.signals)
    assert json.loads(json.dumps(flight.truth, allow_nan=False))["scenario"] == name
    assert set(SCENARIOS[name].verdicts) == {"roll", "pitch", "yaw"}
    assert SCENARIOS[name].sentence.endswith(".")


def test_a_usable_axis_has_the_true_gain_and_the_others_are_not_usable(flown: Flown, tmp_path: Path) -> None:
    """Truth -> file -> verdict: "usable" means within 5 %, and no axis beyond what its flight allows."""
    _, flight = flown
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
