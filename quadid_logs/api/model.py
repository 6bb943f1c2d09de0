"""A model that simulates, predicts other flights, and turns into a state-space system."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

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

#: Of the Padé approximation of the delay: its phase is right to a degree up to 3 rad over the delay.
_PADE_ORDER = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class IdentifiedModel(Model):
    """A `Model` with what it takes to simulate it and to hold it against another flight.

    Attributes
    ----------
    terms : tuple of Term
        Of the regressors, in their order.
    unit : str
        Of the torques L, M, N: "N m", or "1" for the autopilot's normalised command.
    autopilot : str
        Whose command that is.
    thrust_curve : ThrustCurve or None
        By which the torque was rebuilt.

    Examples
    --------
    >>> import numpy as np
    >>> import quadid_logs
    >>> model = quadid_logs.analyze("sample_logs/sysid-quad-x.bin").model
    >>> print(model["roll", "L"])
    B11 = 197.9 (194.8 to 201.0) rad/s^2
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
        """Return the body rates that torques make of the model, behind its lag and delay.

        Parameters
        ----------
        torque : array_like, shape (n_samples, 3)
            L, M, N in `unit`.
        time_s : array_like, shape (n_samples,)
            Increasing [s].
        start_rate_rad_s, start_attitude_rad : array_like, shape (3,), optional
            At the first sample: p, q, r [rad/s]; roll, pitch, yaw [rad]. Zero if not given.
        throttle : array_like, shape (n_samples,), optional
            Above the mean of the flight that was identified; zero if not given.

        Returns
        -------
        ndarray, shape (n_samples, 3)
            p, q, r [rad/s], before any filter of the gyro.

        Raises
        ------
        ShapeError
            If the arrays do not fit together.
        SettingsError
            If a regressor does not follow from rates, attitude, torque and throttle.
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
        """Hold the model against another flight of the vehicle, of which nothing is fitted.

        Parameters
        ----------
        other : Result or FlightData
            As `analyze` returns it, or its ``data``.

        Raises
        ------
        SettingsError
            If the torques of the two flights are not the same quantity.
        EmptyLogError
            If the other flight lacks a regressor, or is too short.
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
        """Return the part of the model that is linear in the rates, behind lag and delay.

        What is left out is of second order about hover: products of rates, and trim. A lag or delay whose
        interval holds zero is none; the delay becomes a Padé approximation, in front of the lag.

        Parameters
        ----------
        pade_order : int
            Order of the approximation; 0 leaves the delay out, for a tool that takes it as a number: the
            identified one is ``model.actuator.delay_s``.
        delay_s : float, optional
            Delay [s] in place of the identified one.

        Returns
        -------
        control.StateSpace
            Inputs L, M, N in `unit`, outputs p, q, r [rad/s]. States by name: p, q, r; ``L_lag``, ``M_lag``,
            ``N_lag``, the torques behind the lag; ``L_delay1`` and so on, of the approximation.

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
        """Draw vehicles that the flight allows, one axis: for a Monte Carlo study of a controller.

        Parameters
        ----------
        axis : {"roll", "pitch", "yaw"}
        seed : int
            Another seed, other vehicles.

        Returns
        -------
        dict of str to ndarray, shape (n_draws,)
            ``effectiveness`` [rad/s^2 per unit of torque], ``damping`` [1/s, negative where it brakes],
            ``lag_s``, ``delay_s`` and ``lead_s`` [s]: torque to rate is
            effectiveness (1 + s lead) / (s - damping) / (1 + s lag) exp(-s delay). The delay contains the
            zero-order hold of the controller's loop. The scale errors of gyro and calibration, which cancel
            around a loop, are not drawn.

        Raises
        ------
        EmptyLogError
            If the flight tells too little of the axis.
        SettingsError
            If there is no such axis, or no vehicle is to be drawn.

        Notes
        -----
        The five numbers are drawn together, from `Posterior`: by a normal distribution with their
        covariance, cut where lag or delay would be negative.

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
        """Return every element of A and B with its interval.

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
    """x' = A x + B u, y = C x + D u, with the names of the states."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]

    def before(self, other: _Linear) -> _Linear:
        """Return this system in series with another one, whose states come first."""
        none = np.zeros((len(self.states), len(other.states)))
        return _Linear(
            np.block([[other.A, other.B @ self.C], [none, self.A]]),
            np.vstack([other.B @ self.D, self.B]),
            np.hstack([other.C, other.D @ self.C]),
            other.D @ self.D,
            (*other.states, *self.states),
        )


def _beside(channels: Sequence[_Linear]) -> _Linear:
    """Return separate systems as one, block by block."""
    A, B, C, D = (block_diag(*matrices) for matrices in zip(*(each[:4] for each in channels), strict=True))
    return _Linear(A, B, C, D, tuple(name for channel in channels for name in channel.states))


def _delay(approximation: Any, torque: str) -> _Linear:
    """Return a Padé approximation with names."""
    A, B, C, D = (np.asarray(getattr(approximation, name), dtype=np.float64) for name in "ABCD")
    return _Linear(A, B, C, D, tuple(f"{torque}_delay{number}" for number in range(1, len(A) + 1)))


def identified(model: Model, terms: Mapping[str, Term], result: Result) -> IdentifiedModel:
    """Return a model of a result with what its methods need.

    Parameters
    ----------
    model : Model
    terms : mapping of str to Term
        By symbol, those of its regressors among them.
    result : Result

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
    """What a model makes of another flight.

    Attributes
    ----------
    validation : Validation
        All scores, by target or rate.
    series : FitSeries
        Measured and modelled, on rows as far apart as the smoothed band allows.

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
        """By axis.

        ``r2_acceleration`` in the fitted band, ``r2_high_passed_rate`` and ``r2_simulated_rate`` of the rate
        simulated without and with what is slower, ``fit_percent`` of the latter, ``rmse_rad_s`` after the
        longest horizon.
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
            Index ``time_s``; accelerations [rad/s^2] and rates [rad/s], measured, and modelled or simulated.

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
