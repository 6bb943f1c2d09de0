"""`analyze` for Python: takes a file, arrays, a table or a simulated flight, returns an `Analysis`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from quadid_logs import pipeline
from quadid_logs.api.frames import data_frame
from quadid_logs.api.model import IdentifiedModel, identified
from quadid_logs.autopilots.generic.table import from_columns
from quadid_logs.data.closed_loop import ClosedLoop
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Model
from quadid_logs.data.once import once
from quadid_logs.data.result import Result
from quadid_logs.data.settings import Settings
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import EmptyLogError, SettingsError
from quadid_logs.figures import Figure, figures_of
from quadid_logs.identify.structures import TERMS, Structure
from quadid_logs.identify.terms import TORQUE_TERMS
from quadid_logs.report.series_file import aligned_table
from quadid_logs.simulator import Simulation

if TYPE_CHECKING:
    import pandas as pd

#: Computing these takes seconds: they are computed once for each analysis.
_figures_of = once(figures_of)

LogLike = str | Path | FlightLog | Simulation | Mapping[str, Any] | Any
"""A path; a log or simulated flight in memory; columns by canonical name, as a mapping or a DataFrame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Analysis(Result):
    """The result of one analysis: a `Result` with `model`, `parameters`, `loop`, `figures` and `to_pandas`.

    A notebook displays it as verdicts and tables. Elsewhere its text is a few lines.

    Attributes
    ----------
    structure : Structure or None
        The user's own structure, if one was fitted in addition to those of the package.

    Examples
    --------
    >>> import quadid_logs
    >>> quadid_logs.analyze("sample_logs/sysid-quad-x.bin")
    <Analysis of 'sysid-quad-x.bin': structure rigid-body
      roll   usable   B11 = 197.9 (195.4 to 200.4) rad/s^2
      pitch  usable   B22 = 176.6 (173.5 to 179.7) rad/s^2
      yaw    usable   B33 = 10.88 (10.74 to 11.02) rad/s^2>
    """

    structure: Structure | None = None

    @property
    def usable(self) -> bool:
        """Whether no axis is refused."""
        return self.diagnosis.usable

    @property
    def model(self) -> IdentifiedModel:
        """The recommended model.

        Raises
        ------
        EmptyLogError
            If no model could be fitted.
        """
        found = self.identification.recommended
        if found is None:
            why = self.identification.skipped or "the log holds too little"
            raise EmptyLogError(f"There is no model: {why}.", hint="See .diagnosis.findings.")
        return self._identified(found)

    @property
    def models(self) -> dict[str, IdentifiedModel]:
        """All fitted models by the name of their structure, the recommended model first."""
        return {each.structure: self._identified(each) for each in self.identification.models}

    @property
    def parameters(self) -> pd.DataFrame:
        """Every element of A and B of the recommended model, as `IdentifiedModel.to_pandas` returns them."""
        return self.model.to_pandas()

    @property
    def loop(self) -> ClosedLoop:
        """The closed loop of the recommended model and the controller; ``margins`` holds them by axis.

        Raises
        ------
        EmptyLogError
            If the log does not identify the controller, or there is no model.
        """
        if self.closed_loop is None:
            raise EmptyLogError(
                "The loop cannot be closed: there is no model, or the log does not describe the controller.",
                hint="Use a log that holds the autopilot's parameters and its rate set-points.",
            )
        return self.closed_loop

    @property
    def figures(self) -> dict[str, Figure]:
        """Every figure of the report by its key. A notebook displays a figure directly."""
        return {figure.key: figure for figure in _figures_of(self).shown}

    def to_pandas(self) -> pd.DataFrame:
        """Return the aligned series of all segments.

        Returns
        -------
        pandas.DataFrame
            Index ``time_s`` [s]. Columns: rates [rad/s], attitude [rad], torque in the unit of its column
            name, throttle, set-points, ``saturated``, ``segment``, ``flight``. A signal that a segment lacks
            is NaN.

        Raises
        ------
        EmptyLogError
            If the log has no usable segment.
        SettingsError
            If pandas is not installed.
        """
        return data_frame(aligned_table(self.data), index="time_s")

    def _identified(self, model: Model) -> IdentifiedModel:
        """Return a model with its terms, so that it can simulate and predict."""
        own = () if self.structure is None else self.structure.terms
        return identified(model, dict(TERMS) | {term.symbol: term for term in (*TORQUE_TERMS, *own)}, self)

    def _repr_html_(self) -> str:
        """Return verdicts and matrices as HTML without scripts; every text is escaped."""
        from quadid_logs.notebook import show

        return show(self)._repr_html_()


