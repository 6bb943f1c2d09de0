"""Results of the stage `identify`: models, their intervals and their checks."""

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
    """One element of A or B with its 95 % interval.

    Attributes
    ----------
    name : str
        Name by row and column: "B11", "A17".
    target, regressor : str
        In the equation of ``target``, ``value`` multiplies ``regressor`` (or input).
    value : float
        The estimate, in `unit`.
    unit : str
        Unit of the target over unit of the regressor.
    ci95 : tuple of float
        Lower and upper end of the 95 % interval, in `unit`.
    identifiable : bool
        Whether this flight identifies the value.
    reason : str
        Why it is not identifiable.
    half_width : float
        Half width of the 95 % interval before it was widened for possible unmodelled effects.

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

    ``lag_s`` and ``delay_s`` [s] have 95 % intervals. ``loss`` has shape (n_lags, n_delays): one minus the
    R2 on validation data, over ``lag_grid_s`` and ``delay_grid_s``. If the lag acts on the rotor speed,
    ``lag_s`` is the mean of ``lag_up_s`` and ``lag_down_s``; otherwise both are NaN.
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
        """Whether the 95 % interval of the lag is narrow enough to use."""
        return _narrow(self.lag_s, self.lag_ci95_s) and not self.at_bound

    @property
    def delay_identifiable(self) -> bool:
        """Whether the 95 % interval of the delay is narrow enough to use."""
        return _narrow(self.delay_s, self.delay_ci95_s) and not self.at_bound

    @property
    def at_bound(self) -> bool:
        """Whether lag or delay is at the upper bound of the search; then neither is identified."""
        pairs = ((self.lag_s, self.lag_grid_s), (self.delay_s, self.delay_grid_s))
        return any(value_s >= _AT_BOUND * grid_s.max(initial=0.0) for value_s, grid_s in pairs if grid_s.size)


#: A search ends within this distance of a bound that it would cross.
_AT_BOUND = 0.99
#: A half width of a fifth is a standard deviation of a tenth. A wider interval gives a magnitude only.
_MOST_RELATIVE = 0.2


def _narrow(value_s: float, ci95_s: tuple[float, float]) -> bool:
    """Return whether an interval is narrow relative to its value."""
    low, high = ci95_s
    return bool(0.5 * (high - low) <= _MOST_RELATIVE * value_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """Joint estimate, by axis, of the five numbers that a control loop depends on.

    Attributes
    ----------
    mean : ndarray, shape (3, 5)
        For each axis: on-axis effectiveness [rad/s^2 per unit of torque] and on-axis damping [1/s], both for
        the rates that the gyro measures; lag and delay of the actuator [s]; for yaw the reaction of
        accelerating rotors [rad/s per unit of torque], zero if not detected.
    covariance : ndarray, shape (3, 5, 5)
        Covariance of the five numbers; not finite if the axis is not identified. It excludes the errors of
        gyro scale and torque calibration, which cancel around a loop.
    lag_or_delay_s : float
        Part of the delay that may be lag [s]: the flight cannot separate the two.
    only_brakes : tuple of bool
        By axis: the damping estimate is zero, the bound of what rotors and air can do.
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
    """The solutions of the windowed least-squares problem, one for each window with matrix H_k.

    Attributes
    ----------
    time_s : ndarray, shape (n_windows,)
        Middle of the window [s].
    coefficients : ndarray, shape (n_windows, n_targets, n_regressors)
        [A B] of the window.
    condition_number : ndarray, shape (n_windows,)
        Condition number of H_k with scaled columns; infinite if H_k is rank deficient.
    rank : ndarray of int, shape (n_windows,)
        Rank of H_k.
    residual_rms : ndarray, shape (n_windows, n_targets)
        Rms of the residual, in the unit of the target.
    singular_values : ndarray, shape (n_windows, n_regressors)
        Singular values of H_k with columns scaled to unit length, largest first.
    noise_floor : ndarray, shape (n_windows,)
        Value of the smallest singular value if its direction contained noise only.
    used : ndarray of bool, shape (n_windows,)
        Whether the window has full rank and lies above the noise floor.
    weakest : ndarray, shape (n_regressors,)
        The least excited combination of columns: a unit vector, for columns scaled to unit length.
    width, stride : int
        Length of a window and step between windows, in samples.
    period_s : float
        Time between the samples of a window [s].
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
    """Scores of the model on validation data, by target or rate; empty if there are no validation data.

    ``r2_acceleration`` is the R2 of the acceleration in the fitted band. ``r2_commanded`` is the R2 of the
    part that follows from the instruments; it is empty without instruments. ``r2_simulated_rate`` is the R2
    of the whole simulated rate, ``r2_high_passed_rate`` that of the rate above the lower edge of the band.
    ``horizon_rmse_rad_s`` holds the errors of the rate [rad/s] after each time of ``horizon_s`` [s].
    ``residual_memory_s`` is the time [s] after which the autocorrelation of the acceleration residual falls
    below 0.2. ``input_correlation`` is the largest correlation of that residual with the torque of the same
    axis, at time shifts up to half a second.
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

    ``time_s`` [s] and ``held_out`` (bool, validation data) have shape (n_samples,). All others have shape
    (n_samples, 3). Accelerations [rad/s^2] are smoothed as in the fit. Rates are in [rad/s].
    ``simulated_rate`` starts from the measured rate at the beginning of each fitted or held-out block.
    """

    time_s: FloatArray
    acceleration: FloatArray
    modelled_acceleration: FloatArray
    rate: FloatArray
    simulated_rate: FloatArray
    held_out: BoolArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Discrete:
    """The discrete-time model x(k+1) = A_d x(k) + B_d u(k) at ``sample_period_s`` [s]."""

    sample_period_s: float
    states: tuple[str, ...]
    A_d: FloatArray
    B_d: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inertia:
    """Inertia tensor [kg m^2] and its 95 % interval, all of shape (3, 3)."""

    matrix: FloatArray
    ci95_low: FloatArray
    ci95_high: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Frequency response from torque to angular acceleration of one axis, in third octaves; shape (n_bands,).

    ``frequency_hz`` is the mean frequency of the torque in the band. ``gain`` is complex [rad/s^2 per unit of
    torque], NaN if it is not known. ``error`` is its relative standard error. ``coherence`` is that of the
    acceleration with the instrument (set-point, else torque). ``torque_power`` is the power of the torque
    that is coherent with the instrument.
    """

    frequency_hz: FloatArray
    gain: NDArray[np.complex128]
    error: FloatArray
    coherence: FloatArray
    torque_power: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandCheck:
    """The same fit in other frequency bands: the true effectiveness does not depend on the band.

    ``low_hz`` (n_bands,) is the lower edge of each band [Hz], ``cutoff_hz`` (n_bands,) the cut-off of the
    smoothing filter [Hz]. The first band is that of the model. ``on_axis_gain`` (n_bands, 3) is B11, B22, B33
    [rad/s^2 per unit of torque] in each band.
    """

    low_hz: FloatArray
    cutoff_hz: FloatArray
    on_axis_gain: FloatArray

    @property
    def spread(self) -> FloatArray:
        """Largest relative deviation from the model's on-axis effectiveness; shape (3,)."""
        own = np.abs(self.on_axis_gain[0])
        deviation = np.max(np.abs(self.on_axis_gain - self.on_axis_gain[0]), axis=0)
        relative: FloatArray = np.full_like(own, np.inf)
        np.divide(deviation, own, out=relative, where=own > 0.0)
        return relative


