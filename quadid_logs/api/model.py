"""A model that simulates, predicts other flights and exports a state-space system."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from quadid_logs.api.frames import data_frame
from quadid_logs.arrays import FloatArray
from quadid_logs.control.posterior import draw
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import FitSeries, Model, ThrustCurve, Validation
from quadid_logs.data.result import Result
from quadid_logs.errors import EmptyLogError, SettingsError
from quadid_logs.extra import load
from quadid_logs.identify.prediction import predict_flight
from quadid_logs.identify.simulation import simulate_rates
from quadid_logs.identify.terms import Term
from quadid_logs.report.model_files import linear_actuator, rate_matrices
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS, TORQUE_SYMBOLS

if TYPE_CHECKING:
    import control
    import pandas as pd

#: Order of the Padé approximation of the delay: its phase is right to a degree up to 3 rad over the delay.
_PADE_ORDER = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class IdentifiedModel(Model):
    """A `Model` that can be simulated, validated on another flight and exported.

    Attributes
    ----------
    terms : tuple of Term
        The terms behind the regressors, in the order of the columns of A.
    unit : str
        Unit of the torques L, M, N: "N m", or "1" for the autopilot's normalised command.
    autopilot : str
        The autopilot that the command belongs to.
    thrust_curve : ThrustCurve or None
        The thrust curve that the torque was rebuilt with.

    Examples
    --------
    >>> import numpy as np
    >>> import quadid_logs
    >>> model = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").model
    >>> print(model["roll", "L"])
    B11 = 197.9 (195.4 to 200.4) rad/s^2
    >>> t = np.arange(0.0, 0.5, 0.0025)
    >>> push = np.outer(t > 0.1, [0.1, 0.0, 0.0])
    >>> model.simulate(push, t).shape
    (200, 3)
    """

    terms: tuple[Term, ...] = ()
    unit: str = "1"
    autopilot: str = ""
    thrust_curve: ThrustCurve | None = None

    def simulate(
        self,
        torque: ArrayLike,
        time_s: ArrayLike,
        *,
        start_rate_rad_s: ArrayLike | None = None,
        start_attitude_rad: ArrayLike | None = None,
        throttle: ArrayLike | None = None,
    ) -> FloatArray:
        """Simulate the body rates for given torques, including lag and delay.

        Parameters
        ----------
        torque : array_like, shape (n_samples, 3)
            L, M, N in `unit`.
        time_s : array_like, shape (n_samples,)
            Increasing times [s].
        start_rate_rad_s, start_attitude_rad : array_like, shape (3,), optional
            State at the first sample: p, q, r [rad/s]; roll, pitch, yaw [rad]. The default is zero.
        throttle : array_like, shape (n_samples,), optional
            Throttle minus the mean throttle of the identified flight. The default is zero.

        Returns
        -------
        ndarray, shape (n_samples, 3)
            p, q, r [rad/s], before any gyro filter.

        Raises
        ------
        ShapeError
            If the shapes of the arrays do not match.
        SettingsError
            If a regressor cannot be computed from rates, attitude, torque and throttle.
        """
        return simulate_rates(
            self,
            self.terms,
            torque,
            time_s,
            start_rate_rad_s=start_rate_rad_s,
            start_attitude_rad=start_attitude_rad,
            throttle=throttle,
        )

    def predict(self, other: Result | FlightData) -> FlightPrediction:
        """Predict another flight of the vehicle. Nothing is fitted to that flight.

        Parameters
        ----------
        other : Result or FlightData
            The result of `analyze` for the other flight, or its ``data``.

        Raises
        ------
        SettingsError
            If the torques of the two flights are not the same quantity.
        EmptyLogError
            If the other flight lacks a signal of the model, or is too short.
        """
        data = other.data if isinstance(other, Result) else other
        autopilot = other.log.autopilot if isinstance(other, Result) else self.autopilot
        unit = data.input.unit if data.input is not None else self.unit
        if unit != self.unit or (unit == "1" and autopilot != self.autopilot):
            raise SettingsError(
                f"The model's torque is in {_spoken(self.unit, self.autopilot)}, "
                f"the other flight's in {_spoken(unit, autopilot)}.",
                hint="Describe the vehicle in both analyses (vehicle=): both are then in N m.",
            )
        validation, series = predict_flight(self, self.terms, data, self.thrust_curve)
        return FlightPrediction(validation=validation, series=series)

    def to_statespace(
        self, pade_order: int = _PADE_ORDER, *, delay_s: float | None = None
    ) -> control.StateSpace:
        """Return the part of the model that is linear in the rates, with lag and delay.

        Products of rates (of second order about hover) and trim are omitted. A lag or delay whose 95 %
        interval contains zero is omitted too. The delay becomes a Padé approximation in front of the lag.

        Parameters
        ----------
        pade_order : int
            Order of the Padé approximation. 0 omits the delay, for tools that take it as a number:
            ``model.actuator.delay_s``.
        delay_s : float, optional
            Delay [s] that replaces the identified delay.

        Returns
        -------
        control.StateSpace
            Inputs L, M, N in `unit`, outputs p, q, r [rad/s]. States by name: p, q, r; ``L_lag``, ``M_lag``,
            ``N_lag``, the torques after the lag; ``L_delay1`` and so on, the states of the approximation.

        Raises
        ------
        SettingsError
            If python-control is not installed, or the order or the delay is negative.

        Examples
        --------
        >>> import quadid_logs
        >>> system = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").model.to_statespace(pade_order=0)
        >>> system.state_labels
        ['p', 'q', 'r', 'L_lag', 'M_lag', 'N_lag']
        """
        library = load("control")
        lag_s, identified_s = linear_actuator(self)
        wanted_s = identified_s if delay_s is None else delay_s
        if pade_order < 0 or not 0.0 <= wanted_s < math.inf:
            raise SettingsError(
                f"A delay of {wanted_s:g} s with Padé order {pade_order} is not possible.",
                hint="Give pade_order and delay_s of 0 or more.",
            )
        system = _Linear(*rate_matrices(self), np.eye(3), np.zeros((3, 3)), RATE_SYMBOLS)
        if lag_s > 0.0:
            leads_s = (0.0, 0.0, self.yaw_reaction.lead_s if self.yaw_reaction else 0.0)
            lags = []
            for lead_s, name in zip(leads_s, TORQUE_SYMBOLS, strict=True):
                through = lead_s / lag_s
                values = (-1.0 / lag_s, 1.0 / lag_s, 1.0 - through, through)
                A, B, C, D = (np.array([[value]]) for value in values)
                lags.append(_Linear(A, B, C, D, (f"{name}_lag",)))
            system = _beside(lags).before(system)
        if wanted_s > 0.0 and pade_order:
            delay = library.tf2ss(library.tf(*library.pade(wanted_s, pade_order)))
            system = _beside([_delay(delay, name) for name in TORQUE_SYMBOLS]).before(system)
        *matrices, states = system
        names = {"inputs": list(TORQUE_SYMBOLS), "outputs": list(RATE_SYMBOLS), "states": list(states)}
        return library.ss(*matrices, **names, name="vehicle")

    def draws(self, axis: str, n_draws: int = 400, *, seed: int = 1) -> dict[str, FloatArray]:
        """Draw samples of one axis' model from its posterior, for a Monte Carlo study of a controller.

        Parameters
        ----------
        axis : {"roll", "pitch", "yaw"}
        n_draws : int
            Number of samples, at least one.
        seed : int
            Seed of the random numbers.

        Returns
        -------
        dict of str to ndarray, shape (n_draws,)
            ``effectiveness`` [rad/s^2 per unit of torque], ``damping`` [1/s, negative for a damped axis],
            ``lag_s``, ``delay_s`` and ``lead_s`` [s]. The transfer from torque to rate is
            effectiveness (1 + s lead) / (s - damping) / (1 + s lag) exp(-s delay). The delay contains the
            zero-order hold of the controller's loop. Scale errors of gyro and calibration cancel around a
            loop and are not drawn.

        Raises
        ------
        EmptyLogError
            If the flight does not identify the axis well enough.
        SettingsError
            If there is no such axis, or ``n_draws`` is less than one.

        Notes
        -----
        The five numbers are drawn jointly from `Posterior`: a normal distribution with their covariance,
        truncated so that lag and delay are not negative.

        Examples
        --------
        >>> import quadid_logs
        >>> model = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").model
        >>> drawn = model.draws("roll", 1000)["effectiveness"]
        >>> bool(model["roll", "L"].ci95[0] < drawn.mean() < model["roll", "L"].ci95[1])
        True
        """
        if axis not in AXES:
            raise SettingsError(f"There is no axis {axis!a}.", hint=f"Choose from {', '.join(AXES)}.")
        if n_draws < 1 or seed < 0:
            raise SettingsError("n_draws must be at least 1, and seed at least 0.")
        plant = None
        if self.posterior is not None:
            plant = draw(self.posterior, AXES.index(axis), 0.0, n_draws, seed=seed)
        if plant is None:
            raise EmptyLogError(
                f"The flight shows too little of {axis} to draw plant samples.",
                hint="See .diagnosis.findings.",
            )
        # The first of them is the estimate itself.
        drawn = plant.at(slice(1, None))
        return {
            "effectiveness": drawn.effectiveness,
            "damping": drawn.damping,
            "lag_s": drawn.lag_s,
            "delay_s": drawn.delay_s,
            "lead_s": np.asarray(drawn.lead_s),
        }

    def to_pandas(self) -> pd.DataFrame:
        """Return every element of A and B with its 95 % interval.

        Returns
        -------
        pandas.DataFrame
            Index ``name``; columns ``axis``, ``target``, ``regressor``, ``value``, ``ci95_low``,
            ``ci95_high``, ``unit``, ``identifiable``, ``reason``.

        Raises
        ------
        SettingsError
            If pandas is not installed.
        """
        axes = dict(zip(ACCELERATION_SYMBOLS, AXES, strict=True))
        rows = [
            {
                "name": each.name,
                "axis": axes.get(each.target, ""),
                "target": each.target,
                "regressor": each.regressor,
                "value": each.value,
                "ci95_low": each.ci95[0],
                "ci95_high": each.ci95[1],
                "unit": each.unit,
                "identifiable": each.identifiable,
                "reason": each.reason,
            }
            for each in self.parameters
        ]
        return data_frame({name: [row[name] for row in rows] for name in rows[0]}, index="name")


class _Linear(NamedTuple):
    """A linear system x' = A x + B u, y = C x + D u, with the names of its states."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]

    def before(self, other: _Linear) -> _Linear:
        """Return this system followed by another in series; the other's states come first."""
        none = np.zeros((len(self.states), len(other.states)))
        return _Linear(
            np.block([[other.A, other.B @ self.C], [none, self.A]]),
            np.vstack([other.B @ self.D, self.B]),
            np.hstack([other.C, other.D @ self.C]),
            other.D @ self.D,
            (*other.states, *self.states),
        )


