"""FlightData -> Identification: every structure fitted, the best one recommended."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import (
    Effect,
    Excitation,
    Identification,
    Model,
    Response,
    SpectralFit,
    ThrustCurve,
)
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.errors import SettingsError
from quadid_logs.identify.actuator_model import KnownActuator
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.equation_by_equation import INFORMATIVE_R2, ActuatedFit, checked
from quadid_logs.identify.excitation import (
    ColumnNoise,
    excited_axes,
    holds_one_frequency,
    measure_excitation,
    noise_density,
    turns,
)
from quadid_logs.identify.first_stage import told_axes, with_strong_instruments
from quadid_logs.identify.model import actuated_model, explained_accelerations
from quadid_logs.identify.published import fit_as_published
from quadid_logs.identify.response import SAMPLES_PER_CYCLE, Band, fitted_band, responses
from quadid_logs.identify.rigid_body import fit_single_rigid_body
from quadid_logs.identify.select import most_excited
from quadid_logs.identify.slow_yaw import fit_slow_yaw
from quadid_logs.identify.spectral import (
    AxisMoments,
    SharedActuator,
    response_to_commands,
    solve_flight,
    with_delay_alone,
)
from quadid_logs.identify.spectral_axes import (
    actuator_told,
    explains,
    spoiled_axes,
    with_effects_beside,
    with_spectral_axes,
)
from quadid_logs.identify.spectral_change import with_answers
from quadid_logs.identify.spectral_effects import average_over_effects
from quadid_logs.identify.splice import with_axis_of
from quadid_logs.identify.structures import RIGID_BODY, STRUCTURES, Structure
from quadid_logs.identify.terms import GYROSCOPIC, YAW_REACTION
from quadid_logs.identify.thrust_curve import fit_thrust_curve
from quadid_logs.identify.two_vehicles import with_flights_beside
from quadid_logs.identify.yaw import YawFit, fit_with_reaction
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS, RATE_SYMBOLS

__all__ = ["MIN_RATE_HZ", "ROWS_PER_UNKNOWN", "default_band", "identify"]

#: Below, a 50 ms motor lag and the rate loop (2 to 8 Hz) leave under five samples per cycle between them,
#: and the torque between two samples is a guess: B comes out wrong by factors (measured: factor 2 at 11 Hz).
MIN_RATE_HZ: Final = 40.0
#: Rigid-body motion and rate loops act below 5 Hz; above, the gyro's filters,
#: blade and frame dynamics add phase that no lag and delay describe.
_SMOOTHING_HZ = 5.0
#: Leaving this much more of held-out acceleration unexplained is chance: the
#: squared error of some hundred clusters is known to a tenth.
_WORSE = 0.1
#: Rotors that slow down five times as slowly as they speed up leave 2.3 % where effects are as commands tell
#: them, and next to nothing of a search in time: with more than twice that, air moves the vehicle.
_MAY_EXPLAIN_R2 = 0.95
_DEAD_ROTORS = (
    "rotors in this flight do not follow small changes of their command, which looks like another expo"
)
_NOT_A_RIGID_BODY = (
    "This flight does not show that the vehicle is a single rigid body. Its gyroscopic terms are not "
    "significant, or equations fitted one by one predict validation data better."
)
#: Equivalent noise bandwidth of the Gaussian over its cut-off: sqrt(pi / ln 2) / 2.
_NOISE_BANDWIDTH = 1.0645
#: Rows per unknown below which a fit is arithmetic, not evidence.
ROWS_PER_UNKNOWN: Final = 5


def identify(
    data: FlightData,
    settings: IdentifySettings,
    structures: Sequence[Structure] = STRUCTURES,
    *,
    recommended: str = "",
) -> Identification:
    """Fit all structures to the aligned flight.

    Parameters
    ----------
    data : FlightData
    settings : IdentifySettings
    structures : sequence of Structure
        The first is fitted equation by equation; the single rigid body starts from it.
    recommended : str
        Name of the structure to recommend, before that of the settings; "" leaves it to them.

    Returns
    -------
    Identification
        Without models, and with ``skipped`` saying why, where the data hold
        too little to fit anything. Models with caveats are returned: `diagnose`
        judges them.

    Raises
    ------
    SettingsError
        If the band that was set by hand goes up to half the sample rate.
    """
    if not data.segments or data.input is None:
        return Identification(skipped="there is no segment of flight with both body rates and torque")
    needed = [data.sources[name] for name in (data.input.kind, "body_rate") if name in data.sources]
    slowest_hz = min((source.rate_hz for source in needed), default=np.inf)
    if slowest_hz < MIN_RATE_HZ:
        yaw = fit_slow_yaw(data, structures[0], settings, slowest_hz)
        if yaw is None:
            return Identification(skipped=f"torque and rates were logged at only {slowest_hz:.3g} Hz")
        return replace(_identified(data, (yaw[0],), yaw[1]), only_yaw=True)
    band = default_band(settings, data.sample_period_s)
    data = most_excited(data, settings.most_samples)
    design = build_design(data, band.high_hz, structures)
    n_needed = ROWS_PER_UNKNOWN * len(structures[0].columns)
    if design is None or np.count_nonzero(design.train) < n_needed:
        return Identification(skipped="the flight is too short for the number of unknowns")
    high_passed = design.high_passed(settings.high_pass_hz)
    design = with_strong_instruments(design, high_passed, excited_axes(high_passed))
    flown, rows = data, design
    data, design, curve = fit_thrust_curve(flown, rows, settings.high_pass_hz)
    told_by_commands = _by_spectra(data)
    if curve is not None and curve.corrected and told_by_commands.shows("rotor threshold"):
        data, design, curve = fit_thrust_curve(flown, rows, settings.high_pass_hz, hidden_by=_DEAD_ROTORS)
        told_by_commands = _by_spectra(data)
    wanted = recommended or settings.structure
    by_commands = wanted in ("", structures[0].name)
    # Behind the lag and delay that commands tell nothing is searched for, unless a search may find a fit in
    # time that stands beside what commands tell.
    behind_told, actuator = None, actuator_told(told_by_commands.fits) if by_commands else None
    if actuator is not None and not any(
        told_by_commands.explained(axis, band) >= _MAY_EXPLAIN_R2 for axis in told_by_commands.axes
    ):
        behind_told = _fit_first(data, design, structures, settings, actuator=actuator)
    fits = behind_told or _fit_first(data, design, structures, settings)
    used = design.high_passed(settings.high_pass_hz)
    told = [] if design.instruments is None else told_axes(used)
    found = responses(data, by_setpoints=told)
    if behind_told is None and not settings.smoothing_hz and settings.high_pass_hz:
        # By set-points the response of an axis can be known before a fit of it is any good.
        asked = [axis for axis in told or fits.informative if axis < 2]
        tilting = {axis: found[axis] for axis in asked if found}
        for other, raised in _bands_of_the_response(tilting, band, data.sample_period_s, design):
            again = _fit_in(other, data, design, structures, settings, raised=raised)
            if again is None:
                continue
            explained, after = (
                np.array([each.explained().get(ACCELERATION_SYMBOLS[axis], 0.0) for axis in asked])
                for each in (fits, again)
            )
            # Above a raised lower edge an axis must be explained: what is below is known to be another's,
            # however well it was fitted. Without what is above an upper edge, or of which nothing is known,
            # more must be explained: captured motion, for one, is often smoothed, and its empty upper
            # frequencies harm nothing.
            less = (1.0 - after) / np.maximum(1.0 - explained, 1e-12)
            if after.max() >= INFORMATIVE_R2 if raised else np.prod(less) < (1.0 - _WORSE) ** less.size:
                fits = again
    models = fits.models()
    identified = _identified(data, _recommend(models, wanted), design)
    spectral = told_by_commands.fits
    alone = [axis for axis, fit in enumerate(spectral) if fit.planned or not explains(models[0], axis)]
    told_again = _told_by_spectra(told_by_commands, data, models[0], identified.excitation, curve, alone)
    told_again = told_again if by_commands else ()
    # The torque of such an axis answers gusts as well: its response to that is none of the vehicle's.
    moments = {each.number: each for each in told_by_commands.axes}
    found = tuple(
        response_to_commands(moments[axis]) if axis in told_again and spectral[axis].is_of_use else each
        for axis, each in enumerate(found)
    )
    if told_again:
        # The structure that is fitted equation by equation is recommended, with these axes by spectra.
        structure = structures[0].known(design.torque.symbols)
        by_equation = next(each for each in identified.models if each.structure == models[0].structure)
        if YAW_REACTION.symbol in by_equation.regressors:
            structure = structure.with_reaction()
        model = with_spectral_axes(
            by_equation, structure, spectral, told_again, data=data, design=design, settings=settings
        )
        model = with_answers(model, [moments[axis] for axis in told_again], spectral)
        others = (replace(each, recommended=False) for each in identified.models if each is not by_equation)
        identified = replace(identified, models=(replace(model, recommended=True), *others))
    in_time = [axis for axis in range(len(spectral)) if axis not in told_again]
    beside = (with_effects_beside(each, spectral, in_time) for each in identified.models)
    identified = replace(identified, models=tuple(with_flights_beside(each) for each in beside))
    spectral = tuple(
        replace(each, used=axis in told_again, alone=by_commands and axis in alone)
        for axis, each in enumerate(spectral)
    )
    return replace(identified, responses=found, thrust_curve=curve, spectral=spectral)


class _BySpectra(NamedTuple):
    """What answers to commands tell of each axis: as they are, and with effects. Empty where nothing does."""

    plain: tuple[SpectralFit, ...] = ()
    fits: tuple[SpectralFit, ...] = ()
    planned: bool = False
    axes: tuple[AxisMoments, ...] = ()

    def explained(self, axis: AxisMoments, band: Band) -> float:
        """Return how much of an acceleration torque and effects explain, gusts and all."""
        return axis.explained(SharedActuator.of(self.fits[axis.number]), band)

    def shows(self, effect: Effect) -> bool:
        """Say whether an axis shows an effect."""
        return any(effect in fit.effects for fit in self.fits)


def _by_spectra(data: FlightData) -> _BySpectra:
    """Return what answers to commands tell of each axis."""
    solution = solve_flight(data)
    if solution is None:
        return _BySpectra()
    fits = tuple(with_delay_alone(each) for each in average_over_effects(solution, data))
    return _BySpectra(solution.fits, fits, solution.planned, tuple(solution.axes))


def _told_by_spectra(
    told: _BySpectra,
    data: FlightData,
    model: Model,
    excitation: Sequence[Excitation],
    curve: ThrustCurve | None,
    alone: Sequence[int],
) -> tuple[int, ...]:
    """Return the axes whose fit in time is replaced by what answers to commands tell.

    Of those that commands tell ``alone`` a refused number is theirs, too: its interval says why.
    """
    axes = range(len(told.fits))
    spoiled = axes if told.planned else spoiled_axes(model, data.sample_period_s)
    # At one frequency a fit in time takes lag and delay for known.
    spoiled = tuple(axis for axis in axes if axis in spoiled or holds_one_frequency(excitation, axis))
    # What another thrust curve makes of newton metres is in the interval of the fit in time alone.
    of_newtons = data.input is not None and data.input.kind == "torque_n_m"
    certain = curve is None or curve.identifiable or not of_newtons
    wider = [axis for axis in axes if certain and told.plain[axis].half_width < _half_width(model, axis)]
    narrower = (
        axis
        for axis in wider
        if told.fits[axis].is_sound and told.fits[axis].half_width < _half_width(model, axis)
    )
    of_use = (axis for axis in spoiled if told.fits[axis].is_of_use)
    return tuple(sorted({*of_use, *(axis for axis in alone if told.fits[axis].is_known), *narrower}))


def _half_width(model: Model, axis: int) -> float:
    """Return half of the effectiveness' interval."""
    low, high = model.entries[ON_AXIS[AXES[axis]]].ci95
    return 0.5 * (high - low)