def analyze(
    log: LogLike | Result,
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
    structure: str | Structure = "",
    progress: pipeline.Progress | None = None,
) -> Analysis:
    """Analyze one log: identify the rotational model and judge each axis.

    The stages read the log, align its signals on one clock, rebuild the torque, cut the flights, identify the
    models and diagnose them.

    Parameters
    ----------
    log : str, Path, FlightLog, Simulation, mapping, pandas.DataFrame or Result
        A log file of any supported format, a flight of `simulate`, or columns by canonical name. Columns have
        shape (n_samples,): ``time_s`` [s], ``p_rad_s``, ``q_rad_s``, ``r_rad_s``, ``L_n_m`` or ``L_command``,
        and further names of the nomenclature. The index of a DataFrame may be ``time_s``. A result is not
        analyzed again; it only gets the methods of an `Analysis`.
    settings : Settings, optional
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the log's parameters.
    structure : str or Structure
        The structure to recommend. A structure of `own_structure` is fitted in addition to those of the
        package. "" selects the structure from the flight.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Analysis

    Raises
    ------
    LogError
        If the file cannot be read as a flight log at all.
    SettingsError
        If the selected part of the log holds no flight, or the structure is unknown. Also if a result comes
        with settings, a vehicle or a structure.

    Examples
    --------
    >>> from quadid_logs import analyze
    >>> r = analyze("sample_logs/sysid-quad-x.bin")
    >>> r.verdict
    {'roll': 'usable', 'pitch': 'usable', 'yaw': 'usable'}
    >>> gain = r.model["roll", "L"]
    >>> print(f"{gain.value:.0f} {gain.unit}, 95 %: {gain.ci95[0]:.0f} to {gain.ci95[1]:.0f}")
    198 rad/s^2, 95 %: 195 to 200
    """
    if isinstance(log, Result):
        if settings is not None or vehicle is not None or structure:
            raise SettingsError(
                "This result was analyzed already: settings, vehicle and structure cannot change it.",
                hint="Give the log itself: its path, or the .log of the result.",
            )
        return log if isinstance(log, Analysis) else _analysis(log, None)
    chosen, own = _settings(settings, structure)
    result = pipeline.analyze(as_log(log), chosen, vehicle=vehicle, structure=own, progress=progress)
    return _analysis(result, own)


def analyze_pooled(
    logs: Sequence[LogLike],
    settings: Settings | None = None,
    *,
    vehicle: Vehicle | None = None,
    structure: str | Structure = "",
    progress: pipeline.Progress | None = None,
) -> Analysis:
    """Identify one model from several logs of one vehicle.

    Parameters
    ----------
    logs : sequence
        At least one log, in any form that `analyze` accepts. A log without a usable flight adds nothing, and
        a finding reports it.
    settings : Settings, optional
        ``start_s`` and ``end_s`` apply to the clock of each log.
    vehicle : Vehicle, optional
        Known properties of the vehicle. They take precedence over the logs' parameters.
    structure : str or Structure
        The structure to recommend; "" selects it from the flights.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Analysis
        ``log`` is the first usable log, ``pooled`` names all logs.

    Raises
    ------
    LogError
        If one of the files cannot be read as a flight log at all.
    SettingsError
        If the logs' torques are not the same quantity, or the selected part holds no flight.

    Examples
    --------
    >>> from quadid_logs import analyze_pooled
    >>> result = analyze_pooled(["sample_logs/sysid-quad-x.bin", "sample_logs/damaged.bin"])
    >>> [f"{one.path}: {one.used_s:.0f} s" for one in result.pooled]
    ['sample_logs/sysid-quad-x.bin: 24 s', 'sample_logs/damaged.bin: 14 s']
    """
    chosen, own = _settings(settings, structure)
    read = [as_log(each) for each in logs]
    result = pipeline.analyze(read, chosen, vehicle=vehicle, structure=own, progress=progress)
    return _analysis(result, own)


def _analysis(result: Result, structure: Structure | None) -> Analysis:
    """Return a result as an `Analysis`."""
    return Analysis(**{each.name: getattr(result, each.name) for each in fields(Result)}, structure=structure)


def _settings(settings: Settings | None, structure: str | Structure) -> tuple[Settings, Structure | None]:
    """Return the settings with the name of the structure, and the user's own structure or None."""
    settings = settings or Settings()
    if isinstance(structure, Structure):
        return settings, structure
    if not structure:
        return settings, None
    return replace(settings, identify=replace(settings.identify, structure=structure)), None


def as_log(log: LogLike) -> str | Path | FlightLog:
    """Return a log as a path to read or a `FlightLog` in memory.

    Parameters
    ----------
    log : str, Path, FlightLog, Simulation, mapping or pandas.DataFrame

    Returns
    -------
    str, Path or FlightLog

    Raises
    ------
    TypeError
        If ``log`` has another type.
    """
    if isinstance(log, str | Path | FlightLog):
        return log
    if isinstance(log, Simulation):
        return replace(log.log, path=str(log.truth.get("scenario", "simulation")))
    return from_columns(dict(_columns(log)), "table in memory")


def _columns(table: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns of a mapping or a DataFrame, including a named index."""
    if not isinstance(table, Mapping) and (name := getattr(getattr(table, "index", None), "name", None)):
        yield str(name), np.asarray(table.index)
    if not hasattr(table, "keys"):
        raise TypeError(f"A log is a path, a mapping or a DataFrame, not {type(table).__name__}.")
    for name in table.keys():  # noqa: SIM118 - iterating over a DataFrame is by keys, too, but of other tables not
        yield str(name), np.asarray(table[name])
