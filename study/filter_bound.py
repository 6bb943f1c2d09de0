"""What the best filters and gains can reach: the bound of `study/filters.py`, from the true vehicle.

No flight, no log, and no search of the package: each axis' gains and its filter of D are searched by
sequential quadratic programming around the true vehicle, for every notch and low-pass of the gyro, under the
same limits. Gust error and noise are held against those of the best gains behind the filters that flew.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.autopilots import named
from quadid_logs.control.attitude import attitude_of, resonance_db
from quadid_logs.control.loop import Paths
from quadid_logs.control.margins import figures_of, grid_hz
from quadid_logs.control.scaled_loop import spare_of
from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.tuning import GOOD
from quadid_logs.maths.band import ComplexArray
from quadid_logs.simulator.closed_loop import Setup
from quadid_logs.simulator.control import TrackingNotch
from quadid_logs.simulator.effects import disturbance_density
from quadid_logs.simulator.true_loop import true_controller, true_plant
from quadid_logs.simulator.vendors import parameters
from quadid_logs.vocabulary import AXES
from study.tuning import resting_truth

#: Cut-offs of the gyro's low-pass that are tried, the range of D's by axis, and where its search begins [Hz]:
#: within what the firmware documents (@Range of INS_GYRO_FILTER and of ATC_RAT_*_FLTD).
_GYRO_HZ: Final = np.geomspace(15.0, 256.0, 6)
_OWN_HZ: Final = ((5.0, 100.0), (5.0, 100.0), (5.0, 50.0))
_OF_D_HZ: Final = 20.0
#: Widths of notches over their frequency.
_WIDTHS: Final = (0.25, 0.5)
#: Where gusts tilt a vehicle, and where noise moves motors [Hz].
_GUSTS_HZ: Final = (0.05, 60.0)
_NOISE_ABOVE_HZ: Final = 15.0
#: Rejection peak and resonance that no gains go beyond (ADS-33E practice), as in `study/optimum.py`.
_MOST_PEAK_DB: Final = 5.0
_MOST_RESONANCE_DB: Final = resonance_db(0.35)
#: Factors on gains that are searched.
_FACTORS: Final = (0.02, 50.0)
#: Where searches for gains begin: logarithms of factors on P, I, D and the angle gain.
_BEGINS: Final = np.log(
    [[1.0, 1.0, 1.0, 1.0], [0.5, 0.5, 0.5, 0.7], [1.5, 2.0, 3.0, 1.5], [0.7, 0.7, 0.2, 0.7]]
)
#: Part of the sum that decides where the larger of two is as small as it gets.
_AUGMENTED: Final = 0.1
#: Differences for slopes, steps of a search, and what it may miss of a limit.
_DIFFERENCE: Final = 1e-4
_MOST_STEPS: Final = 60
_MISSED: Final = 2e-3


class Filters(NamedTuple):
    """What all axes share."""

    gyro_hz: float
    notch: TrackingNotch | None


class Point(NamedTuple):
    """Logarithms of factors on P, I, D and the angle gain, D's filter, and what these make.

    ``gusts_rad`` is the attitude error, ``cost`` the same with what is slower or holds less than as flown,
    ``missing`` what lacks of the limits.
    """

    logs: FloatArray
    derivative_hz: float
    gusts_rad: float
    cost: float
    noise: float
    missing: float


class TrueAxis:
    """One axis of the true vehicle, behind any filters."""

    def __init__(self, setup: Setup, axis: int, rotors_hz: float) -> None:
        self._setup, self.number, self._rotors_hz = setup, axis, rotors_hz
        self._plant = true_plant(setup, resting_truth(setup), axis)
        period_s = 1.0 / setup.loop_hz
        folded_hz = abs(rotors_hz - setup.loop_hz * round(rotors_hz / setup.loop_hz))
        noise = setup.noise
        lines = {folded_hz: noise.rotor_line_rad_s, noise.frame_line_hz: noise.frame_line_rad_s}
        self._hz = np.unique([*grid_hz(period_s), *lines])
        self._body = self._plant.response(self._hz, period_s)[0]
        self._noise = _weights(self._hz, (_NOISE_ABOVE_HZ, np.inf)) * noise.gyro_rad_s_per_rthz**2
        for line_hz, rms in lines.items():
            self._noise[np.searchsorted(self._hz, line_hz)] += rms**2
        s = 2j * np.pi * self._hz
        tilts = np.abs(1.0 / (s * (s - self._plant.damping[0]))) ** 2
        strength = setup.effects.disturbance_rad_s2[axis] ** 2
        self._gusts = tilts * disturbance_density(self._hz) * strength * _weights(self._hz, _GUSTS_HZ)
        self._z = np.exp(-2j * np.pi * self._hz * period_s)
        self.flown = self._setup.tuning.of_derivative_hz(axis)
        self._parts: dict[Filters, tuple[ComplexArray, ComplexArray, ComplexArray]] = {}
        self.bounds = self._gain_bounds()
        self._least_hz, self._most_noise = 0.0, MOST_NOISE
        begin = Filters(setup.gyro_filter_hz, setup.tuning.notch)
        flown = self._told(begin, np.append(np.zeros(4), math.log(self.flown))[np.newaxis])
        self._least_hz, self._most_noise = float(flown["hz"][0]), max(MOST_NOISE, float(flown["noise"][0]))

    def _gain_bounds(self) -> list[tuple[float, float]]:
        """Return the least and the highest factor on each gain, those that the firmware documents."""
        values = parameters(self._setup, rate_hz=self._setup.loop_hz)
        tunable = named(self._setup.autopilot).tunable(values)
        assert tunable is not None
        names = tunable.axes[AXES[self.number]]
        own = (names.proportional, names.integral, names.derivative, names.angle)
        low, high = np.log(_FACTORS).tolist()
        return [
            (low, min(high, math.log(names.factors(one, values[one])[1])))
            if values[one] > 0.0
            else (0.0, 0.0)
            for one in own
        ]

    def _answers(self, filters: Filters) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return what P, I and D make of a rate, (3, n), D without its filter.

        Then what the angle loop adds and what becomes of a set-point, both over what is made of a rate.
        """
        if filters not in self._parts:
            setup, axis = self._setup, self.number
            flown = setup.tuning.single_gain
            tuning = dataclasses.replace(setup.tuning, notch=filters.notch)
            told = dataclasses.replace(setup, gyro_filter_hz=filters.gyro_hz)
            responses = []
            for row in range(3):
                single = np.array(flown, dtype=np.float64)
                single[:3, axis] *= np.eye(3)[row]
                rows = tuple((roll, pitch, yaw) for roll, pitch, yaw in single.tolist())
                one = dataclasses.replace(told, tuning=dataclasses.replace(tuning, single_gain=rows))
                paths = Paths(true_controller(one, axis, self._rotors_hz), self._hz)
                responses.append(paths.on_rate / (self._of_d(np.array([self.flown]))[0] if row == 2 else 1.0))
                if row == 0:
                    by_angle, forward = paths.on_angle / paths.on_rate, paths.forward / paths.on_rate
                    gyro = paths.gyro
            self._parts[filters] = np.array(responses), by_angle, forward * gyro
        return self._parts[filters]

    def _of_d(self, cutoff_hz: FloatArray) -> ComplexArray:
        """Return the low-pass of D, (n_sets, n): y += w (x - y) each step, w = 1 / (1 + 1 / (2 pi f T))."""
        weight = 1.0 / (1.0 + self._setup.loop_hz / (2.0 * np.pi * cutoff_hz[:, np.newaxis]))
        return np.asarray(weight / (1.0 - (1.0 - weight) * self._z))

    def _told(self, filters: Filters, logs: FloatArray) -> dict[str, FloatArray]:
        """Return all that is asked of sets of gains and D's cut-off, logarithms (n_sets, 5)."""
        parts, by_angle, forward = self._answers(filters)
        factors = np.exp(logs)
        of_d = self._of_d(factors[:, 4])
        back = factors[:, :2] @ parts[:2] + factors[:, 2:3] * of_d * parts[2]
        rate = self._body * back
        full = rate * (1.0 + factors[:, 3:4] * by_angle)
        attitude = attitude_of(self._hz, rate, full, rate * forward)
        loops = np.stack([rate, full], axis=1).reshape(-1, self._hz.size)
        runs_away = np.full(len(loops), self._plant.damping[0] > 0.0)
        # I integrates, and so does the angle loop.
        figures = figures_of(self._hz, loops, np.tile([1, 2], len(rate)), runs_away)
        spare = spare_of(figures, GOOD).reshape(len(rate), -1)
        closed = np.abs(1.0 / (1.0 + full)) ** 2
        gusts = np.sqrt(closed @ self._gusts)
        noise = np.sqrt((np.abs(back) ** 2 * closed) @ self._noise)
        slower = np.log(np.maximum(self._least_hz / attitude.bandwidth_hz, 1.0))
        # The integral gain holds what no spectrum shows, as a load off centre: it falls with P alone.
        weaker = np.maximum(np.minimum(logs[:, 0], 0.0) - logs[:, 1], 0.0)
        kept = np.concatenate(
            [
                np.minimum(spare, 2.0) - 1.0,
                1.0 - np.maximum(attitude.peak_db, 0.0)[:, np.newaxis] / _MOST_PEAK_DB,
                1.0 - np.maximum(attitude.resonance_db, 0.0)[:, np.newaxis] / _MOST_RESONANCE_DB,
                -np.log(noise / self._most_noise)[:, np.newaxis]
                if self._most_noise
                else noise[:, np.newaxis],
            ],
            axis=1,
        )
        return {
            "gusts": gusts,
            "noise": noise,
            "cost": np.log(gusts) + slower + weaker,
            "kept": kept,
            "hz": attitude.bandwidth_hz,
        }

    def point(self, filters: Filters, logs: FloatArray) -> Point:
        """Return what gains and D's cut-off make of the vehicle, logarithms (5,)."""
        told = self._told(filters, logs[np.newaxis])
        missing = float(np.sum(np.maximum(-told["kept"][0], 0.0)))
        of_d_hz, gusts, noise = float(np.exp(logs[4])), float(told["gusts"][0]), float(told["noise"][0])
        return Point(logs, of_d_hz, gusts, math.exp(float(told["cost"][0])), noise, missing)

    def best(
        self, filters: Filters, begins: Iterable[FloatArray], against: Point | None, *, of_d: bool
    ) -> Point | None:
        """Search gains, and D's filter if wanted, for the least gust error, or the larger of both ratios.

        Parameters
        ----------
        filters : Filters
        begins : iterable of ndarray, shape (5,)
            Logarithms, where the search begins.
        against : Point or None
            What gust error and noise are held against; None for the least gust error alone.
        of_d : bool
            Whether D's filter is searched too.

        Returns
        -------
        Point or None
            None where no gains keep the limits.
        """
        ends = [self._descend(filters, one, against, of_d=of_d) for one in begins]
        points = [point for one in ends if (point := self.point(filters, one)).missing <= _MISSED]
        return min(points, key=lambda one: worth(one, against), default=None)

    def _descend(
        self, filters: Filters, begin: FloatArray, against: Point | None, *, of_d: bool
    ) -> FloatArray:
        from scipy.optimize import minimize

        low, high = np.log(_OWN_HZ[self.number]).tolist()
        place = float(begin[4])
        bounds = [*self.bounds, (low, high) if of_d else (place, place)]
        # The last variable is the larger of both ratios.
        varied = [k for k, (least, most) in enumerate(bounds) if most > least]
        known: dict[bytes, tuple[FloatArray, FloatArray]] = {}

        def both(variables: FloatArray) -> tuple[FloatArray, FloatArray]:
            """Return value, and constraints above zero, of sets of variables."""
            sets = np.tile(begin, (len(variables), 1))
            sets[:, varied] = variables[:, :-1]
            told = self._told(filters, sets)
            if against is None:
                return told["cost"], told["kept"]
            ratios = np.stack(
                [told["cost"] - math.log(against.cost), np.log(told["noise"] / against.noise)], axis=1
            )
            level = variables[:, -1]
            kept = np.concatenate([told["kept"], level[:, np.newaxis] - ratios], axis=1)
            return level + _AUGMENTED * ratios.sum(axis=1), kept

        def at(variables: FloatArray) -> tuple[FloatArray, FloatArray]:
            key = variables.tobytes()
            if key not in known:
                known[key] = both(np.vstack([variables, variables + _DIFFERENCE * np.eye(variables.size)]))
            return known[key]

        start = np.append(np.clip(begin, *np.transpose(bounds))[varied], 0.0)
        found = minimize(
            lambda one: float(at(one)[0][0]),
            start,
            jac=lambda one: (at(one)[0][1:] - at(one)[0][0]) / _DIFFERENCE,
            method="SLSQP",
            bounds=[*(bounds[k] for k in varied), (-5.0, 5.0)],
            constraints={
                "type": "ineq",
                "fun": lambda one: at(one)[1][0],
                "jac": lambda one: ((at(one)[1][1:] - at(one)[1][0]) / _DIFFERENCE).T,
            },
            options={"maxiter": _MOST_STEPS, "ftol": 1e-4},
        )
        end = begin.copy()
        end[varied] = found.x[:-1]
        return end


