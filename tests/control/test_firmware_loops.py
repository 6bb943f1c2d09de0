"""Loops of firmware against vehicles whose physics are known: margins, predictions, broken loop."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.control.loop import close, integrators
from quadid_logs.control.margins import grid_hz, margins_of
from quadid_logs.control.posterior import draw
from quadid_logs.data.closed_loop import Margins, Plant
from quadid_logs.data.result import Result
from quadid_logs.fleets.per_flight import analyze_flights
from quadid_logs.vocabulary import AXES
from tests.analyses import Analyzed
from tests.marks import thorough

AP, PX4 = "ac47_quadx_multisine.BIN", "px4_quad_multisine.ulg"


def true_plant(corpus: Path, name: str, axis: str) -> Plant:
    """Return the simulator's vehicle; its motors act at once, or with a lag of the first order.

    As it was on the average of the flight: the effectiveness of yaw goes with throttle there.
    """
    truth = json.loads((corpus / "firmware" / name).with_suffix(".truth.json").read_text())
    number = AXES.index(axis)
    if "at_segment_mean" in truth:
        mean = truth["at_segment_mean"]
        B, A, lag_s = mean["B_rad_s2_per_unit"], mean["A_1_s"], 0.0
    else:
        B, A, lag_s = truth["B_rad_s2_per_torque_setpoint"], truth["A_1_s"], truth["motor_lag_effective_s"]
    numbers = (B[number][number], A[number][number], lag_s, 0.0)
    return Plant(*(np.array([value]) for value in numbers))


def true_margins(result: Result, plant: Plant, axis: str) -> tuple[Margins, Margins]:
    assert result.closed_loop is not None
    controller = result.closed_loop.controllers.axes[axis]
    frequency_hz = grid_hz(controller.period_s)
    loop, n = close(controller, plant, frequency_hz), integrators(controller)
    assert loop.full is not None
    no = np.array([False])
    return (
        margins_of(frequency_hz, loop.rate, n, no, 1e9),
        margins_of(frequency_hz, loop.full, n + 1, no, 1e9),
    )


FIXTURES = [thorough(AP, 19.5, 2.9, 20.1, 16.8, 2.5), (PX4, 63.3, 21.6, 2.32, None, None)]


@pytest.mark.parametrize(("name", "phase", "gain", "crossover", "full_phase", "full_gain"), FIXTURES)
def test_the_true_vehicles_margins_are_those_that_were_worked_out_before(
    corpus: Path,
    analyzed: Analyzed,
    name: str,
    phase: float,
    gain: float,
    crossover: float,
    full_phase: float,
    full_gain: float,
) -> None:
    """By other code, from the controllers' equations."""
    rate, full = true_margins(analyzed(corpus / "firmware" / name), true_plant(corpus, name, "roll"), "roll")
    assert rate.phase_margin_deg is not None
    assert rate.gain_margin_db is not None
    assert rate.crossover_hz is not None
    assert rate.phase_margin_deg.value == pytest.approx(phase, abs=0.3)
    assert rate.gain_margin_db.value == pytest.approx(gain, abs=0.1)
    assert rate.crossover_hz.value == pytest.approx(crossover, rel=0.01)
    if full_phase is not None:
        assert full.phase_margin_deg is not None
        assert full.gain_margin_db is not None
        assert full.phase_margin_deg.value == pytest.approx(full_phase, abs=0.3)
        assert full.gain_margin_db.value == pytest.approx(full_gain, abs=0.1)


#: The sensed rate of the simulator's gyro is 0.8 % larger than the true one above 2 Hz ("sensing" of the
#: truth), and the controller flies by the sensed one.
SENSED = 1.0083
#: The mixer clips yaw in a twelfth of the rows of the first flight: its interval does not know of that.
MARGINS = [
    thorough(AP, "roll", True),
    thorough(AP, "pitch", True),
    thorough(AP, "yaw", False),
    (PX4, "roll", True),
    (PX4, "pitch", True),
    (PX4, "yaw", True),
]