#: The squared difference over its variance exceeds 12.2 in 1 % of flights without a change (Andrews 2003).
#: Three axes are tested, and residuals are not quite normal.
CHANGE_SEEN: Final = 16.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChangeCheck:
    """The most likely time of a change of B11, B22, B33; all arrays have shape (3,).

    ``time_s`` is the time of the change [s]; ``before`` and ``after`` are the effectiveness [rad/s^2 per unit
    of torque]. ``statistic`` is the squared difference over its variance. Axes without excitation are NaN.
    """

    time_s: FloatArray
    before: FloatArray
    after: FloatArray
    statistic: FloatArray

    @property
    def seen(self) -> BoolArray:
        """Whether the change is significant; shape (3,)."""
        return np.asarray(self.statistic > CHANGE_SEEN, dtype=np.bool_)

    @property
    def relative(self) -> FloatArray:
        """Difference of after and before relative to their mean; shape (3,)."""
        mean = 0.5 * np.abs(self.before + self.after)
        difference: FloatArray = np.full_like(mean, np.nan)
        np.divide(np.abs(self.after - self.before), mean, out=difference, where=mean > 0.0)
        return difference


#: The physical effect that an additional column of an equation represents.
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
    """Test of an additional effect in the equation of one axis.

    Attributes
    ----------
    axis : int
        0 roll, 1 pitch, 2 yaw.
    effect : Effect
    statistic : float
        Wald statistic: squared coefficient over its variance.
    explained : float
        Fraction of the model's acceleration residual that the effect explains.
    shift : float
        Relative increase of the on-axis effectiveness if the effect is included.
    most : float
        Upper end of the 95 % interval of ``shift``; NaN if not known.
    place : float
        Torque of a dead zone or a saturation, frequency of a mode or a swing [Hz]; NaN for other effects.
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
    """The best fit with a negative delay allowed: the torque is stamped after the motion that it causes.

    ``delay_s`` is the delay [s], ``half_width_s`` half of its 95 % interval. ``shift`` (3 values) is the
    relative increase of the on-axis effectiveness with that delay.
    """

    delay_s: float
    half_width_s: float
    shift: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StructuralCheck:
    """Tests of effects that the equations of the model do not contain.

    Attributes
    ----------
    effects : tuple of EffectCheck
        At most one for each axis and kind of effect, at its most likely level or frequency.
    timing : TimingCheck or None
        None if no negative delay fits the flight better.
    flight_gain, flight_half_width : ndarray, shape (n_flights, 3)
        On-axis effectiveness of each flight over that of all flights, and half of its 95 % interval. There
        are no rows for a single flight.
    persistence : ndarray, shape (3,)
        Correlation of the deviations of the on-axis effectiveness between successive half seconds, over its
        standard deviation by chance. NaN on axes that were not tested.
    spread : ndarray, shape (3,)
        Rms of these deviations, relative to the effectiveness. NaN on axes that were not tested.
    feedback : ndarray, shape (3,)
        Possible relative increase of the on-axis effectiveness because the controller reacts to disturbances.
        If set-points are instruments, only the part that follows the attitude counts.
    instrumented : bool
        Whether set-points are instruments.
    strength : ndarray, shape (3,)
        Strength of the instruments for each torque: effective F statistic over its critical value. NaN
        without instruments.
    own_timing : ndarray, shape (3,)
        Relative increase of the on-axis effectiveness if the axis has its own lag and delay.
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
    strength: FloatArray = field(default_factory=lambda: np.full(3, np.nan))


