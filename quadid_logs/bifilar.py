"""Moment of inertia from a bifilar swing: a vehicle that rotates to and fro on two strings, by its gyro."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from quadid_logs.align import clean
from quadid_logs.align.series import CleanSeries
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog
from quadid_logs.errors import LogError, SettingsError
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.maths.random_effect import random_effect_mean
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2

#: Largest relative difference of gravity on Earth's surface from the standard (9.780 to 9.832 m/s^2).
_GRAVITY_HALF_WIDTH = 0.0027
#: Accuracy of a ruler [m] and of a kitchen scale (relative): half widths of 95 % intervals.
_LENGTH_HALF_WIDTH_M = 0.001
_MASS_HALF_WIDTH = 0.005
#: Strings of 5 cm to 10 m and any vehicle swing in this range [Hz].
_SLOWEST_HZ, _FASTEST_HZ = 0.05, 5.0
#: Five swings give the period to a thousandth, if the gyro noise is a hundredth of their size.
_FEWEST_PERIODS = 5
#: The hand that lets go disturbs the first period. Below a tenth of the first amplitude, noise dominates.
_SETTLING_PERIODS, _FAINTEST = 1.0, 0.1
#: A swing that grows by more than this was pushed.
_PUSHED = 1.15
#: A swing weaker than this, relative to the strongest, is not counted.
_LEAST_PUSH = 0.3
#: A fit of a true swing leaves less of the power unexplained than this; of a walk or a flight, more.
_MOST_LEFT = 0.05
#: At larger angles, strings go slack or hit each other [rad].
_MOST_AMPLITUDE = math.radians(100.0)
#: Air density at 15 degrees Celsius and sea level (ISO 2533) [kg/m^3].
_AIR_KG_M3 = 1.225
_MOST_RATE_HZ = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bifilar:
    """The suspension: mass of the vehicle [kg], length of the two strings and distance between them [m].

    The half widths are those of 95 % intervals, in the unit of the quantity. NaN for the mass means half a
    per cent. ``span_m`` is the largest dimension across the axis [m]; 0 omits the inertia of moving air.

    Examples
    --------
    >>> hung = Bifilar(mass_kg=1.6, length_m=0.9, distance_m=0.4)
    >>> round(hung.relative_half_width, 4)  # of the moment of inertia, by mass, strings and gravity
    0.0077
    """

    mass_kg: float
    length_m: float
    distance_m: float
    mass_half_width_kg: float = math.nan
    length_half_width_m: float = _LENGTH_HALF_WIDTH_M
    distance_half_width_m: float = _LENGTH_HALF_WIDTH_M
    span_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass_kg", "length_m", "distance_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise SettingsError(f"{name} is {value:g}.", hint="Give a positive number, in kg and m.")
        for name in ("length_half_width_m", "distance_half_width_m", "span_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise SettingsError(f"{name} is {value:g}.", hint="Give a number of m, not negative.")
        if self.mass_half_width_kg < 0.0 or math.isinf(self.mass_half_width_kg):
            raise SettingsError(f"mass_half_width_kg is {self.mass_half_width_kg:g}.", hint="Give kg.")
        if self.distance_m >= 2.0 * self.length_m:
            raise SettingsError(
                f"Strings of {self.length_m:g} m are too short for a distance of {self.distance_m:g} m "
                "between them.",
                hint="Use strings that are longer than the distance between them. Give all lengths in m.",
            )

    @property
    def relative_half_width(self) -> float:
        """Relative half width of the 95 % interval of m g d^2 / (4 h omega^2) by mass, strings, gravity."""
        mass = (
            self.mass_half_width_kg
            if math.isfinite(self.mass_half_width_kg)
            else _MASS_HALF_WIDTH * self.mass_kg
        )
        return math.hypot(
            mass / self.mass_kg,
            self.length_half_width_m / self.length_m,
            2.0 * self.distance_half_width_m / self.distance_m,
            _GRAVITY_HALF_WIDTH,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One swing, from a push until it has died away.

    Attributes
    ----------
    start_s, end_s : float
        Start and end on the log's clock [s].
    period_s : float
        Period for small amplitudes without damping [s].
    period_half_width_s : float
        Half of the 95 % interval of the period [s].
    amplitude_deg : float
        Amplitude of the first oscillation used [deg].
    linear_1_s, quadratic : float
        Damping: the rate decays as d(rate)/dt = -linear rate - quadratic rate |rate| [1/s, 1/rad].
    fraction_left : float
        Fraction of the power that the fit does not explain.
    moment_kg_m2, half_width_kg_m2 : float
        Moment of inertia from this run, and half of its 95 % interval by the error of the period [kg m^2].
    """

    start_s: float
    end_s: float
    period_s: float
    period_half_width_s: float
    amplitude_deg: float
    linear_1_s: float
    quadratic: float
    fraction_left: float
    moment_kg_m2: float
    half_width_kg_m2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Swing:
    """Moment of inertia [kg m^2] about the body axis that was vertical, with its 95 % interval ``ci95``.

    ``air_kg_m2`` is the largest possible inertia of air that moved with the vehicle. It makes ``ci95``
    asymmetric, with the longer side below the estimate. ``runs`` holds the swings, ``source`` names the gyro
    signal, and ``rate_hz`` is its sample rate [Hz].
    """

    axis: str
    moment_kg_m2: float
    ci95: tuple[float, float]
    air_kg_m2: float
    runs: tuple[Run, ...]
    source: str
    rate_hz: float