def worth(point: Point, against: Point | None) -> float:
    """Return what is to be small: the gust error, or the larger of both ratios and a tenth of their sum."""
    if against is None:
        return math.log(point.cost)
    ratios = [math.log(point.cost / against.cost), math.log(point.noise / against.noise)]
    return max(ratios) + _AUGMENTED * sum(ratios)


def _weights(frequency_hz: FloatArray, band_hz: tuple[float, float]) -> FloatArray:
    """Return the weights of the trapezoidal rule in a band."""
    width = np.diff(frequency_hz)
    weights = 0.5 * (np.append(width, 0.0) + np.insert(width, 0, 0.0))
    low_hz, high_hz = band_hz
    return np.where((frequency_hz >= low_hz) & (frequency_hz <= high_hz), weights, 0.0)


def notches(setup: Setup, rotors_hz: float) -> Iterator[TrackingNotch | None]:
    """Yield the notches that a vehicle may have: the flown one, none, at its rotors, at its frame."""
    yield setup.tuning.notch
    if setup.tuning.notch is not None:
        yield None
    for width in _WIDTHS:
        at_hz = setup.noise.frame_line_hz
        yield TrackingNotch(0.9 * rotors_hz, width * 0.9 * rotors_hz)
        yield TrackingNotch(at_hz, width * at_hz, stands=True)


