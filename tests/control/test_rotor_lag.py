"""Motors driven to their limits: rotors lag, not torques, and the loop is measured and judged with that."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.autopilots import named
from quadid_logs.control.closed_loop import _seen
from quadid_logs.control.frequency_response import Response, acting_torque, lines_of
from quadid_logs.control.prediction import AxisModel, Chirp, _answers, _clusters, _Search
from quadid_logs.data.closed_loop import Estimated, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Actuator
from quadid_logs.data.settings import Settings
from quadid_logs.identify import identify
from quadid_logs.load import prepare
from quadid_logs.simulator import SCENARIOS, fly, manoeuvres, plan_flights
from quadid_logs.simulator.closed_loop import Tuning
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.true_loop import true_plant
from quadid_logs.simulator.truth import flight_truth

RATE_HZ = 280.0


class Flown:
    """A flight of doublets that drive the motors to their limits, with what is true of it."""

    def __init__(self) -> None:
        calm = SCENARIOS["sysid-quad-x"]
        hard = partial(manoeuvres.doublets, amplitude_rad_s=1.6, pulse_s=0.2)
        scenario = replace(calm, manoeuvre=hard, tuning=Tuning(gain=2.0))
        setups = plan_flights(scenario, seed=1, duration_s=20.0, rate_hz=RATE_HZ, autopilot="ardupilot")
        record = fly(setups[0])
        prepared = prepare(log_flights((record,), replace(scenario.logging, rate_hz=RATE_HZ)))
        self.data: FlightData = cut(prepared, Settings().align)
        controllers = named("ardupilot").controllers(prepared.log, prepared.log.parameters)
        assert controllers is not None
        self.controller: AxisController = controllers.axes["pitch"]
        truth = flight_truth((record,), scenario="", boot_s=0.0)
        self.plant: Plant = true_plant(setups[0], truth, 1)
        airframe = setups[0].airframe
        nothing = np.empty((0, 0))
        self.actuator = Actuator(
            lag_s=0.5 * (airframe.lag_up_s + airframe.lag_down_s), lag_ci95_s=(0.0, 1.0),
            delay_s=0.0, delay_ci95_s=(0.0, 1.0), acts_on="rotor speed",
            lag_grid_s=nothing, delay_grid_s=nothing, loss=nothing,
            lag_up_s=airframe.lag_up_s, lag_down_s=airframe.lag_down_s,
        )  # fmt: skip

    def response(self, actuator: Actuator | None) -> Response:
        """The measured vehicle over the true one."""
        lines = lines_of(self.data, 1, self.controller.period_s, actuator)
        assert lines is not None
        ratio = _seen(lines, self.controller, self.plant).ratio
        near = (ratio.frequency_hz > 3.0) & (ratio.frequency_hz < 15.0)
        return Response(ratio.frequency_hz[near], ratio.gain[near], ratio.error[near])

    def effectiveness(self, actuator: Actuator | None) -> Estimated:
        """By the closed loop."""
        chirp = Chirp(at_mixer=False, delay_s=0.0)
        axis = AxisModel(1, self.controller, self.plant, np.zeros((4, 4)), chirp, actuator)
        answers = _answers(self.data, axis)
        torque = np.concatenate([each.segment.torque[:, 1] for each in answers])
        clusters = _clusters(np.concatenate([each.segment.time_s for each in answers]))
        everything = np.ones(torque.size, dtype=bool)
        period_s = self.controller.period_s
        search = _Search(answers, torque, everything, clusters, np.concatenate, period_s)
        return search.effectiveness(self.plant, np.zeros((4, 4)))


@pytest.fixture(scope="module")
def flown() -> Flown:
    return Flown()


def test_the_flight_drives_motors_to_their_limits(flown: Flown) -> None:
    """Otherwise it proves nothing."""
    assert flown.data.input is not None
    assert 0.001 < flown.data.input.saturated_fraction < 0.1


def test_the_measured_response_is_that_of_the_vehicle_behind_rotors_that_lag(flown: Flown) -> None:
    ratio = flown.response(flown.actuator)
    assert ratio.gain.size >= 5
    assert np.abs(np.abs(ratio.gain) - 1.0).max() < 0.06


def test_behind_a_linear_lag_the_same_flight_shows_another_vehicle(flown: Flown) -> None:
    """That is what contradicted good models."""
    assert np.abs(np.abs(flown.response(None).gain) - 1.0).max() > 0.12


def test_the_closed_loop_finds_the_effectiveness_behind_rotors_that_lag(flown: Flown) -> None:
    true = flown.plant.effectiveness[0]
    right, linear = (flown.effectiveness(one).value for one in (flown.actuator, None))
    assert right == pytest.approx(true, rel=0.03)
    assert abs(linear - true) > 2.0 * abs(right - true)


def test_a_lag_that_is_not_that_of_rotors_leaves_the_torque_as_it_is(flown: Flown) -> None:
    """Fitted on the torque, its two sides are not known."""
    (segment, *_) = flown.data.segments
    of_torque = replace(flown.actuator, lag_up_s=float("nan"), lag_down_s=float("nan"))
    assert acting_torque(segment, flown.data, of_torque) is segment.torque


def test_the_model_that_commands_tell_in_gusts_lags_by_the_speed_of_its_rotors() -> None:
    """Its estimate took that into account; a loop that is judged with a linear lag contradicts it."""
    calm = SCENARIOS["sysid-quad-x"]
    scenario = replace(
        calm,
        manoeuvre=partial(manoeuvres.doublets, amplitude_rad_s=1.6, pulse_s=0.2),
        tuning=Tuning(gain=2.0),
        effects=replace(calm.effects, disturbance_rad_s2=(2.0, 2.0, 1.0)),
    )
    (setup, *_) = plan_flights(scenario, seed=1, duration_s=30.0, rate_hz=RATE_HZ, autopilot="ardupilot")
    record = fly(setup)
    data = cut(prepare(log_flights((record,), replace(scenario.logging, rate_hz=RATE_HZ))), Settings().align)
    found = identify(data, Settings().identify)
    assert found.recommended is not None
    actuator = found.recommended.actuator
    assert actuator is not None
    assert found.spectral[0].follows_commands
    assert actuator.acts_on == "rotor speed"
    assert actuator.lag_up_s == actuator.lag_down_s == actuator.lag_s
