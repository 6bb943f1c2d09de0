"""Plans for an identification flight: parameters to set, manoeuvres to fly, and a simulated result."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from quadid_logs.align import cut
from quadid_logs.arrays import FloatArray
from quadid_logs.control.command_units import per_command
from quadid_logs.control.excitation_design import Air, AxisExcitation, design
from quadid_logs.control.torque_noise import residual_spectrum
from quadid_logs.counting import counted
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.diagnosis import Diagnosis
from quadid_logs.data.model import Identification
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose import diagnose
from quadid_logs.diagnose.advice import advice_for, plannable
from quadid_logs.errors import SettingsError
from quadid_logs.identify import identify
from quadid_logs.load import prepare
from quadid_logs.maths.band import gaussian_response
from quadid_logs.maths.multisine import orthogonal
from quadid_logs.simulator import Scenario, fly, plan_flights
from quadid_logs.simulator.airframes import SimulatedAirframe, hexa_x, octa_coaxial, quad_x, scaled
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.effects import disturbance_density
from quadid_logs.simulator.logger import log_flights
from quadid_logs.simulator.manoeuvres import Reference, doublets, hover
from quadid_logs.simulator.sweep import Sweep, sweeps_in_turn
from quadid_logs.simulator.true_loop import nominal_plant, true_controller
from quadid_logs.vocabulary import AXES, ON_AXIS

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice, Setting, Version

#: Time before and after the manoeuvre in the simulation: take-off, climb, landing.
_AROUND_S = 12.0
#: Time that a second person needs to load the next axis at the ground station; a single pilot lands for it.
_PAUSE_S = 6.0
#: Stick doublets: a third of the stick for 0.4 s each way, 30 s per axis.
_DOUBLET_RAD_S, _DOUBLET_S, _DOUBLETS_PER_AXIS_S = 0.7, 0.4, 30.0
#: Relative half width of the 95 % interval of the control effectiveness that a plan is designed for: smaller
#: differences of a gain do not matter in flight. No sweep reduces it below some 5 % (gyro scale, lag model).
WANTED: Final = 0.075
#: Angular acceleration of roll and pitch by disturbances, between 0.3 and 5 Hz [rad/s^2]. It was measured on
#: hovering vehicles in still air, in a breeze, and in wind. Yaw has a third of it.
AIRS: Final[Mapping[str, float]] = MappingProxyType({"calm": 0.15, "breeze": 0.5, "wind": 1.0})
_YAW_IN_AIR: Final = 0.33
#: Propellers of the simulated vehicle [inch]; others are similar to it.
PROPELLER_INCH: Final = 10.0
#: The gyro filter that setup pages advise: 289.22 Hz / inch^0.838, no lower than 20 Hz.
_GYRO_FILTER_HZ, _GYRO_FILTER_POWER, _LEAST_GYRO_FILTER_HZ = 289.22, -0.838, 20.0
#: Multisine: lines of an axis, number of periods, length of a period [s].
_LINES, _PERIODS, _PERIOD_S = 24, 2, 20.0
#: Largest rate of a multisine of all axes at once, over that of a sweep of one: all three share the motors.
_TOGETHER: Final = 1.0 / 3.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Plan:
    """The plan of an identification flight.

    Attributes
    ----------
    autopilot : str
        Name of the autopilot, one of those of `FlightLog.autopilot`.
    version : tuple of int, or None
        Firmware version, None for a recent version.
    axes : tuple of str
        Axes to excite.
    sweeps : mapping of str to Sweep
        Frequency sweep by axis, if the autopilot can sweep. Otherwise empty, and the pilot flies doublets.
    duration_s : float
        Time from take-off to landing [s].
    parameters : mapping of str to float
        Parameters of the vehicle; empty if not known.
    excitations : mapping of str to AxisExcitation
        Recommended excitation by axis, with its expected result; empty if the autopilot injects nothing.
    model : str
        Source of the model that the excitation was designed with.
    air : str
        The air that the expected result holds for.
    wanted : float
        Half width of the 95 % interval of the control effectiveness that the plan is designed for, as a
        fraction of the effectiveness.
    propeller_inch : float
        Propeller diameter of the simulated vehicle [inch].
    """

    autopilot: str
    version: Version | None
    axes: tuple[str, ...]
    sweeps: Mapping[str, Sweep]
    duration_s: float
    parameters: Mapping[str, float] = field(default_factory=dict)
    excitations: Mapping[str, AxisExcitation] = field(default_factory=dict)
    model: str = ""
    air: str = ""
    wanted: float = WANTED
    propeller_inch: float = PROPELLER_INCH

    @property
    def advice(self) -> Advice:
        """The autopilot's advice on setup and flight."""
        return advice_for(self.autopilot)

    @property
    def logging(self) -> tuple[Setting, ...]:
        """Logging parameters to set: the vehicle's own values with the missing functions added."""
        return self.advice.logging_values(self.parameters)

    @property
    def logging_back(self) -> tuple[Setting, ...]:
        """The same parameters with the vehicle's present values, if known."""
        return tuple((name, self.parameters[name]) for name, _ in self.logging if name in self.parameters)

    def settings_of(self, axis: str) -> tuple[Setting, ...]:
        """Return the parameters of an axis' sweep, in the order of setting them."""
        return self.advice.sweep_settings(axis, dataclasses.asdict(self.sweeps[axis]))

    def steps(self) -> tuple[str, ...]:
        """Return the steps of the flight, in order."""
        *flown, last = self.advice.steps(
            self.axes, {axis: dataclasses.asdict(each) for axis, each in self.sweeps.items()}
        )
        by_files = self.advice.excitation_step if self.excitations else ""
        return (*flown, *filter(None, [by_files]), last)

    def steps_by_hand(self) -> tuple[str, ...]:
        """Return the steps for sweeps without the script; empty if there is no script."""
        return self.advice.steps_by_hand(
            self.axes, {axis: dataclasses.asdict(each) for axis, each in self.sweeps.items()}
        )

    def script_files(self) -> dict[str, str]:
        """Return the files that fly the excitation or set it up: text by file name."""
        flown = {axis: dataclasses.asdict(each) for axis, each in self.excitations.items()}
        return self.advice.excitation_files(flown, _multisine(self.excitations), self.parameters)

    def __repr__(self) -> str:
        version = "" if self.version is None else " " + ".".join(map(str, self.version))
        flown = counted(len(self.sweeps), "sweep") if self.sweeps else "stick doublets"
        return (
            f"<Plan for {self.autopilot}{version}: {', '.join(self.axes)}, {self.duration_s:.0f} s, {flown}>"
        )

    def predict(self, vehicle: Vehicle | None = None) -> Prediction:
        """Fly the plan in the simulator and analyze the log; see `quadid_logs.planning.predict`."""
        return predict(self, vehicle)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Prediction:
    """The result of the simulated flight, and the name of the vehicle that flew it."""

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
    *,
    known: Result | None = None,
    vehicle: Vehicle | None = None,
    propeller_inch: float = PROPELLER_INCH,
    air: str = "",
    wanted: float = WANTED,
) -> Plan:
    """Plan a flight.

    Parameters
    ----------
    autopilot : str
        One of `diagnose.advice.plannable`.
    axes : sequence of str
        Axes to excite: roll, pitch, yaw. Empty means all.
    version : tuple of int, optional
        Firmware version; the default is a recent version.
    parameters : mapping of str to float
        Parameters of the vehicle, if known.
    known : Result, optional
        Result of a flight of the vehicle, for its model, controller and air. Axes without a result use those
        of a vehicle of the same size.
    vehicle : Vehicle, optional
        Known properties; they replace those of the simulated vehicle.
    propeller_inch : float
        Propeller diameter [inch]. It sets the size of the vehicle if log and ``vehicle`` do not.
    air : str
        A key of `AIRS`; "" takes the air of the known flight, or a breeze.
    wanted : float
        Half width of the 95 % interval of the control effectiveness, as a fraction of the effectiveness.

    Returns
    -------
    Plan

    Raises
    ------
    SettingsError
        If the autopilot, an axis or the air is unknown, or a number is out of range.
    SimulationError
        If the vehicle cannot fly.

    Examples
    --------
    >>> plan = make_plan(plannable()[-1], ["roll"])
    >>> plan.axes, plan.duration_s
    (('roll',), 42.0)
    """
    unknown = [axis for axis in axes if axis not in AXES]
    if unknown:
        raise SettingsError(f"There is no axis {unknown[0]!r}.", hint=f"Choose from {', '.join(AXES)}.")
    if autopilot == "other":
        raise SettingsError(
            "The log does not say which autopilot flew.",
            hint=f"Name one instead: {', '.join(plannable())}.",
        )
    if autopilot not in plannable():
        raise SettingsError(
            f"There is no plan for {autopilot!r}.", hint=f"Choose one of {', '.join(plannable())}."
        )
    if not 1.0 <= propeller_inch <= 40.0:
        raise SettingsError(
            f"A propeller of {propeller_inch:g} inches is out of range.", hint="Give 1 to 40 inches."
        )
    if air and air not in AIRS:
        raise SettingsError(f"The air {air[:40]!r} is unknown.", hint=f"Choose one of {', '.join(AIRS)}.")
    if not 0.01 < wanted <= 0.5:
        raise SettingsError(
            f"An interval of {100.0 * wanted:g} % is out of range.",
            hint="Give more than 1 % (the gyro's scale error), and at most 50 %.",
        )
    chosen = tuple(axis for axis in AXES if not axes or axis in axes)
    advice = advice_for(autopilot)
    # How a vehicle of this size flies, where no log tells.
    scenario = Scenario(
        name="plan",
        sentence="A vehicle of this size.",
        manoeuvre=hover,
        airframe=partial(_airframe, 0 if vehicle is None else len(vehicle.rotors), propeller_inch),
        gyro_filter_hz=_gyro_filter_hz(propeller_inch),
    )
    setup = plan_flights(
        scenario, seed=0, duration_s=60.0, rate_hz=400.0, vehicle=vehicle, autopilot=autopilot
    )[0]
    excitations = {}
    if advice.excites(version):
        excitations = _excitations(advice, chosen, known, setup, air, wanted)
    # The sweep of an axis, faded in during its first two cycles.
    sweeps = {
        axis: Sweep(
            magnitude=each.magnitude,
            start_hz=each.start_hz,
            stop_hz=each.stop_hz,
            record_s=each.record_s,
        )
        for axis, each in excitations.items()
        if axis in advice.sweep_magnitudes(version)
    }
    flown_s = sum(sweep.record_s + _PAUSE_S for sweep in sweeps.values())
    return Plan(
        autopilot=autopilot,
        version=version,
        axes=chosen,
        sweeps=MappingProxyType(sweeps),
        duration_s=_AROUND_S + (flown_s or _DOUBLETS_PER_AXIS_S * len(chosen)),
        parameters=parameters,
        excitations=MappingProxyType(excitations),
        model=_model_words(known, chosen, setup.airframe.name),
        air=air or ("the log's" if any(_of_log(known, axis) for axis in chosen) else "breeze"),
        wanted=wanted,
        propeller_inch=propeller_inch,
    )