def bound(setup: Setup, rotors_hz: float) -> dict[str, Any]:
    """Return what the best gains reach behind the flown filters, and behind the best ones.

    Parameters
    ----------
    setup : Setup
        As the vehicle flies first.
    rotors_hz : float
        Speed of its rotors at hover.

    Returns
    -------
    dict
        Filters, and by axis gains and what they make, ready for JSON: ``alone`` behind the flown filters, and
        ``best`` of gains and filters together, for the larger of both ratios.
    """
    flown = Filters(setup.gyro_filter_hz, setup.tuning.notch)
    axes = [TrueAxis(setup, number, rotors_hz) for number in range(3)]
    alone: list[Point] = []
    for one in axes:
        begin = np.append(np.zeros(4), math.log(one.flown))
        begins = [begin + np.append(change, 0.0) for change in _BEGINS]
        found = one.best(flown, begins, None, of_d=False)
        if found is None:
            raise RuntimeError("no gains keep the limits behind the flown filters")
        alone.append(found)
    filters, best = _searched(setup, axes, alone, rotors_hz)
    return {"alone": _as_told(flown, alone), "best": _as_told(filters, best)}


def _searched(
    setup: Setup, axes: list[TrueAxis], alone: list[Point], rotors_hz: float
) -> tuple[Filters, list[Point]]:
    """Return the filters and points with the least sum, over the axes, of what is to be small."""
    best = (0.0, Filters(setup.gyro_filter_hz, setup.tuning.notch), alone)
    for notch in notches(setup, rotors_hz):
        near = alone
        for gyro_hz in sorted({*_GYRO_HZ.tolist(), setup.gyro_filter_hz}, reverse=True):
            filters, found = Filters(gyro_hz, notch), []
            for axis, old, beside in zip(axes, alone, near, strict=True):
                begins = [beside.logs, np.append(old.logs[:4], math.log(_OF_D_HZ))]
                point = axis.best(filters, begins, old, of_d=True)
                if point is not None:
                    found.append(point)
            if len(found) == len(axes):
                near = found
                value = sum(worth(new, old) for new, old in zip(found, alone, strict=True))
                best = min(best, (value, filters, found), key=lambda one: one[0])
    return best[1], best[2]


def _as_told(filters: Filters, points: list[Point]) -> dict[str, Any]:
    axes = {
        axis: {
            "gusts_rad": one.gusts_rad,
            "cost": one.cost,
            "noise": one.noise,
            "factors": np.exp(one.logs[:4]).tolist(),
            "derivative_hz": one.derivative_hz,
        }
        for axis, one in zip(AXES, points, strict=True)
    }
    return {"gyro_hz": filters.gyro_hz, "notch": filters.notch, "axes": axes}