@dataclass(frozen=True, slots=True, kw_only=True)
class YawReaction:
    """Reaction torque of accelerating rotors in yaw, as a lead: N + lead_s dN/dt.

    ``lead_s`` is the lead [s], ``ci95_s`` its 95 % interval [s].
    """

    lead_s: float
    ci95_s: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """One structure fitted to the flight: target = A @ regressors + B @ inputs.

    Attributes
    ----------
    structure : str
        Name of the structure.
    recommended : bool
        Whether this is the recommended model. Each flight has at most one.
    states, regressors, targets, inputs : tuple of str
        Symbols. The regressors are the columns of A, the inputs the columns of B, the targets the rows.
    A : ndarray, shape (n_targets, n_regressors)
        [rad/s^2 per unit of regressor].
    B : ndarray, shape (n_targets, 3)
        Control effectiveness [rad/s^2 per unit of L, M, N].
    parameters : tuple of Parameter
        Every element of A and B with its 95 % interval.
    windows : Windows or None
        Solutions of the published method, one for each window.
    validation : Validation
        Scores on validation data.
    actuator : Actuator or None
        Lag and delay [s]; None for a structure that uses the logged torque directly.
    inertia : Inertia or None
        Inertia tensor [kg m^2]; None for a normalised torque.
    discrete : Discrete or None
        The linear part at the sample period.
    fit : FitSeries or None
        Measured and modelled series.
    smoothing_hz : float
        Cut-off of the filter on regressors and targets [Hz].
    criterion : float
        Bayesian information criterion; clusters of correlated residuals count once. Lower is better.
    yaw_reaction : YawReaction or None
        None if no reaction of the rotors was detected.
    yaw_is_inverse_controller : bool
        Whether the yaw torque is the controller's reaction to the yaw motion.
    yaw_band : BandCheck or None
        Band check of yaw, if yaw was fitted in a separate band.

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
    structural: StructuralCheck | None = None
    criterion: float = float("nan")
    note: str = ""
    yaw_reaction: YawReaction | None = None
    yaw_is_inverse_controller: bool = False
    yaw_band: BandCheck | None = None

    def band_of(self, axis: int) -> BandCheck | None:
        """Return the check of the frequency band of an axis (0 roll, 1 pitch, 2 yaw)."""
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
            The name, such as ``"B11"``. Or a pair: the axis or target (``"roll"`` or ``"p_dot"``), and the
            regressor or input (``"L"``).

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
    """Phase lag and roll-off between torque and acceleration, with their standard errors.

    Torque and acceleration are in phase if the acceleration is advanced by ``lag_s`` [s]. The gain falls as
    1 - ``roll_off_s2`` omega^2; for a first-order lag, ``roll_off_s2`` [s^2] is about half of the squared
    time constant. ``explained`` is the fraction of the acceleration, with equal weight at all frequencies.
    ``p_value`` is the probability that a torque which passes rotors and filters shows so little lag.
    """

    lag_s: float
    lag_error_s: float
    roll_off_s2: float
    roll_off_error_s2: float
    explained: float
    p_value: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excitation:
    """The excitation of one axis, compared with noise.

    ``torque_rms`` is in the unit of the input, ``rate_rms_rad_s`` in [rad/s]. ``signal_to_noise`` is the
    ratio of explained to unexplained acceleration in the fitted band. ``rate_psd``, ``torque_psd`` and
    ``coherence`` (n_frequencies,) are spectra over ``frequency_hz``.
    ``bandwidth`` is the standard deviation of the torque's frequency over its mean, in the fitted band. The
    strongest line is at ``line_hz`` [Hz] and has ``line_fraction`` of the power.
    ``path`` describes the transfer from torque to acceleration, None if the flight is too short.
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


