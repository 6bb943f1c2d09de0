"""What `identify` hands on: models with their caveats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.numerals import estimate
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, ON_AXIS


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One element of A or B with its interval.

    Attributes
    ----------
    name : str
        "B11", "A17": row and column.
    target, regressor : str
        ``regressor`` (or input) multiplies ``value`` in the equation of ``target``.
    value : float
    unit : str
        The target's over the regressor's.
    ci95 : tuple of float
        The 95 % interval.
    identifiable : bool
        Whether this flight tells the value.
    reason : str
        Why it does not.
    half_width : float
        Half of what the interval was before it was widened to effects that may be there.

    Examples
    --------
    >>> from quadid_logs import Parameter
    >>> print(
    ...     Parameter(
    ...         name="B11",
    ...         target="p_dot",
    ...         regressor="L",
    ...         value=198.0,
    ...         unit="rad/s^2",
    ...         ci95=(196.0, 200.0),
    ...         identifiable=True,
    ...     )
    ... )
    B11 = 198.0 (196.0 to 200.0) rad/s^2
    """

    name: str
    target: str
    regressor: str
    value: float
    unit: str
    ci95: tuple[float, float]
    identifiable: bool
    reason: str = ""
    half_width: float = float("nan")

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self}{'' if self.identifiable else ', not identifiable'}>"

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.name} = {estimate(self.value, *self.ci95)}{unit}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Actuator:
    """Lag and delay between logged torque and angular acceleration.

    ``lag_s`` and ``delay_s`` with 95 % intervals; ``loss`` of shape
    (n_lags, n_delays) is one minus the held-out R2 over ``lag_grid_s`` and ``delay_grid_s``.
    Where the lag acts on the speed of the rotors, it is the mean of
    ``lag_up_s`` and ``lag_down_s``; both are NaN otherwise.
    """

    lag_s: float
    lag_ci95_s: tuple[float, float]
    delay_s: float
    delay_ci95_s: tuple[float, float]
    acts_on: str
    lag_grid_s: FloatArray
    delay_grid_s: FloatArray
    loss: FloatArray
    lag_up_s: float = float("nan")
    lag_down_s: float = float("nan")

    @property
    def lag_identifiable(self) -> bool:
        """Whether the lag is known well enough to be told from another."""
        return _narrow(self.lag_s, self.lag_ci95_s) and not self.at_bound

    @property
    def delay_identifiable(self) -> bool:
        """Whether the delay is known well enough to be told from another."""
        return _narrow(self.delay_s, self.delay_ci95_s) and not self.at_bound

    @property
    def at_bound(self) -> bool:
        """Whether lag or delay is the largest of the search: then neither is identified."""
        pairs = ((self.lag_s, self.lag_grid_s), (self.delay_s, self.delay_grid_s))
        return any(value_s >= _AT_BOUND * grid_s.max(initial=0.0) for value_s, grid_s in pairs if grid_s.size)


#: A search ends this near to a bound that it would cross.
_AT_BOUND = 0.99
#: A half width of a fifth is a standard deviation of a tenth: a time known worse is an order of magnitude.
_MOST_RELATIVE = 0.2