def _identified(data: FlightData, models: tuple[Model, ...], design: Design) -> Identification:
    """Put an identification together, with how much each axis was excited in the band of its fit."""
    model = models[0]
    bands = [model.band_of(axis) for axis in range(3)]
    low_hz = [design.high_pass_hz if band is None else float(band.low_hz[0]) for band in bands]
    fitted = {each: design.high_passed(each) for each in {*low_hz}}
    r2 = np.array([model.validation.r2_acceleration.get(name, float("nan")) for name in ACCELERATION_SYMBOLS])
    return Identification(
        models=models,
        n_samples=data.n_samples,
        excitation=measure_excitation(
            data,
            signal_to_noise=np.maximum(r2, 0.0) / np.maximum(1.0 - r2, 1e-9),
            rate_rms_rad_s=np.array(
                [np.std(fitted[low].columns[name]) for low, name in zip(low_hz, RATE_SYMBOLS, strict=True)]
            ),
            # What an axis holds beside its strongest line counts wherever the fit could begin.
            band_hz=(design.high_pass_hz, model.smoothing_hz),
        ),
    )


def default_band(settings: IdentifySettings, sample_period_s: float) -> Band:
    """Return the band that is fitted where the response does not speak against it.

    Parameters
    ----------
    settings : IdentifySettings
    sample_period_s : float

    Returns
    -------
    Band

    Raises
    ------
    SettingsError
        If the band that was set by hand goes up to half the sample rate.
    """
    rate_hz = 1.0 / sample_period_s
    if 2.0 * settings.smoothing_hz >= rate_hz:
        raise SettingsError(
            f"The band goes up to {settings.smoothing_hz:g} Hz, too high for a log resampled to "
            f"{rate_hz:.4g} Hz.",
            hint="Give a --band that ends below half of the log's rate.",
        )
    return Band(
        settings.high_pass_hz, settings.smoothing_hz or min(_SMOOTHING_HZ, rate_hz / SAMPLES_PER_CYCLE)
    )


