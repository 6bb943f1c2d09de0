"""The methods that the command runs itself: each with what it is, and a function of a data set."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from benchmarks import estimators
from benchmarks.methods import regressions
from benchmarks.methods.data_sets import DataSet
from benchmarks.methods.entry import Estimate
from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.settings import Settings
from quadid_logs.diagnose import diagnose
from quadid_logs.identify import identify
from quadid_logs.version import __version__
from quadid_logs.vocabulary import AXES, ON_AXIS

Estimates = tuple[Estimate | None, ...]

#: Our own entry, whose refusals divide the axes of the page.
OURS: Final = "quadid-logs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entrant:
    """A method.

    Attributes
    ----------
    name, description, tuned_on : str
    run : callable
        Of a `DataSet`: an estimate for roll, pitch and yaw, None where there is none.
    package : str
        What must be installed for it, "" for nothing.
    """

    name: str
    description: str
    tuned_on: str
    run: Callable[[DataSet], Estimates]
    package: str = ""

    @property
    def is_installed(self) -> bool:
        """Whether it can run here."""
        return not self.package or importlib.util.find_spec(self.package) is not None

    @property
    def version(self) -> str:
        """Of the package, or of ours."""
        return importlib.metadata.version(self.package) if self.package else __version__


def ours(data_set: DataSet) -> Estimates:
    """Return the recommended model's effectiveness with its intervals; none of an axis that is refused."""
    settings = Settings()
    identification = identify(data_set.data, settings.identify)
    verdicts = diagnose(data_set.log, data_set.data, identification).axes
    model = identification.recommended
    if model is None:
        return (None, None, None)
    entries = [model.entries[ON_AXIS[axis]] for axis in AXES]
    return tuple(
        None if verdicts[axis].verdict == "refused" else Estimate(entry.value, entry.ci95)
        for axis, entry in zip(AXES, entries, strict=True)
    )


def _of_series(method: Callable[[FlightData], Estimates]) -> Callable[[DataSet], Estimates]:
    return lambda data_set: method(data_set.data)


def _without_interval(method: Callable[[FlightData], FloatArray]) -> Callable[[DataSet], Estimates]:
    """Return a method that gives three numbers as one that gives estimates."""
    return lambda data_set: tuple(
        Estimate(float(value)) if abs(value) < float("inf") else None for value in method(data_set.data)
    )


_NONE: Final = "none"
ENTRANTS: Final = (
    Entrant(
        name=OURS,
        description="The recommended model with default settings; no number where an axis is refused.",
        tuned_on="the simulated and the firmware data sets, among many other flights",
        run=ours,
    ),
    Entrant(
        name="paper",
        description="H_k of six consecutive samples inverted for every k, median over k (eq. 10 and 11), "
        "with the division by the sample period that its numbers lack.",
        tuned_on=_NONE,
        run=_without_interval(estimators.paper),
    ),
    Entrant(
        name="least squares",
        description="Linear regression of accelerations from 10 Hz low-passed series, no motor lag, interval "
        "from white residuals: the linear model and solver of data-driven-dynamics (Galliker), "
        "torque as logged.",
        tuned_on=_NONE,
        run=_of_series(regressions.ordinary_least_squares),
    ),
    Entrant(
        name="least squares, lag",
        description="The same for 31 first-order lags of the torque, the best kept; interval by Morelli and "
        "Klein (1997) for coloured residuals, at that lag.",
        tuned_on=_NONE,
        run=_of_series(regressions.least_squares_with_lag),
    ),
    Entrant(
        name="output error",
        description="Maximum likelihood of the rate simulated over segments of 4 s (Maine and Iliff 1986), "
        "the method of SIDPAC and aeroid, as a formula: gain, damping, lag, delay, trim; interval by "
        "Morelli and Klein.",
        tuned_on="six of these flights: that the model needs a delay",
        run=_of_series(regressions.output_error),
    ),
    Entrant(
        name="pysindy",
        description="SINDy with control, squares of the rates as library, STLSQ, smoothed differences, "
        "torques smoothed alike.",
        tuned_on="six of these flights: the window of its smoother",
        run=_without_interval(estimators.pysindy),
        package="pysindy",
    ),
    Entrant(
        name="nfoursid",
        description="N4SID at 25 Hz; the gain of K exp(-s d) / ((s + a)(1 + s tau)) fitted to its response.",
        tuned_on="five of these flights: rate, block rows and order, the best of 48",
        run=_without_interval(estimators.nfoursid),
        package="nfoursid",
    ),
    Entrant(
        name="sysidentpy",
        description="Linear ARX per axis at 50 Hz, terms by FROLS with AIC; the gain read off its response "
        "as for nfoursid.",
        tuned_on=_NONE,
        run=_without_interval(estimators.sysidentpy),
        package="sysidentpy",
    ),
)


def machine() -> str:
    """Return what results of this run were made on, without the machine's name."""
    import numpy
    import scipy

    software = f"Python {platform.python_version()}, numpy {numpy.__version__}, scipy {scipy.__version__}"
    return f"{platform.machine()}, {os.cpu_count()} cores, one thread a method; {software}"
