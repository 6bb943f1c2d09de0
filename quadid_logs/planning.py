"""A flight that will give an answer: what to set, what to fly, and what a simulation of it gives."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.counting import counted
from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.model import Identification
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose import diagnose
from quadid_logs.diagnose.advice import advice_for, plannable
from quadid_logs.errors import SettingsError
from quadid_logs.identify import identify
from quadid_logs.load import prepare
from quadid_logs.simulate import Scenario, fly, plan_flights
from quadid_logs.simulate.airframes import SimulatedAirframe, hexa_x, octa_coaxial, quad_x
from quadid_logs.simulate.logger import log_flights
from quadid_logs.simulate.manoeuvres import Reference, doublets
from quadid_logs.simulate.sweep import Sweep, sweeps_in_turn
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice, Setting, Version

#: Before and after the manoeuvre: take-off, climb, landing, as simulated.
_AROUND_S = 12.0
#: What a second person needs to load the next axis at the ground station; a pilot alone lands for it.
_PAUSE_S = 6.0
#: Stick doublets: a third of the stick for 0.4 s each way, 30 s per axis.
_DOUBLET_RAD_S, _DOUBLET_S, _DOUBLETS_PER_AXIS_S = 0.7, 0.4, 30.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Plan:
    """A flight to fly.

    Attributes
    ----------
    autopilot : str
        As in `FlightLog.autopilot`.
    version : tuple of int, or None
        Of its firmware, None for a recent one.
    axes : tuple of str
    sweeps : mapping of str to Sweep
        By axis, where the autopilot sweeps by itself; else empty, and the pilot flies doublets.
    duration_s : float
        From take-off to landing.
    parameters : mapping of str to float
        Of the vehicle; empty where they are not known.
    """

    autopilot: str
    version: Version | None
    axes: tuple[str, ...]
    sweeps: Mapping[str, Sweep]
    duration_s: float
    parameters: Mapping[str, float] = field(default_factory=dict)

    @property
    def advice(self) -> Advice:
        """What the autopilot's folder knows of setting and flying it."""
        return advice_for(self.autopilot)

    @property
    def logging(self) -> tuple[Setting, ...]:
        """Parameters that make the autopilot log enough: the vehicle's own with what they lack."""
        return self.advice.logging_values(self.parameters)

    @property
    def logging_back(self) -> tuple[Setting, ...]:
        """The same parameters as the vehicle has them, where that is known."""
        return tuple((name, self.parameters[name]) for name, _ in self.logging if name in self.parameters)

    def settings_of(self, axis: str) -> tuple[Setting, ...]:
        """Return the parameters of an axis' sweep, in the order in which they are to be set."""
        return self.advice.sweep_settings(axis, dataclasses.asdict(self.sweeps[axis]))

    def steps(self) -> tuple[str, ...]:
        """Return what to fly, in order."""
        return self.advice.steps(
            self.axes, {axis: dataclasses.asdict(each) for axis, each in self.sweeps.items()}
        )

    def __repr__(self) -> str:
        version = "" if self.version is None else " " + ".".join(map(str, self.version))
        flown = counted(len(self.sweeps), "sweep") if self.sweeps else "stick doublets"
        return (
            f"<Plan for {self.autopilot}{version}: {', '.join(self.axes)}, {self.duration_s:.0f} s, {flown}>"
        )

    def predict(self, vehicle: Vehicle | None = None) -> Prediction:
        """Return what a simulated flight of the plan gives; see `quadid_logs.planning.predict`."""
        return predict(self, vehicle)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Prediction:
    """What came out of the simulated flight, and the vehicle that flew it."""

    vehicle: str
    identification: Identification
    diagnosis: Diagnosis

    def __repr__(self) -> str:
        axes = ", ".join(f"{axis} {found.verdict}" for axis, found in self.diagnosis.axes.items())
        return f"<Prediction on {self.vehicle!a}: {axes}>"


def make_plan(
    autopilot: str,
    axes: Sequence[str] = (),
    version: Version | None = None,
    parameters: Mapping[str, float] = MappingProxyType({}),
) -> Plan:
    """Plan a flight.

    Parameters
    ----------
    autopilot : str
        One of `diagnose.advice.plannable`.
    axes : sequence of str
        Of roll, pitch, yaw; empty means all.
    version : tuple of int, optional
        Of the firmware; without, a recent one.
    parameters : mapping of str to float
        Of the vehicle, where they are known.

    Returns
    -------
    Plan

    Raises
    ------
    SettingsError
        If there is no such autopilot or axis.

    Examples
    --------
    >>> plan = make_plan(plannable()[-1], ["roll"])
    >>> plan.axes, plan.duration_s
    (('roll',), 42.0)
    """
    unknown = [axis for axis in axes if axis not in AXES]
    if unknown:
        raise SettingsError(f"There is no axis {unknown[0]!r}.", hint=f"Choose of {', '.join(AXES)}.")
    if autopilot not in plannable():
        raise SettingsError(
            f"There is no plan for {autopilot!r}.", hint=f"Choose one of {', '.join(plannable())}."
        )
    chosen = tuple(axis for axis in AXES if not axes or axis in axes)
    magnitudes = advice_for(autopilot).sweep_magnitudes(version)
    sweeps = {axis: Sweep(magnitude=magnitudes[axis]) for axis in chosen if axis in magnitudes}
    flown_s = sum(sweep.record_s + _PAUSE_S for sweep in sweeps.values())
    return Plan(
        autopilot=autopilot,
        version=version,
        axes=chosen,
        sweeps=MappingProxyType(sweeps),
        duration_s=_AROUND_S + (flown_s or _DOUBLETS_PER_AXIS_S * len(chosen)),
        parameters=parameters,
    )


def parse_version(text: str) -> Version:
    """Return the numbers of a firmware's version.

    Parameters
    ----------
    text : str

    Returns
    -------
    tuple of int

    Raises
    ------
    SettingsError
        If the text is none.

    Examples
    --------
    >>> parse_version("v4.5.7")
    (4, 5, 7)
    """
    numbers = text.removeprefix("v").removeprefix("V").split(".")
    if not all(number.isascii() and number.isdigit() and len(number) < 5 for number in numbers):
        raise SettingsError(f"{text[:40]!r} is no version of a firmware.", hint="Give it as 4.5 or 4.5.7.")
    return tuple(int(number) for number in numbers)


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
        diagnosis=diagnose(log, data, identification),
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