def _bands_of_the_response(
    tilting: Mapping[int, Response], band: Band, sample_period_s: float, design: Design
) -> Iterator[tuple[Band, bool]]:
    """Yield the other bands that the response of roll and pitch, by number of the axis, speaks for.

    They are what slow air tilts; yaw tells most where it is slowest. With each, whether its lower edge is
    raised above what is known to be another's. With set-points as instruments, slow air hides what it does
    not change: what nothing is known of may be left out, where the axes are still moved.
    """
    if not tilting:
        return
    found = [*tilting.values()]
    other = fitted_band(found, band, sample_period_s)
    if other != band:
        yield other, other.low_hz > band.low_hz
    if design.instruments is None:
        return
    known = fitted_band(found, band, sample_period_s, from_known=True)
    if known not in (band, other) and turns(design.high_passed(known.low_hz))[[*tilting]].all():
        yield known, False


def _fit_in(
    band: Band,
    data: FlightData,
    design: Design,
    structures: Sequence[Structure],
    settings: IdentifySettings,
    *,
    raised: bool,
) -> _Fits | None:
    """Fit again in another band; None where no segment is as long as its filters reach."""
    other = build_design(data, band.high_hz, structures)
    if other is None:
        return None
    other = other.instrumented_as(design)
    # The reaction of the rotors rules yaw above a raised lower edge, so that yaw stays below; roll and pitch,
    # which slow air drives there, have no say in its lag and delay. What is only left out may be told by yaw.
    own = None
    if band.low_hz > settings.high_pass_hz:
        yaw = fit_with_reaction(
            data, design, structures[0].known(design.torque.symbols), settings, voting=(2,)
        )
        own = None if raised and yaw.reaction is None else yaw
    settings = replace(settings, high_pass_hz=band.low_hz)
    return _fit_first(data, other, structures, settings, yaw=own)


