"""What gyro noise makes of a command that pilots move, too."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from quadid_logs.align import cut
from quadid_logs.control.loop import close
from quadid_logs.control.torque_noise import torque_spectrum
from quadid_logs.data.settings import Settings
from quadid_logs.load import prepare
from quadid_logs.simulator import Scenario, fly, manoeuvres, plan_flights
from quadid_logs.simulator.airframes import quad_x
from quadid_logs.simulator.closed_loop import Noise
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.truth import actuator_truth, model_truth, torque_at_hover

RATE_HZ = 400.0
DOUBLETS = partial(manoeuvres.doublets, amplitude_rad_s=1.5, pulse_s=0.2)
CHIRP = partial(manoeuvres.chirp, amplitude=0.05)
SLOW_STICKS = partial(manoeuvres.sticks, tilt_rad=0.1)


@pytest.mark.parametrize("manoeuvre", [DOUBLETS, SLOW_STICKS, CHIRP], ids=["doublets", "sticks", "chirp"])
def test_what_is_commanded_is_no_noise(manoeuvre: Callable[..., manoeuvres.Reference]) -> None:
    """Above 15 Hz noise n of the gyro comes back as C n / (1 + L), whatever else moves the command.

    Edges of doublets and a chirp hold all frequencies; slow sticks hold next to nothing there.
    """
    quiet = Scenario(name="", sentence="")
    noise = Noise(gyro_rad_s_per_rthz=4e-4)
    scenario = dataclasses.replace(quiet, airframe=quad_x, manoeuvre=manoeuvre, noise=noise)
    (setup,) = plan_flights(scenario, seed=7, duration_s=40.0, rate_hz=RATE_HZ)
    data = cut(prepare(log_flights((fly(setup),), Logging(rate_hz=RATE_HZ))), Settings().align)
    controller = true_controller(setup, 0)
    truth = {
        "models": model_truth(setup.airframe, torque_at_hover(setup)),
        "actuator": actuator_truth(setup),
    }
    plant = true_plant(setup, truth, 0)
    told = torque_spectrum(data, 0, controller, plant)
    assert told is not None

    frequency_hz = np.linspace(15.0, 0.499 * RATE_HZ, 2000)
    loop = close(controller, plant, frequency_hz)
    assert loop.full is not None
    of_noise = loop.rate[0] / plant.response(frequency_hz, controller.period_s)[0] / (1.0 + loop.full[0])
    true = np.sqrt(np.trapezoid(np.abs(of_noise) ** 2, frequency_hz)) * noise.gyro_rad_s_per_rthz
    found = told.deviation(np.ones_like(told.density), told.frequency_hz >= 15.0)
    assert 0.75 < found / true < 1.33
