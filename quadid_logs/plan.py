"""A flight that will give an answer: what to set, what to fly, and what a simulation of it gives."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Final

import numpy as np

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose import diagnose
from quadid_logs.diagnose.advice import (
    ATTITUDE_FAST,
    DEFAULT_LOG_BITMASK,
    SDLOG_PROFILE,
    SID_AXIS,
    SID_MAGNITUDE,
)
from quadid_logs.errors import SettingsError
from quadid_logs.identify import identify
from quadid_logs.load import prepare
from quadid_logs.simulate import Scenario, fly, plan_flights
from quadid_logs.simulate.airframes import SimulatedAirframe, hexa_x, octa_coaxial, quad_x
from quadid_logs.simulate.logger import log_flights
from quadid_logs.simulate.manoeuvres import Reference, doublets
from quadid_logs.simulate.sweep import Sweep, sweeps_in_turn
from quadid_logs.vocabulary import AXES

#: Before and after the manoeuvre: take-off, climb, landing, as simulated.
_AROUND_S = 12.0
#: What a pilot needs to choose the next axis on the ground station.
_PAUSE_S = 6.0
#: Stick doublets: a third of the stick for 0.4 s each way, 30 s per axis.
_DOUBLET_RAD_S, _DOUBLET_S, _DOUBLETS_PER_AXIS_S = 0.7, 0.4, 30.0

Setting = tuple[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A flight to fly.

    Attributes
    ----------
    autopilot : str
        "ardupilot" or "px4".
    axes : tuple of str
    sweeps : mapping of str to Sweep
        By axis, where the autopilot sweeps by itself; else empty, and the pilot flies doublets.
    duration_s : float
        From take-off to landing.
    logging : tuple of (name, value)
        Parameters that make the autopilot log enough.
    """

    autopilot: str
    axes: tuple[str, ...]
    sweeps: Mapping[str, Sweep]
    duration_s: float
    logging: tuple[Setting, ...]

    def settings_of(self, axis: str) -> tuple[Setting, ...]:
        """Return the parameters of an axis' sweep, SID_AXIS first: it shows the others."""
        sweep = self.sweeps[axis]
        return (
            ("SID_AXIS", float(SID_AXIS[axis])),
            ("SID_MAGNITUDE", sweep.magnitude),
            ("SID_F_START_HZ", sweep.start_hz),
            ("SID_F_STOP_HZ", sweep.stop_hz),
            ("SID_T_FADE_IN", sweep.fade_in_s),
            ("SID_T_REC", sweep.record_s),
            ("SID_T_FADE_OUT", sweep.fade_out_s),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """What came out of the simulated flight, and the vehicle that flew it."""

    vehicle: str
    identification: Identification
    diagnosis: Diagnosis


def make_plan(autopilot: str, axes: Sequence[str] = ()) -> Plan:
    """Plan a flight.

    Parameters
    ----------
    autopilot : str
        "ardupilot" or "px4".
    axes : sequence of str
        Of roll, pitch, yaw; empty means all.

    Returns
    -------
    Plan

    Raises
    ------
    SettingsError
        If there is no such autopilot or axis.

    Notes
    -----
    ArduCopter's parameters and their ranges are those of mode_systemid.cpp
    (SID_AXIS 10 to 12: mixer roll, pitch, yaw); LOG_BITMASK's bit 0 is
    ATTITUDE_FAST. PX4's SDLOG_PROFILE 25 is default (1), system
    identification (8) and high rate (16).
    """
    unknown = [axis for axis in axes if axis not in AXES]
    if unknown:
        raise SettingsError(f"There is no axis {unknown[0]!r}.", hint=f"Choose of {', '.join(AXES)}.")
    if autopilot not in _LOGGING:
        raise SettingsError(
            f"There is no plan for {autopilot!r}.", hint=f"Choose one of {', '.join(_LOGGING)}."
        )
    chosen = tuple(axis for axis in AXES if not axes or axis in axes)
    sweeps = {axis: Sweep(magnitude=SID_MAGNITUDE[axis]) for axis in chosen if autopilot == "ardupilot"}
    flown_s = sum(sweep.record_s + _PAUSE_S for sweep in sweeps.values())
    return Plan(
        autopilot=autopilot,
        axes=chosen,
        sweeps=MappingProxyType(sweeps),
        duration_s=_AROUND_S + (flown_s or _DOUBLETS_PER_AXIS_S * len(chosen)),
        logging=_LOGGING[autopilot],
    )


_LOGGING: Final[Mapping[str, tuple[Setting, ...]]] = MappingProxyType(
    {
        "ardupilot": (("LOG_BITMASK", float(DEFAULT_LOG_BITMASK | ATTITUDE_FAST)),),
        "px4": (("SDLOG_PROFILE", float(SDLOG_PROFILE)),),
    }
)


def predict(plan: Plan, vehicle: Vehicle | None = None) -> Prediction:
    """Fly the plan in the simulator, in calm air, and analyze its log.

    Parameters
    ----------
    plan : Plan
    vehicle : Vehicle, optional
        What is known replaces the simulated vehicle's; its calibration is used as `analyze` would.

    Returns
    -------
    Prediction

    Raises
    ------
    SimulationError
        If the vehicle cannot fly.
    """
    scenario = Scenario(
        name="plan",
        sentence="The planned flight.",
        airframe=partial(_airframe, 0 if vehicle is None else len(vehicle.rotors)),
        manoeuvre=partial(_manoeuvre, plan),
        duration_s=plan.duration_s,
    )
    setups = plan_flights(
        scenario,
        seed=0,
        duration_s=scenario.duration_s,
        rate_hz=scenario.logging.rate_hz,
        vehicle=vehicle,
        autopilot=plan.autopilot,
    )
    settings = Settings()
    prepared = prepare(log_flights(tuple(fly(setup) for setup in setups), scenario.logging), vehicle)
    log, data = prepared.log, cut(prepared, settings.align)
    identification = identify(data, settings.identify)
    return Prediction(
        vehicle=setups[0].airframe.name,
        identification=identification,
        diagnosis=diagnose(log, data, identification, settings),
    )


def _airframe(n_rotors: int) -> SimulatedAirframe:
    """Return the simulated vehicle with that number of rotors, a quadrotor if it is not known."""
    makers = {0: quad_x, 4: quad_x, 6: hexa_x, 8: octa_coaxial}
    return makers.get(n_rotors, quad_x)()


def _manoeuvre(plan: Plan, time_s: FloatArray, rng: np.random.Generator) -> Reference:
    """Return the references of the planned flight."""
    if plan.sweeps:
        order = [(AXES.index(axis), plan.sweeps[axis]) for axis in plan.axes]
        return sweeps_in_turn(time_s, rng, sweeps=order, pause_s=_PAUSE_S)
    flown = doublets(time_s, rng, amplitude_rad_s=_DOUBLET_RAD_S, pulse_s=_DOUBLET_S)
    wanted = np.array([axis in plan.axes for axis in AXES])
    return dataclasses.replace(flown, rate_rad_s=flown.rate_rad_s * wanted)