def swing(
    log: FlightLog, hung: Bifilar, axis: str = "", *, start_s: float = -math.inf, end_s: float = math.inf
) -> Swing:
    """Return the moment of inertia about the vertical axis of a vehicle that swings on two parallel strings.

    Parameters
    ----------
    log : FlightLog
        A log with gyro rates during the swing.
    hung : Bifilar
        The suspension.
    axis : str
        "roll", "pitch" or "yaw": the vertical body axis. "" takes the axis with the largest rotation.
    start_s, end_s : float
        The part of the log to use, on its clock [s].

    Returns
    -------
    Swing

    Raises
    ------
    SettingsError
        If there is no such axis.
    LogError
        If the log has no rates in that part, or nothing swings in it.

    Notes
    -----
    A vehicle of mass m hangs on strings of length h at distance d. Rotated by theta, it rises by
    h - sqrt(h^2 - d^2 sin^2(theta/2)). For small angles, I = m g d^2 / (4 h omega^2). For larger angles, the
    period follows from the energy by quadrature, including the kinetic energy of the rise. Damping is linear
    and quadratic in the rate; averaging gives amplitude and phase (M. Jardin and E. Mueller, "Optimized
    measurements of UAV mass moment of inertia with a bifilar pendulum", AIAA 2007-6822).

    Examples
    --------
    A log with the rates of one swing of 1.1 s, about the yaw axis:

    >>> from dataclasses import replace
    >>> from quadid_logs import read_log
    >>> log = read_log("sample_logs/sysid-quad-x.bin")
    >>> gyro = log.candidates("body_rate")[0]
    >>> time_s = gyro.rows.time_s - gyro.rows.time_s[0]
    >>> rate = np.exp(-time_s / 60.0) * np.sin(2.0 * np.pi / 1.1 * time_s)
    >>> log = replace(log, signals={"body_rate": (replace(gyro, values=np.outer(rate, [0.0, 0.0, 0.5])),)})
    >>> found = swing(log, Bifilar(mass_kg=1.6, length_m=0.9, distance_m=0.4))
    >>> found.axis, round(found.moment_kg_m2, 3)
    ('yaw', 0.021)
    """
    if axis and axis not in AXES:
        raise SettingsError(f"There is no axis {axis!r}.", hint=f"Give one of {', '.join(AXES)}.")
    # The body rates that were logged fastest.
    cleaned = clean(log)
    found = [
        each
        for name in ("body_rate_raw", "body_rate")
        for each in cleaned.candidates.get(name, ())
        if each.n_samples > 2 and math.isfinite(each.period_s)
    ]
    if not found:
        raise LogError("The log has no body rates with time stamps.", hint="Log the gyro while disarmed.")
    series = min(found, key=lambda each: each.period_s)
    series = series.take(series.within(start_s, end_s))
    if series.n_samples < 2:
        raise LogError(
            "The chosen part of the log has no body rates.",
            hint="Give --start-s and --end-s on the log's clock: `quadid-log info LOG` shows it.",
        )
    # The axis with the largest rotation.
    number = AXES.index(axis) if axis else int(np.argmax(np.var(series.values, axis=0)))
    time_s, rate = _uniform(series, number)
    # The frequency of the strongest line, in the range of bifilar swings.
    n = time_s.size
    power = np.abs(np.fft.rfft((rate - rate.mean()) * np.hanning(n), 4 * n)) ** 2
    line_hz = np.fft.rfftfreq(4 * n, time_s[1] - time_s[0])
    near = (line_hz > _SLOWEST_HZ) & (line_hz < _FASTEST_HZ)
    if not near.any() or not power[near].any():
        raise LogError("The log shows no rotation.", hint="Log the gyro while disarmed.")
    frequency_hz = float(line_hz[near][np.argmax(power[near])])
    candidates = (
        _fitted(time_s, rate, frequency_hz, span, hung) for span in _spans(time_s, rate, frequency_hz)
    )
    runs = tuple(each for each in candidates if each is not None and each.fraction_left < _MOST_LEFT)
    if not runs:
        raise LogError(
            f"The log shows no swing about {AXES[number]} that lasts for five periods.",
            hint=(
                "Log the gyro while disarmed. Turn the vehicle by 10 degrees, let go, and wait for a "
                "minute and for at least ten swings. Name the vertical axis with --axis."
            ),
        )
    mean = random_effect_mean(
        np.array([each.moment_kg_m2 for each in runs]), np.array([each.half_width_kg_m2 for each in runs])
    )
    half = math.hypot(mean.half_width, hung.relative_half_width * mean.value)
    # The largest possible inertia of moving air. A flat disc that rotates about its diameter moves
    # 16/45 rho a^5 (H. Lamb, Hydrodynamics, article 108), a vehicle with rotors in a plane less. Rotation in
    # that plane, as in yaw, moves no air.
    air = 0.0 if AXES[number] == "yaw" else 16.0 / 45.0 * _AIR_KG_M3 * (0.5 * hung.span_m) ** 5
    return Swing(
        axis=AXES[number],
        moment_kg_m2=mean.value,
        ci95=(max(mean.value - half - air, 0.0), mean.value + half),
        air_kg_m2=air,
        runs=runs,
        source=series.source,
        rate_hz=1.0 / series.period_s,
    )