def _beside(channels: Sequence[_Linear]) -> _Linear:
    """Return separate systems as one block-diagonal system."""
    A, B, C, D = (_diagonal(matrices) for matrices in zip(*(each[:4] for each in channels), strict=True))
    return _Linear(A, B, C, D, tuple(name for channel in channels for name in channel.states))


def _diagonal(matrices: Sequence[FloatArray]) -> FloatArray:
    """Return matrices along the diagonal of one. Importing scipy.linalg takes as long as this package."""
    found = np.zeros(np.sum([each.shape for each in matrices], axis=0))
    row, column = 0, 0
    for each in matrices:
        found[row : row + each.shape[0], column : column + each.shape[1]] = each
        row, column = row + each.shape[0], column + each.shape[1]
    return found


def _delay(approximation: Any, torque: str) -> _Linear:
    """Return a Padé approximation with named states."""
    A, B, C, D = (np.asarray(getattr(approximation, name), dtype=np.float64) for name in "ABCD")
    return _Linear(A, B, C, D, tuple(f"{torque}_delay{number}" for number in range(1, len(A) + 1)))


def identified(model: Model, terms: Mapping[str, Term], result: Result) -> IdentifiedModel:
    """Return a model of a result as an `IdentifiedModel`.

    Parameters
    ----------
    model : Model
    terms : mapping of str to Term
        Terms by symbol, at least those of the model's regressors.
    result : Result
        The analysis that the model belongs to.

    Returns
    -------
    IdentifiedModel
    """
    return IdentifiedModel(
        **{each.name: getattr(model, each.name) for each in fields(Model)},
        terms=tuple(terms[symbol] for symbol in model.regressors),
        unit=result.data.input.unit if result.data.input is not None else "1",
        autopilot=result.log.autopilot,
        thrust_curve=result.identification.thrust_curve if model.actuator is not None else None,
    )