class _Fits(NamedTuple):
    """The first structure fitted in a band: the axes that it tells, how much it explains, all models.

    Models, with what checks them, are only wanted of the band that is kept.
    """

    informative: list[int]
    explained: Callable[[], Mapping[str, float]]
    models: Callable[[], list[Model]]


def _fit_first(
    data: FlightData,
    design: Design,
    structures: Sequence[Structure],
    settings: IdentifySettings,
    *,
    yaw: YawFit | None = None,
    actuator: KnownActuator | None = None,
) -> _Fits:
    """Fit the first structure equation by equation.

    ``yaw`` is an equation of yaw that was fitted in a band of its own.
    """
    noise = ColumnNoise(noise_density(data), design.columns, _NOISE_BANDWIDTH * design.smoothing_hz)
    structure = structures[0].known(design.torque.symbols)
    known = fit_with_reaction(data, design, structure, settings, known=yaw, actuator=actuator)

    def models() -> list[Model]:
        first = checked(known.fit)
        model = known.on(actuated_model(data, first, settings, noise))
        if yaw is not None:
            of_yaw = actuated_model(data, checked(yaw.fit), settings, noise)
            model = replace(with_axis_of(model, of_yaw, 2, data), yaw_band=of_yaw.band)
        others = (
            _fit_beside(each, known, first, yaw, data, design, settings, noise) for each in structures[1:]
        )
        return [model, *(one for one in others if one is not None)]

    return _Fits(known.fit.informative, lambda: explained_accelerations(known.fit), models)