def _uniform(series: CleanSeries, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return times and one rate on a uniform grid of at most 200 Hz; gaps are interpolated linearly."""
    period_s = max(series.period_s, 1.0 / _MOST_RATE_HZ)
    n = int((series.time_s[-1] - series.time_s[0]) / period_s) + 1
    if not 8 <= n <= 10 * max(series.n_samples, 1000):
        raise LogError("The gyro was logged for less than a minute of swings.", hint="Log it again.")
    time_s = series.time_s[0] + period_s * np.arange(n)
    values = series.values[:, axis]
    if series.period_s < period_s:
        # A mean over each step of the grid prevents aliasing.
        total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(series.time_s))])
        ends = np.interp([time_s - 0.5 * period_s, time_s + 0.5 * period_s], series.time_s, total)
        width = np.diff(
            np.clip([time_s - 0.5 * period_s, time_s + 0.5 * period_s], *series.time_s[[0, -1]]), axis=0
        )
        return time_s, np.asarray((ends[1] - ends[0]) / np.maximum(width[0], 1e-9))
    return time_s, np.interp(time_s, series.time_s, values)


def _spans(time_s: FloatArray, rate: FloatArray, frequency_hz: float) -> Iterator[tuple[int, int]]:
    """Yield first and last sample of each swing, which ends at the next push or when it is too weak."""
    step_s = float(time_s[1] - time_s[0])
    n_period = max(2, round(1.0 / (frequency_hz * step_s)))
    if time_s.size < _FEWEST_PERIODS * n_period:
        return
    # The envelope of the rates near the swing's frequency. The log is extended by its mirror image, so that
    # its end does not meet the push at its start.
    spectrum = np.fft.fft(np.concatenate([rate, rate[::-1]]) - rate.mean())
    frequency = np.fft.fftfreq(2 * rate.size, step_s)
    kept = (frequency > frequency_hz / 1.5) & (frequency < frequency_hz * 1.5)
    size = np.asarray(np.abs(np.fft.ifft(2.0 * spectrum * kept))[: rate.size])
    first = 0
    while first < size.size:
        # The next push is the highest point of the rise, not its beginning.
        strong = np.flatnonzero(size[first:] >= _LEAST_PUSH * size.max())
        if not strong.size:
            return
        first += int(strong[0])
        top = first
        while (ahead := size[top + 1 : top + 1 + n_period]).size and ahead.max() > size[top]:
            top += 1 + int(np.argmax(ahead))
        start = top + round(_SETTLING_PERIODS * n_period)
        after = size[start:]
        if not after.size:
            return
        low = np.minimum.accumulate(after)
        ended = np.flatnonzero((after > _PUSHED * low) | (after < _FAINTEST * after[0]))
        end = start + (int(ended[0]) if ended.size else after.size)
        # A push affects the envelope in the period before it.
        end = end - n_period if ended.size else end
        if end - start >= _FEWEST_PERIODS * n_period:
            yield start, end
        first = max(end, start) + n_period


def _fitted(
    time_s: FloatArray, rate: FloatArray, frequency_hz: float, span: tuple[int, int], hung: Bifilar
) -> Run | None:
    """Return the fit of one swing, None if its amplitude is zero."""
    from scipy.optimize import least_squares

    rows = slice(*span)
    since_s, measured = time_s[rows] - time_s[span[0]], rate[rows] - rate[rows].mean()
    omega = 2.0 * math.pi * frequency_hz
    turned = np.exp(-1j * omega * since_s) @ measured * 2.0 / measured.size
    size = float(
        np.sqrt(2.0) * measured[: max(2, round(1.0 / (frequency_hz * (time_s[1] - time_s[0]))))].std()
    )
    amplitude = min(size / omega, 0.9 * _MOST_AMPLITUDE)
    if not amplitude > 0.0:
        return None
    # omega and amplitudes as logarithms, so that all unknowns have a similar size.
    start = np.array([0.0, math.log(amplitude), float(np.angle(turned)), 0.02, 0.02, 0.0])

    def left(unknowns: FloatArray) -> FloatArray:
        return np.asarray((_modelled(unknowns, since_s, omega, hung) - measured) / size)

    lower = [-0.3, math.log(1e-4), -20.0, 0.0, 0.0, -size]
    upper = [0.3, math.log(_MOST_AMPLITUDE), 20.0, 5.0, 50.0, size]
    tries = [
        least_squares(
            left, np.clip(start + shift, lower, upper), bounds=(lower, upper), x_scale="jac", max_nfev=60
        )
        for shift in (
            [0.0] * 6,
            [0.0, 0.0, math.pi / 2, 0.0, 0.0, 0.0],
            [0.0, 0.0, -math.pi / 2, 0.0, 0.0, 0.0],
        )
    ]
    best = min(tries, key=lambda each: each.cost)
    fraction = float(np.mean(best.fun**2) / np.mean((measured / size) ** 2))
    found = omega * math.exp(best.x[0])
    n_block = max(1, round(2.0 * math.pi / found / (since_s[1] - since_s[0])))
    relative = NORMAL_95 * _deviation(np.asarray(best.jac), best.fun, n_block)
    moment = hung.mass_kg * GRAVITY_M_S2 * hung.distance_m**2 / (4.0 * hung.length_m * found**2)
    return Run(
        start_s=float(time_s[span[0]]),
        end_s=float(time_s[span[1] - 1]),
        period_s=2.0 * math.pi / found,
        period_half_width_s=relative * 2.0 * math.pi / found,
        amplitude_deg=math.degrees(math.exp(best.x[1])),
        linear_1_s=float(best.x[3]),
        quadratic=float(best.x[4]),
        fraction_left=fraction,
        moment_kg_m2=moment,
        half_width_kg_m2=max(2.0 * relative, 1e-6) * moment,
    )


def _deviation(slopes: FloatArray, left: FloatArray, n_block: int) -> float:
    """Return the standard deviation of the first unknown; residuals are correlated within a period."""
    n = left.size // n_block * n_block
    scores = (slopes[:n] * left[:n, np.newaxis]).reshape(-1, n_block, slopes.shape[1]).sum(axis=1)
    bread = np.linalg.pinv(slopes.T @ slopes)
    covariance = bread @ (scores.T @ scores) @ bread
    n_blocks = len(scores)
    return math.sqrt(max(float(covariance[0, 0]), 0.0) * n_blocks / max(n_blocks - slopes.shape[1], 1))


def _modelled(unknowns: FloatArray, since_s: FloatArray, omega: float, hung: Bifilar) -> FloatArray:
    """Return the modelled rate of a swing.

    The unknowns are ln(omega/given), ln(amplitude), phase, linear and quadratic damping, and bias.
    """
    change, log_amplitude, phase, linear, quadratic, bias = unknowns.tolist()
    own = omega * math.exp(change)
    # Averaged over a period, an amplitude v of the rate loses v (linear/2 + 4/(3 pi) quadratic v) a second.
    first, slow, fast = math.exp(log_amplitude), 0.5 * linear, 4.0 / (3.0 * math.pi) * quadratic * own
    # (1 - exp(-slow t)) / slow, which is t without linear damping.
    faded = -np.expm1(-slow * since_s) / slow if slow > 1e-9 else since_s
    amplitude = first * np.exp(-slow * since_s) / (1.0 + fast * first * faded)
    frequency = own * _frequency_ratio(amplitude, own, hung)
    frequency = np.sqrt(np.maximum(frequency**2 - slow**2, 1e-12))
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * np.diff(since_s))])
    return np.asarray(amplitude * frequency * np.cos(turned + phase) + bias)


def _frequency_ratio(amplitude: FloatArray, omega: float, hung: Bifilar) -> FloatArray:
    """Return the frequency at an amplitude [rad] over that of the smallest swings.

    Energy gives d(theta)/dt = sqrt(2 m g (z(a) - z(theta)) / (I + m z'(theta)^2)). With theta = a sin(x) the
    integrand is smooth and periodic, so that the midpoint rule is exact to rounding.
    """
    grid = np.linspace(0.0, max(float(amplitude.max()), 1e-3), 24)[1:]
    phase = (np.arange(24) + 0.5) * math.pi / 48.0
    theta = grid[:, np.newaxis] * np.sin(phase)
    d, h = hung.distance_m, hung.length_m
    moment_over_mass = GRAVITY_M_S2 * d**2 / (4.0 * h * omega**2)
    # z(a) - z(theta) without cancellation: a difference of squares over the sum of the roots.
    roots = [np.sqrt(h**2 - d**2 * np.sin(0.5 * each) ** 2) for each in (theta, grid[:, np.newaxis])]
    risen = d**2 * (np.sin(0.5 * grid[:, np.newaxis]) ** 2 - np.sin(0.5 * theta) ** 2) / (roots[0] + roots[1])
    slope = d**2 * np.sin(theta) / (4.0 * roots[0])
    speed = np.sqrt(2.0 * GRAVITY_M_S2 * risen / (moment_over_mass + slope**2))
    quarter_s = (grid[:, np.newaxis] * np.cos(phase) / speed).mean(axis=1) * 0.5 * math.pi
    ratio = 0.5 * math.pi / quarter_s / omega
    found = np.interp(amplitude**2, np.concatenate([[0.0], grid**2]), np.concatenate([[1.0], ratio]))
    return np.asarray(found, dtype=np.float64)