def _model_words(known: Result | None, axes: Sequence[str], simulated: str) -> str:
    """Return the source of the model for the excitation; a log may not identify every axis."""
    if known is None:
        return simulated
    untold = [axis for axis in axes if _of_log(known, axis) is None]
    if not untold:
        return "the log"
    told = "" if len(untold) == len(axes) else "the log, and "
    return f"{told}{simulated}, because the log shows nothing of {' and '.join(untold)}"


class _Known(NamedTuple):
    """One axis, per unit of its command: vehicle, controller and disturbance."""

    plant: Plant
    controller: AxisController
    air: Air | None


def _excitations(
    advice: Advice, axes: Sequence[str], known: Result | None, setup: Setup, air: str, wanted: float
) -> dict[str, AxisExcitation]:
    """Return the excitation of each axis."""
    found = {}
    for axis in axes:
        number = AXES.index(axis)
        flown = _of_log(known, axis)
        plant, controller, own_air = flown or _Known(
            nominal_plant(setup, number), true_controller(setup, number), None
        )
        around = own_air
        if around is None or air:
            # As flown logs show its spectrum.
            frequency_hz = np.geomspace(0.05, 200.0, 300)
            size = AIRS[air or "breeze"] * (_YAW_IN_AIR if axis == "yaw" else 1.0)
            around = Air(frequency_hz, size**2 * disturbance_density(frequency_hz))
        fitting = design(
            controller,
            plant,
            around,
            number,
            wanted,
            entry="mixer" if advice.excitation_entry == "mixer" else "rate",
            most_hz=advice.excitation_most_hz,
            lead_lag_hz=advice.excitation_lead_lag_hz,
        )
        if fitting is not None:
            found[axis] = fitting
    return found