def _narrow(value_s: float, ci95_s: tuple[float, float]) -> bool:
    """Say whether an interval is narrow against its value."""
    low, high = ci95_s
    return bool(0.5 * (high - low) <= _MOST_RELATIVE * value_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """What is known, together, of the five numbers of each axis that a control loop is made of.

    Attributes
    ----------
    mean : ndarray, shape (3, 5)
        Per axis: on-axis effectiveness [rad/s^2 per unit of torque] and on-axis damping [1/s], both of
        the rates as the gyro shows them; lag and delay of the actuator [s]; of yaw the reaction of
        accelerating rotors [rad/s per unit of torque], zero where none was seen.
    covariance : ndarray, shape (3, 5, 5)
        Of these, one standard deviation squared; not finite where an axis tells nothing. The gyro's scale
        and the torque's calibration, which cancel around a loop, are no part of it.
    lag_or_delay_s : float
        So much of the delay may be lag: the flight does not tell the two apart.
    only_brakes : tuple of bool
        Of each axis: its damping is estimated as none, at the edge of what rotors and air can do.
    """

    mean: FloatArray
    covariance: FloatArray
    lag_or_delay_s: float
    only_brakes: tuple[bool, bool, bool] = (False, False, False)

    def __repr__(self) -> str:
        names = "effectiveness, damping, lag, delay, reaction of the rotors"
        return f"<{type(self).__name__} of {names}, by axis>"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Windows:
    """One solution of H_k per window.

    Attributes
    ----------
    time_s : ndarray, shape (n_windows,)
        Middle of the window [s].
    coefficients : ndarray, shape (n_windows, n_targets, n_regressors)
        [A B] of the window.
    condition_number : ndarray, shape (n_windows,)
        Of the column-scaled H_k; infinite where it is rank deficient.
    rank : ndarray of int, shape (n_windows,)
    residual_rms : ndarray, shape (n_windows, n_targets)
    singular_values : ndarray, shape (n_windows, n_regressors)
        Of H_k with its columns scaled to unit length, largest first.
    noise_floor : ndarray, shape (n_windows,)
        What the smallest of them would be if that direction held noise only.
    used : ndarray of bool, shape (n_windows,)
        Full rank and above the noise floor.
    weakest : ndarray, shape (n_regressors,)
        The combination of columns that the windows see least, of unit length,
        columns scaled to unit length too.
    width, stride : int
    period_s : float
        Between the samples inside a window.
    """

    time_s: FloatArray
    coefficients: FloatArray
    condition_number: FloatArray
    rank: IntArray
    residual_rms: FloatArray
    singular_values: FloatArray
    noise_floor: FloatArray
    used: BoolArray
    weakest: FloatArray
    width: int
    stride: int
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """How the model does on data that it was not fitted to; empty maps where there were none.

    ``r2_acceleration`` in the fitted band; ``r2_commanded`` of what follows from the instruments there, empty
    without any; ``r2_simulated_rate`` of the whole rate, ``r2_high_passed_rate`` without what is slower than
    the fitted band.
    ``residual_memory_s``: after so long the residual of the acceleration has
    forgotten itself (autocorrelation below 0.2); ``input_correlation``: its
    largest correlation with the axis' own torque up to half a second apart.
    """

    held_out_s: float
    r2_acceleration: Mapping[str, float] = field(default_factory=dict)
    r2_commanded: Mapping[str, float] = field(default_factory=dict)
    r2_simulated_rate: Mapping[str, float] = field(default_factory=dict)
    r2_high_passed_rate: Mapping[str, float] = field(default_factory=dict)
    fit_percent: Mapping[str, float] = field(default_factory=dict)
    horizon_s: tuple[float, ...] = ()
    horizon_rmse_rad_s: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    residual_memory_s: Mapping[str, float] = field(default_factory=dict)
    input_correlation: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitSeries:
    """Measured and modelled series for figures, NaN between segments.

    All of shape (n_samples, 3) but ``time_s`` (n_samples,) and ``held_out``
    (n_samples,) of bool. Acceleration [rad/s^2] is smoothed as in the fit;
    rate [rad/s]; ``simulated_rate`` starts from the measured one with every
    block that is held out or fitted as a whole.
    """

    time_s: FloatArray
    acceleration: FloatArray
    modelled_acceleration: FloatArray
    rate: FloatArray
    simulated_rate: FloatArray
    held_out: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Discrete:
    """x(k+1) = A_d x(k) + B_d u(k) at the sample period."""

    sample_period_s: float
    states: tuple[str, ...]
    A_d: FloatArray
    B_d: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inertia:
    """Inertia tensor [kg m^2] with 95 % intervals, each of shape (3, 3)."""

    matrix: FloatArray
    ci95_low: FloatArray
    ci95_high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Angular acceleration over torque of one axis in third octaves; each (n_bands,).

    ``frequency_hz`` is where the torque of the band is; ``gain`` complex [rad/s^2 per unit of torque], NaN
    where nothing is known; ``error`` is its relative standard error; ``coherence`` that of the
    acceleration with what it is driven by; ``torque_power`` that of the torque as far as it is driven by it.
    """

    frequency_hz: FloatArray
    gain: NDArray[np.complex128]
    error: FloatArray
    coherence: FloatArray
    torque_power: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandCheck:
    """The same fit in other frequency bands: a true gain does not depend on the band.

    ``low_hz`` (n_bands,) below which nothing was fitted and ``cutoff_hz`` (n_bands,) of the
    smoothing filter, the model's own first; ``on_axis_gain`` (n_bands, 3) is B11, B22, B33 in each.
    """

    low_hz: FloatArray
    cutoff_hz: FloatArray
    on_axis_gain: FloatArray

    @property
    def spread(self) -> FloatArray:
        """Largest deviation from the model's gain, relative to it; shape (3,)."""
        own = np.abs(self.on_axis_gain[0])
        deviation = np.max(np.abs(self.on_axis_gain - self.on_axis_gain[0]), axis=0)
        relative: FloatArray = np.full_like(own, np.inf)
        np.divide(deviation, own, out=relative, where=own > 0.0)
        return relative


#: The squared difference over its variance passes 12.2 in 1 % of flights
#: without a change (Andrews 2003); three axes are looked at, and residuals are not quite normal.
CHANGE_SEEN: Final = 16.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChangeCheck:
    """The likeliest time at which B11, B22, B33 changed, each of shape (3,).

    ``time_s``; the gain ``before`` and ``after``; ``statistic``, the squared
    difference over its variance. NaN on axes that were not excited.
    """

    time_s: FloatArray
    before: FloatArray
    after: FloatArray
    statistic: FloatArray

    @property
    def seen(self) -> BoolArray:
        """Whether the change is beyond chance; shape (3,)."""
        return np.asarray(self.statistic > CHANGE_SEEN, dtype=np.bool_)

    @property
    def relative(self) -> FloatArray:
        """Difference relative to the mean of both; shape (3,)."""
        mean = 0.5 * np.abs(self.before + self.after)
        difference: FloatArray = np.full_like(mean, np.nan)
        np.divide(np.abs(self.after - self.before), mean, out=difference, where=mean > 0.0)
        return difference


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FormulationCheck:
    """B11, B22, B33 in the weak form and in the integral form, with half widths; each (2, 3)."""

    on_axis_gain: FloatArray
    half_width: FloatArray

    @property
    def disagree(self) -> FloatArray:
        """Relative difference beyond what both intervals allow, zero if none; shape (3,)."""
        difference = np.abs(self.on_axis_gain[1] - self.on_axis_gain[0])
        beyond = difference > np.hypot(self.half_width[0], self.half_width[1])
        relative: FloatArray = np.zeros_like(difference)
        own = np.abs(self.on_axis_gain[0])
        np.divide(difference, own, out=relative, where=beyond & (own > 0.0))
        return relative


#: What one more column of an equation stands for.
Effect = Literal[
    "threshold",
    "rotor threshold",
    "limit",
    "tilt",
    "swing",
    "mode",
    "second lag",
    "asymmetry",
    "varying gain",
    "cut steps",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCheck:
    """One more effect in the equation of one axis.

    Attributes
    ----------
    axis : int
        0 roll, 1 pitch, 2 yaw.
    effect : Effect
    statistic : float
        Squared coefficient over its variance (Wald).
    explained : float
        Fraction of what the model leaves of the acceleration.
    shift : float
        By how much the on-axis effectiveness is larger with it, relative.
    most : float
        Upper end of the 95 % interval of that, where it is known; NaN otherwise.
    place : float
        Torque of a dead zone or a limit, frequency of a mode or a swing [Hz]; NaN of the others.
    """

    axis: int
    effect: Effect
    statistic: float
    explained: float
    shift: float
    place: float = float("nan")
    most: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingCheck:
    """The best lag and delay where the delay may be negative: torque stamped after the motion it causes.

    ``half_width_s`` is that of the delay's 95 % interval, ``shift`` (3 values) how much larger the on-axis
    effectiveness is then, relative.
    """

    delay_s: float
    half_width_s: float
    shift: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StructuralCheck:
    """What else the equations could hold.

    Attributes
    ----------
    effects : tuple of EffectCheck
        At most one for each axis and kind: the likeliest level or frequency.
    timing : TimingCheck or None
        None where no earlier torque explains the flight better.
    flight_gain, flight_half_width : ndarray, shape (n_flights, 3)
        On-axis effectiveness of each flight over that of all, and its 95 % interval; no rows for one flight.
    persistence, spread : ndarray, shape (3,)
        Correlation of the deviations of the on-axis effectiveness from one half second to the next, over what
        chance makes of it; rms of these deviations, relative. NaN on axes that were not looked at.
    feedback : ndarray, shape (3,)
        How much larger the on-axis effectiveness may be because a controller answers what disturbs the
        vehicle, relative; where set-points are instruments, as far as they follow the attitude.
    together : ndarray, shape (3,)
        How much larger, relative, the on-axis effectiveness is with all effects that are seen together.
    instrumented : bool
        Set-points are instruments.
    strength : ndarray, shape (3,)
        How strongly they drive each torque: effective F statistic over what it must reach; NaN without any.
    own_timing : ndarray, shape (3,)
        How much larger, relative, the on-axis effectiveness is with lag and delay of the axis' own.
    """

    effects: tuple[EffectCheck, ...]
    timing: TimingCheck | None
    flight_gain: FloatArray
    flight_half_width: FloatArray
    persistence: FloatArray
    spread: FloatArray
    feedback: FloatArray
    instrumented: bool = False
    own_timing: FloatArray = field(default_factory=lambda: np.zeros(3))
    together: FloatArray = field(default_factory=lambda: np.zeros(3))
    strength: FloatArray = field(default_factory=lambda: np.full(3, np.nan))


@dataclass(frozen=True, slots=True, kw_only=True)
class YawReaction:
    """The lead of yaw, by which accelerating rotors turn the vehicle: N + lead_s dN/dt.

    ``ci95_s`` is its 95 % interval.
    """

    lead_s: float
    ci95_s: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """One structure fitted to the flight: target = A @ regressors + B @ inputs.

    Attributes
    ----------
    structure : str
    recommended : bool
        One of a flight's models is.
    states, regressors, targets, inputs : tuple of str
        Their symbols; the regressors are the columns of A, the inputs those of B, the targets the rows.
    A : ndarray, shape (n_targets, n_regressors)
        [rad/s^2 per unit of regressor].
    B : ndarray, shape (n_targets, 3)
        [rad/s^2 per unit of L, M, N].
    parameters : tuple of Parameter
        Every element of A and B with its interval.
    windows : Windows or None
        Solutions of the published method, one per window.
    validation : Validation
        On parts of the flight that the fit never saw.
    actuator : Actuator or None
        Lag and delay [s]; None for a structure that takes the torque as logged.
    inertia : Inertia or None
        [kg m^2]; None for a normalised torque.
    discrete : Discrete or None
        The linear part at the sample period.
    fit : FitSeries or None
        Measured and modelled series.
    smoothing_hz : float
        Cut-off of the filter that regressors and targets passed alike.
    bootstrap_half_width : ndarray, shape (3,), or None
        Of the 95 % intervals of B11, B22, B33 by resampling blocks of the flight.
    criterion : float
        Bayesian information criterion, clusters of correlated residuals counted once; less is better.
    yaw_reaction : YawReaction or None
        None where there is none to be seen.
    yaw_is_inverse_controller : bool
        The yaw torque follows the yaw motion.
    yaw_band : BandCheck or None
        Of yaw, where its equation was fitted in a band of its own.

    Examples
    --------
    >>> import quadid_logs
    >>> models = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").identification.models
    >>> [model.structure for model in models]  # each a Model
    ['rigid-body', 'damped', 'quadrotor-6', 'linear-9']
    """

    structure: str
    recommended: bool
    states: tuple[str, ...]
    regressors: tuple[str, ...]
    targets: tuple[str, ...]
    inputs: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    parameters: tuple[Parameter, ...]
    windows: Windows | None
    validation: Validation
    actuator: Actuator | None = None
    posterior: Posterior | None = None
    inertia: Inertia | None = None
    discrete: Discrete | None = None
    fit: FitSeries | None = None
    smoothing_hz: float = float("nan")
    condition_number: float = float("nan")
    band: BandCheck | None = None
    change: ChangeCheck | None = None
    formulations: FormulationCheck | None = None
    structural: StructuralCheck | None = None
    bootstrap_half_width: FloatArray | None = None
    criterion: float = float("nan")
    note: str = ""
    yaw_reaction: YawReaction | None = None
    yaw_is_inverse_controller: bool = False
    yaw_band: BandCheck | None = None

    def band_of(self, axis: int) -> BandCheck | None:
        """Return the check of the band that an axis (0 roll, 1 pitch, 2 yaw) was fitted in."""
        return self.yaw_band if axis == 2 and self.yaw_band is not None else self.band

    @property
    def entries(self) -> dict[tuple[str, str], Parameter]:
        """The elements of A and B by target and regressor."""
        return {(parameter.target, parameter.regressor): parameter for parameter in self.parameters}

    def __getitem__(self, key: str | tuple[str, str]) -> Parameter:
        """Return one element of A or B.

        Parameters
        ----------
        key : str or tuple of (str, str)
            Its name, as ``"B11"``; or its axis or target, ``"roll"`` or ``"p_dot"``, and its regressor or
            input, ``"L"``.

        Returns
        -------
        Parameter

        Raises
        ------
        KeyError
            If the structure has no such element.
        """
        if isinstance(key, str):
            found = next((each for each in self.parameters if each.name == key), None)
        else:
            found = self.entries.get((_TARGETS.get(key[0], key[0]), key[1]))
        if found is None:
            known = f"{', '.join(self.targets)} and {', '.join((*self.regressors, *self.inputs))}"
            raise KeyError(f"{key!r}: {self.structure} has the targets {known}")
        return found

    def __repr__(self) -> str:
        lines = [f"<{type(self).__name__} {self.structure}: A {self.A.shape}, B {self.B.shape}"]
        lines += [f"  {axis:<5}  {self.entries[key]}" for axis, key in ON_AXIS.items() if key in self.entries]
        return "\n".join(lines) + ">"


_TARGETS = dict(zip(AXES, ACCELERATION_SYMBOLS, strict=True))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorquePath:
    """How acceleration follows torque: lag and roll-off, with their standard errors.

    Advanced by ``lag_s``, torque and acceleration are in phase. The gain falls as 1 - ``roll_off_s2`` times
    omega squared, about half of the squared time constant of a first-order lag. ``explained``: fraction of
    the acceleration, every frequency with the same weight. ``p_value``: that of a torque which acts through
    rotors and filters, but looks as if nothing lay between.
    """

    lag_s: float
    lag_error_s: float
    roll_off_s2: float
    roll_off_error_s2: float
    explained: float
    p_value: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation:
    """How much an axis was moved, against what noise alone would show.

    ``torque_rms`` in the input's unit, ``rate_rms_rad_s``; ``signal_to_noise``
    is the ratio of explained to unexplained acceleration in the fitted band;
    spectra of the rate and the torque over ``frequency_hz`` (n_frequencies,)
    with their ``coherence``. ``difference_r2``: how much of the torque above all motion a difference of
    neighbouring rates explains, NaN in slow logs; ``bandwidth``: standard deviation of the torque's frequency
    over its mean, in the fitted band; ``line_fraction`` of its power is in the strongest line, at
    ``line_hz``.
    ``path``: what lies between torque and acceleration, None where the flight is too short to tell.
    """

    axis: str
    torque_rms: float
    rate_rms_rad_s: float
    signal_to_noise: float
    frequency_hz: FloatArray
    rate_psd: FloatArray
    torque_psd: FloatArray
    coherence: FloatArray
    bandwidth: float = float("nan")
    line_hz: float = float("nan")
    line_fraction: float = float("nan")
    path: TorquePath | None = None
    difference_r2: float = float("nan")


def _nothing() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustCurve:
    """The expo of the propellers' thrust curve, (1 - e) y + e y^2 of the throttle y.

    Attributes
    ----------
    expo : float
        As found; as assumed where it is not identifiable.
    ci95 : tuple of float
    assumed : float
        With which the firmware flew.
    parameter : str
        That sets it; empty where none does.
    identifiable : bool
    reason : str
        Why not.
    corrected : bool
        The models are fitted to the torque of the expo that was found.
    measured : bool
        What was assumed is what the measured speeds of the rotors tell.
    thrust_over_mean : ndarray, shape (n,)
        Levels of thrust that were flown, over its mean while the vehicle was moved.
    effectiveness : ndarray, shape (n,)
        Effectiveness per unit of command there, over that at the mean; 1 throughout where the
        firmware's curve is that of the propellers.
    effectiveness_ci95 : ndarray, shape (n, 2)
    """

    expo: float
    ci95: tuple[float, float]
    assumed: float
    parameter: str
    identifiable: bool
    reason: str = ""
    corrected: bool = False
    measured: bool = False
    thrust_over_mean: FloatArray = field(default_factory=_nothing)
    effectiveness: FloatArray = field(default_factory=_nothing)
    effectiveness_ci95: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))