def _spoken(unit: str, autopilot: str) -> str:
    return "N m" if unit == "N m" else f"the normalised command of {autopilot!a}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FlightPrediction:
    """The prediction of another flight by a model, with its scores.

    Attributes
    ----------
    validation : Validation
        All scores, by target or rate.
    series : FitSeries
        Measured and modelled series, thinned to the rate that the smoothed band needs.

    Examples
    --------
    >>> import quadid_logs
    >>> model = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").model
    >>> prediction = model.predict(quadid_logs.analyze("sample_logs/damaged.bin"))
    >>> round(prediction.scores["roll"]["r2_acceleration"], 2)
    1.0
    """

    validation: Validation
    series: FitSeries

    @property
    def scores(self) -> dict[str, dict[str, float]]:
        """Scores by axis.

        ``r2_acceleration`` is the R2 of the angular acceleration in the fitted band. ``r2_high_passed_rate``
        is that of the simulated rate above the lower edge of the band, ``r2_simulated_rate`` that of the
        whole simulated rate, and ``fit_percent`` its fit. ``rmse_rad_s`` is the error of the rate [rad/s]
        after the longest horizon.
        """
        found = self.validation
        return {
            axis: {
                "r2_acceleration": found.r2_acceleration.get(target, math.nan),
                "r2_high_passed_rate": found.r2_high_passed_rate.get(rate, math.nan),
                "r2_simulated_rate": found.r2_simulated_rate.get(rate, math.nan),
                "fit_percent": found.fit_percent.get(rate, math.nan),
                "rmse_rad_s": found.horizon_rmse_rad_s.get(rate, (math.nan,))[-1],
            }
            for axis, target, rate in zip(AXES, ACCELERATION_SYMBOLS, RATE_SYMBOLS, strict=True)
        }

    def to_pandas(self) -> pd.DataFrame:
        """Return measured and modelled series.

        Returns
        -------
        pandas.DataFrame
            Index ``time_s`` [s]. Measured and modelled accelerations [rad/s^2], measured and simulated rates
            [rad/s].

        Raises
        ------
        SettingsError
            If pandas is not installed.
        """
        series, columns = self.series, {"time_s": self.series.time_s}
        for axis, (target, rate) in enumerate(zip(ACCELERATION_SYMBOLS, RATE_SYMBOLS, strict=True)):
            columns[f"{target}_rad_s2"] = series.acceleration[:, axis]
            columns[f"{target}_modelled_rad_s2"] = series.modelled_acceleration[:, axis]
            columns[f"{rate}_rad_s"] = series.rate[:, axis]
            columns[f"{rate}_simulated_rad_s"] = series.simulated_rate[:, axis]
        return data_frame(columns, index="time_s")

    def __repr__(self) -> str:
        lines = [f"<{type(self).__name__} of {self.validation.held_out_s:.1f} s"]
        for axis, found in self.scores.items():
            r2, fast = found["r2_acceleration"], found["r2_high_passed_rate"]
            lines.append(f"  {axis:<5}  R2 of the acceleration {r2:.3f}, of the simulated rate {fast:.3f}")
        return "\n".join(lines) + ">"