def _fit_beside(
    structure: Structure,
    known: YawFit,
    first: ActuatedFit,
    yaw: YawFit | None,
    data: FlightData,
    design: Design,
    settings: IdentifySettings,
    noise: ColumnNoise,
) -> Model | None:
    """Fit another structure than the first; None where the flight lacks its terms.

    ``first`` is what is ``known``, with its checks.
    """
    structure = structure.known(design.torque.symbols)
    if YAW_REACTION in first.structure.terms:
        structure = structure.with_reaction()
    if not {*structure.regressors}.difference(structure.inputs) <= design.columns.keys():
        return None
    if structure.estimator == "as published":
        return fit_as_published(structure, data, design, settings, noise)
    if structure.estimator == "single rigid body":
        rigid = fit_single_rigid_body(structure, data, first)
        return None if rigid is None else known.on(actuated_model(data, rigid, settings, noise))
    found = fit_with_reaction(data, design, structure, settings, known=yaw)
    return found.on(actuated_model(data, checked(found.fit), settings, noise))


def _recommend(models: list[Model], structure: str) -> tuple[Model, ...]:
    """Put the structure first that the user wants, or else a physical one.

    The paper's own structures take the torque as logged. Whatever they
    explain, their B is that of no vehicle whose motors lag.
    """
    by_equation, *others = models
    physical = next((model for model in others if _is_rigid_body(model, by_equation)), by_equation)
    wanted = next((model for model in models if model.structure == structure), None)
    best = wanted or physical
    ordered = sorted(models, key=lambda model: model is not best)
    return tuple(
        replace(
            model,
            recommended=model is best,
            note=_NOT_A_RIGID_BODY
            if model.structure == RIGID_BODY.name and model is not physical
            else model.note,
        )
        for model in ordered
    )


def _is_rigid_body(model: Model, by_equation: Model) -> bool:
    """Say whether the vehicle is seen to be a single rigid body.

    Its gyroscopic terms must be seen, or its shape is a guess; it must explain
    held-out flight as well as the equations one by one do; and the simpler model
    must be the more likely one.
    """
    on_axis = {(target, term.symbol) for target, term in zip(ACCELERATION_SYMBOLS, GYROSCOPIC, strict=True)}
    seen = [p.identifiable for p in model.parameters if (p.target, p.regressor) in on_axis]
    if model.structure != RIGID_BODY.name or not all(seen):
        return False
    left, left_by_equation = (
        1.0 - np.array([each.validation.r2_acceleration.get(name, -np.inf) for name in ACCELERATION_SYMBOLS])
        for each in (model, by_equation)
    )
    return bool((left <= (1.0 + _WORSE) * left_by_equation).all()) and model.criterion < by_equation.criterion