def _of_log(known: Result | None, axis: str) -> _Known | None:
    """Return the vehicle, controller and air of an axis from a flight; None if its loop is not known."""
    if known is None:
        return None
    model, closed = known.identification.recommended, known.closed_loop
    if model is None or closed is None:
        return None
    loop, controller = closed.axes.get(axis), closed.controllers.axes.get(axis)
    if loop is None or loop.plants is None or controller is None:
        return None
    _, model = per_command(known.data, model)
    if not model.entries[ON_AXIS[axis]].identifiable:
        return None
    return _Known(
        loop.plants.at(slice(0, 1))._replace(modes=None), controller, _air_of(known, AXES.index(axis))
    )


def _air_of(known: Result, number: int) -> Air | None:
    """Return the disturbance of an axis in a flight, from the residual of the fit; None without one."""
    model = known.identification.recommended
    spectrum = None if model is None else residual_spectrum(model.fit, number)
    if model is None or spectrum is None:
        return None
    s = np.asarray(2j * np.pi * spectrum.frequency_hz, dtype=np.complex128)
    # The residual has passed the filter of the fit, whose gain is too small far above its cut-off.
    passed = gaussian_response(s, model.smoothing_hz) ** 2
    inside = (spectrum.frequency_hz <= model.smoothing_hz) & (spectrum.density > 0.0)
    if not inside.any():
        return None
    return Air(spectrum.frequency_hz[inside], (spectrum.density / passed)[inside], model.smoothing_hz)


