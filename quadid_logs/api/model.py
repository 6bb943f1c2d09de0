"""A model that simulates, predicts other flights, and turns into a state-space system."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from quadid_logs.api.extra import data_frame, load
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import FitSeries, Model, ThrustCurve, Validation
from quadid_logs.data.result import Result
from quadid_logs.errors import SettingsError
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
    B11 = 197.9 (195.7 to 200.1) rad/s^2
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

        Returns
        -------
        FlightPrediction

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
                hint="Describe the vehicle in both analyses (vehicle=), so that both are in N m.",
            )
        validation, series = predict_flight(self, self.terms, data, self.thrust_curve)
        return FlightPrediction(validation=validation, series=series)

    def to_statespace(self, pade_order: int = _PADE_ORDER) -> control.StateSpace:
        """Return the part of the model that is linear in the rates, behind lag and delay.

        What is left out is of second order about hover: products of rates, and trim. A lag or delay whose
        interval holds zero is none; the delay becomes a Padé approximation.

        Parameters
        ----------
        pade_order : int
            Of the approximation; 0 leaves the delay out.

        Returns
        -------
        control.StateSpace
            Inputs L, M, N in `unit`, outputs p, q, r [rad/s].

        Raises
        ------
        SettingsError
            If python-control is not installed.
        """
        library = load("control")
        A, B = rate_matrices(self)
        rates = library.ss(A, B, np.eye(3), np.zeros((3, 3)))
        lag_s, delay_s = linear_actuator(self)
        channels = [self._channel(library, axis, lag_s, delay_s, pade_order) for axis in range(3)]
        system = library.series(library.append(*channels), rates)
        system.set_inputs(list(TORQUE_SYMBOLS))
        system.set_outputs(list(RATE_SYMBOLS))
        return system

    def _channel(self, library: Any, axis: int, lag_s: float, delay_s: float, pade_order: int) -> Any:
        """Return lag, delay and, of yaw, the lead by the reaction of its rotors, as one system."""
        lead_s = self.yaw_reaction.lead_s if axis == 2 and lag_s > 0.0 and self.yaw_reaction else 0.0
        channel = library.tf([lead_s, 1.0], [lag_s, 1.0]) if lag_s > 0.0 else library.tf([1.0], [1.0])
        if delay_s > 0.0 and pade_order:
            channel = channel * library.tf(*library.pade(delay_s, pade_order))
        return library.ss(channel)

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