@pytest.mark.parametrize(("name", "axis", "covered"), MARGINS)
def test_margins_of_the_identified_vehicle_are_those_of_the_true_one(
    corpus: Path, analyzed: Analyzed, name: str, axis: str, covered: bool
) -> None:
    """Phase within 3 degrees, gain within 0.6 dB, crossover within 4 %; the loop that flew is inside."""
    result = analyzed(corpus / "firmware" / name)
    plant = true_plant(corpus, name, axis)
    flown = true_margins(result, plant.times(SENSED if name == AP else 1.0), axis)
    assert result.closed_loop is not None
    found = result.closed_loop.axes[axis].margins
    assert found is not None
    assert found.full is not None
    for here, there, seen in zip(
        (found.rate, found.full), true_margins(result, plant, axis), flown, strict=True
    ):
        for figure, tolerance in (("phase_margin_deg", 3.0), ("gain_margin_db", 0.6)):
            estimate, truth = getattr(here, figure), getattr(there, figure)
            assert estimate.value == pytest.approx(truth.value, abs=tolerance)
            if covered:
                assert estimate.ci95[0] <= getattr(seen, figure).value <= estimate.ci95[1]
        assert here.crossover_hz is not None
        assert there.crossover_hz is not None
        assert here.crossover_hz.value == pytest.approx(there.crossover_hz.value, rel=0.04)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
@pytest.mark.parametrize(("name", "within"), [thorough(AP, 0.015), (PX4, 0.03)])
def test_the_closed_loop_finds_the_true_effectiveness(
    corpus: Path, analyzed: Analyzed, name: str, within: float, axis: str
) -> None:
    """From set-points and torque alone: no rate was used."""
    result = analyzed(corpus / "firmware" / name)
    assert result.closed_loop is not None
    prediction = result.closed_loop.axes[axis].prediction
    assert prediction is not None
    truth = true_plant(corpus, name, axis).effectiveness[0]
    assert prediction.effectiveness.value == pytest.approx(truth, rel=within)


@pytest.mark.thorough
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_the_set_points_alone_predict_rate_and_torque_of_the_firmware(
    corpus: Path, analyzed: Analyzed, axis: str
) -> None:
    """On parts of the flight that the fit never saw."""
    result = analyzed(corpus / "firmware" / AP)
    assert result.closed_loop is not None
    prediction = result.closed_loop.axes[axis].prediction
    assert prediction is not None
    assert prediction.rate_fit_percent >= 97.0
    assert prediction.torque_fit_percent >= 88.0


def test_the_broken_loop_of_a_system_id_run_is_the_predicted_one(corpus: Path, analyzed: Analyzed) -> None:
    """From 1 to 19 Hz within 3 % and 2 degrees of what the identified vehicle and the parameters make."""
    result = analyzed(corpus / "firmware" / "ac47_quadx_sid_roll.BIN")
    assert result.closed_loop is not None
    model = result.identification.recommended
    assert model is not None
    assert model.posterior is not None
    controller, found = result.closed_loop.controllers.axes["roll"], result.closed_loop.axes["roll"]
    assert found.measured is not None
    assert found.measured.direct
    near = (found.measured.frequency_hz >= 1.0) & (found.measured.frequency_hz <= 19.0)
    plant = draw(model.posterior, 0, controller.period_s, n_draws=0)
    assert plant is not None
    loop = close(controller, plant, found.measured.frequency_hz[near])
    assert loop.full is not None
    off = found.measured.response[near] / loop.full[0]
    assert np.count_nonzero(near) >= 20
    assert found.measured.frequency_hz.max() > 18.0
    assert np.abs(np.abs(off) - 1.0).max() < 0.03
    assert np.degrees(np.abs(np.angle(off))).max() < 2.0


@pytest.mark.thorough
def test_verdicts_hear_the_closed_loop_where_nothing_else_of_it_is_wanted(
    corpus: Path, analyzed: Analyzed
) -> None:
    """The effectiveness that it tells, which may contradict the model; no margin is worked out."""
    whole = analyzed(corpus / "firmware" / AP)
    (short,) = analyze_flights(corpus / "firmware" / AP, whole.settings, None, "verdict")
    assert whole.closed_loop is not None
    assert short.closed_loop is not None
    for axis in ("roll", "pitch"):
        full, part = whole.closed_loop.axes[axis], short.closed_loop.axes[axis]
        assert full.prediction is not None
        assert part.prediction is not None
        assert part.prediction.effectiveness == full.prediction.effectiveness
        assert part.effectiveness == full.effectiveness
        assert (full.margins is None, part.margins) == (False, None)