def _gyro_filter_hz(propeller_inch: float) -> float:
    """Return the cut-off of the gyro filter that setup pages advise [Hz]."""
    advised_hz = _GYRO_FILTER_HZ * propeller_inch**_GYRO_FILTER_POWER
    return float(max(advised_hz, _LEAST_GYRO_FILTER_HZ))


def _multisine(excitations: Mapping[str, AxisExcitation]) -> dict[str, object]:
    """Return rate set-points that excite all axes at once, each at its own frequencies.

    The result is the input of `Advice.excitation_files`. An axis that is not planned has no lines. The
    largest rates follow from the limits of the sweeps.
    """
    planned = [axis for axis in AXES if axis in excitations]
    bands = tuple(
        (
            excitations[axis].start_hz * _PERIOD_S,
            max(excitations[axis].stop_hz, 4.0 * excitations[axis].start_hz) * _PERIOD_S,
        )
        for axis in planned
    )
    sines = dict(zip(planned, orthogonal(bands, _LINES), strict=True))
    limit_dps = {axis: _TOGETHER * float(np.degrees(excitations[axis].peak_rate_rad_s)) for axis in planned}
    return {
        "period_s": _PERIOD_S,
        "periods": _PERIODS,
        "limit_dps": [round(limit_dps.get(axis, 0.0), 2) for axis in AXES],
        "scale_dps": [
            round(limit_dps[axis] / sines[axis].peak, 4) if axis in sines else 0.0 for axis in AXES
        ],
        "lines": [
            [
                (round(harmonic / _PERIOD_S, 6), round(phase, 4))
                for harmonic, phase in zip(
                    sines[axis].harmonics.tolist(), sines[axis].phases.tolist(), strict=True
                )
            ]
            if axis in sines
            else []
            for axis in AXES
        ],
    }


def parse_version(text: str) -> Version:
    """Return the numbers of a firmware version.

    Parameters
    ----------
    text : str
        Version, such as "v4.5.7".

    Returns
    -------
    tuple of int
        Numbers, the most significant first.

    Raises
    ------
    SettingsError
        If the text is not a version.

    Examples
    --------
    >>> parse_version("v4.5.7")
    (4, 5, 7)
    """
    numbers = text.removeprefix("v").removeprefix("V").split(".")
    if not all(number.isascii() and number.isdigit() and len(number) < 5 for number in numbers):
        raise SettingsError(f"{text[:40]!r} is not a firmware version.", hint="Give it as 4.5 or 4.5.7.")
    return tuple(int(number) for number in numbers)


def predict(plan: Plan, vehicle: Vehicle | None = None) -> Prediction:
    """Fly the plan in the simulator, in calm air, and analyze its log.

    Parameters
    ----------
    plan : Plan
    vehicle : Vehicle, optional
        Known properties; they replace those of the simulated vehicle. `analyze` uses its calibration too.

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
        airframe=partial(_airframe, 0 if vehicle is None else len(vehicle.rotors), plan.propeller_inch),
        gyro_filter_hz=_gyro_filter_hz(plan.propeller_inch),
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


def _airframe(n_rotors: int, propeller_inch: float = PROPELLER_INCH) -> SimulatedAirframe:
    """Return the simulated vehicle with a number of rotors; a quadrotor if the number is not known."""
    makers = {0: quad_x, 4: quad_x, 6: hexa_x, 8: octa_coaxial}
    made = makers.get(n_rotors, quad_x)()
    if propeller_inch == PROPELLER_INCH:
        return made
    named = f"{made.name}, scaled to {propeller_inch:g} inch propellers"
    return dataclasses.replace(scaled(made, propeller_inch / PROPELLER_INCH), name=named)


def _manoeuvre(plan: Plan, time_s: FloatArray, rng: np.random.Generator) -> Reference:
    """Return the set-points of the planned flight."""
    if plan.sweeps:
        order = [(AXES.index(axis), plan.sweeps[axis]) for axis in plan.axes]
        return sweeps_in_turn(time_s, rng, sweeps=order, pause_s=_PAUSE_S)
    flown = doublets(time_s, rng, amplitude_rad_s=_DOUBLET_RAD_S, pulse_s=_DOUBLET_S)
    wanted = np.array([axis in plan.axes for axis in AXES])
    return dataclasses.replace(flown, rate_rad_s=flown.rate_rad_s * wanted)