def _nothing() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustCurve:
    """The expo e of the propellers' thrust curve (1 - e) y + e y^2, for the throttle y.

    Attributes
    ----------
    expo : float
        The estimate, or the assumed value if the expo is not identifiable.
    ci95 : tuple of float
        The 95 % interval of the expo.
    assumed : float
        The expo that the firmware used in flight.
    parameter : str
        The parameter that sets it; empty if there is none.
    identifiable : bool
        Whether this flight identifies the expo.
    reason : str
        Why it is not identifiable.
    corrected : bool
        Whether the models are fitted to the torque for the estimated expo.
    measured : bool
        Whether the assumed expo was computed from measured rotor speeds.
    thrust_over_mean : ndarray, shape (n,)
        Flown levels of thrust, over the mean thrust during excitation.
    effectiveness : ndarray, shape (n,)
        Effectiveness per unit of command at these levels, over that at the mean thrust. It is 1 throughout
        if the firmware's curve is that of the propellers.
    effectiveness_ci95 : ndarray, shape (n, 2)
        Its 95 % interval.
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


#: A response that departs more from one gain, lag and delay is not that of a rigid body with rotors.
_MOST_DEPARTURE = 0.1
#: One equation does not describe a commanded acceleration of which a quarter is unexplained, as in all fits.
_LEAST_COMMANDED_R2 = 0.75
#: A wider interval is of no use for tuning, and other errors may be as large.
_MOST_HALF_WIDTH = 0.2
#: The ends of such an interval are 4.4 dB apart. A loop that is tuned for its middle keeps most of 6 dB.
_WIDEST = 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectralFit:
    """Frequency-domain estimate of one axis from its response to commands, insensitive to disturbances.

    Attributes
    ----------
    mean : ndarray, shape (5,)
        On-axis effectiveness [rad/s^2 per unit of torque], damping [1/s], lag [s], delay [s] and reaction of
        the rotors [rad/s per unit of torque], for the rates that the gyro measures.
    covariance : ndarray, shape (5, 5)
        Covariance of these five numbers.
    departure : float
        Relative rms by which the measured response departs from one gain, lag, delay and damping.
    commanded : float
        Fraction of the torque's power that is coherent with the commands.
    r2_commanded : float
        R2 of the commanded acceleration; each frequency is weighted by the inverse of its noise.
    n_blocks : int
        Number of half-overlapping segments of the flight.
    half_width : float
        Half width of the 95 % interval of the effectiveness, including the scale error of the gyro.
    skew : float
        How far the middle of that interval lies above the effectiveness, relative. Positive where one
        frequency cannot tell a long lag from a smaller effectiveness.
    used : bool
        Whether the model uses this estimate for the axis.
    alone : bool
        Whether this is the only possible estimate, because the fit in time explains too little.
    planned : bool
        Whether the command is a planned trajectory. The torque of its controller then follows the motion, and
        explains it well for any effectiveness.
    repeated : bool
        Whether the planned trajectory was obtained from several flights that repeat it.
    effects : tuple of Effect
        Detected deviations from a linear response, which the estimate includes.
    shift : float
        Relative increase of the effectiveness by these effects, and on the mean by those that are possible.
    variation : float
        Rms variation of the effectiveness over the flight, relative to its mean.
    by_effects : float
        Relative half width of the 95 % interval of the bias by effects, detected or possible, and by the
        departure from one lag, gain and damping.
    """

    mean: FloatArray
    covariance: FloatArray
    departure: float
    commanded: float
    r2_commanded: float
    n_blocks: int
    half_width: float
    skew: float = 0.0
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
        """Control effectiveness [rad/s^2 per unit of torque]."""
        return float(self.mean[0])

    @property
    def follows_commands(self) -> bool:
        """Whether the axis responds to commands like a vehicle, for any width of the interval."""
        return bool(self.r2_commanded >= _LEAST_COMMANDED_R2)

    @property
    def is_described(self) -> bool:
        """Whether one gain, lag, delay and damping describe the response."""
        return bool(self.departure <= _MOST_DEPARTURE)

    @property
    def is_sound(self) -> bool:
        """Whether `is_of_use` holds, with an interval that is narrow enough for tuning."""
        return self.is_of_use and self.half_width <= _MOST_HALF_WIDTH * self.gain

    @property
    def is_of_use(self) -> bool:
        """Whether the effectiveness is identified to a quarter, from a vehicle's response to commands."""
        described = self.is_described and self.follows_commands
        return described and 0.0 < self.half_width <= _WIDEST * self.gain

    @property
    def is_told(self) -> bool:
        """Whether the model uses this estimate and it is of use."""
        return self.used and self.is_of_use

    @property
    def is_known(self) -> bool:
        """Whether the axis responds to commands like a vehicle, and the interval excludes zero."""
        return self.follows_commands and 0.0 < self.half_width < self.gain

    @property
    def tells_nothing(self) -> bool:
        """Whether the 95 % interval of the effectiveness contains zero."""
        return not self.half_width < self.gain


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """All structures fitted to one flight, the recommended one first.

    ``n_samples`` is the number of aligned samples used: all, except for very long flights. ``responses``
    (roll, pitch, yaw) use the rate set-points as instruments if possible, else the torque. They are empty if
    no segment is long enough. ``thrust_curve`` is None if no thrust curve was assumed. ``only_yaw`` means
    that the sample rate of the log is sufficient for yaw only. ``spectral`` (roll, pitch, yaw) is empty if
    the commands are not known. ``skipped`` says why nothing was identified.
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
        """The recommended model, None if no model could be fitted."""
        return next((model for model in self.models if model.recommended), None)

    def __repr__(self) -> str:
        fitted = ", ".join(model.structure for model in self.models) or f"nothing: {self.skipped!a}"
        return f"<{type(self).__name__} of {self.n_samples} samples: {fitted}>"