#: A response that departs from one gain, lag and delay by more than this is none of a rigid body with rotors.
_MOST_DEPARTURE = 0.1
#: A commanded acceleration of which a quarter is left does not follow from one equation: as of all fits.
_LEAST_COMMANDED_R2 = 0.75
#: Beyond, a number is of no use to tune with, and what else may be wrong is as large.
_MOST_HALF_WIDTH = 0.2
#: The ends of an interval are 4.4 dB apart then: a loop that is tuned for its middle keeps most of 6 dB.
_WIDEST = 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralFit:
    """What the answers to commands alone tell of one axis, whatever the air did.

    Attributes
    ----------
    mean : ndarray, shape (5,)
        As of `Posterior`: effectiveness, damping, lag, delay, reaction; of the rates as the gyro shows them.
    covariance : ndarray, shape (5, 5)
    departure : float
        Relative size (rms) of what the measured response has beside one gain, lag, delay and damping.
    commanded : float
        Power of the torque that goes with what was commanded over that of all of it.
    r2_commanded : float
        Fraction of the commanded acceleration that the equation explains, each frequency over its noise.
    n_blocks : int
        Half-overlapping segments of the flight that were compared.
    half_width : float
        Of the 95 % interval of the effectiveness, the gyro's scale included.
    used : bool
        The model's equation of this axis is this one.
    alone : bool
        A fit in time explains too little to stand beside it: commands tell this axis, or nothing does.
    planned : bool
        What was commanded is a planned trajectory. The torque of its controller follows the motion, and
        explains it well whatever the effectiveness is.
    repeated : bool
        The planned trajectory is known by several flights that repeat it.
    effects : tuple of Effect
        What the flight shows beside a linear response, of which the estimate knows.
    shift : float
        How much larger, relative, the effectiveness is with them than without.
    variation : float
        Root mean square by which the effectiveness comes and goes over the flight, relative to its mean.
    by_effects : float
        Half of the 95 % interval, relative, of what effects that are shown or left open make of an
        effectiveness that knows of none, and of what departs from one lag, gain and damping.
    """

    mean: FloatArray
    covariance: FloatArray
    departure: float
    commanded: float
    r2_commanded: float
    n_blocks: int
    half_width: float
    used: bool = False
    alone: bool = False
    planned: bool = False
    repeated: bool = False
    effects: tuple[Effect, ...] = ()
    shift: float = 0.0
    variation: float = 0.0
    by_effects: float = 0.0

    @property
    def gain(self) -> float:
        """Effectiveness [rad/s^2 per unit of torque]."""
        return float(self.mean[0])

    @property
    def follows_commands(self) -> bool:
        """Whether it is a vehicle's response to commands, however wide its interval is."""
        return bool(self.r2_commanded >= _LEAST_COMMANDED_R2)

    @property
    def is_described(self) -> bool:
        """Whether one gain, lag, delay and damping describe the response."""
        return bool(self.departure <= _MOST_DEPARTURE)

    @property
    def is_sound(self) -> bool:
        """Whether the effectiveness is told: narrow, positive, and of a vehicle's response to commands."""
        return self.is_of_use and self.half_width <= _MOST_HALF_WIDTH * self.gain

    @property
    def is_of_use(self) -> bool:
        """Whether the effectiveness is that of a vehicle's response to commands, and told to a quarter."""
        described = self.is_described and self.follows_commands
        return described and 0.0 < self.half_width <= _WIDEST * self.gain

    @property
    def is_told(self) -> bool:
        """Whether the model's equation of this axis is this one, and of use."""
        return self.used and self.is_of_use

    @property
    def is_known(self) -> bool:
        """Whether it is a vehicle's response to commands with an effectiveness, to whatever width."""
        return self.follows_commands and 0.0 < self.half_width < self.gain

    @property
    def tells_nothing(self) -> bool:
        """Whether commands leave open that the torque has no effect at all."""
        return not self.half_width < self.gain


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """All structures fitted to one flight, the recommended one first.

    ``n_samples`` of the aligned flight were used: all but for very long flights. ``responses``
    of roll, pitch and yaw are those to the rate setpoints where these serve as instruments,
    else to the torque; empty where no segment is long enough. ``thrust_curve`` is None where
    the torque was rebuilt from no assumed curve. ``only_yaw``: the log is too slow for anything else.
    ``spectral`` of roll, pitch and yaw is empty where nothing tells what was commanded.
    """

    models: tuple[Model, ...] = ()
    excitation: tuple[Excitation, ...] = ()
    responses: tuple[Response, ...] = ()
    skipped: str = ""
    n_samples: int = 0
    thrust_curve: ThrustCurve | None = None
    only_yaw: bool = False
    spectral: tuple[SpectralFit, ...] = ()

    @property
    def recommended(self) -> Model | None:
        """The model to use, None where nothing could be fitted."""
        return next((model for model in self.models if model.recommended), None)

    def __repr__(self) -> str:
        fitted = ", ".join(model.structure for model in self.models) or f"nothing: {self.skipped!a}"
        return f"<{type(self).__name__} of {self.n_samples} samples: {fitted}>"
