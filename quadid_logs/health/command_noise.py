"""Noise in the controller's output: what is too fast for any loop moves no vehicle, and heats its motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from quadid_logs.align.clock import Clock
from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.data.catalogue import MOST_NOISE
from quadid_logs.data.health import AxisCommandNoise, CommandNoise, Level, Quantity
from quadid_logs.data.log import ControllerTerms
from quadid_logs.health.noise import LOOPS_END_HZ
from quadid_logs.health.records import records
from quadid_logs.health.spectra import Periodograms, periodograms
from quadid_logs.maths.resampling import typical_period
from quadid_logs.numerals import number
from quadid_logs.sentences import listed
from quadid_logs.vocabulary import AXES

#: Terms that gyro noise goes through; an integral hardly lets it pass. In the order in which they are shown.
_TERMS: Final = ("P", "D", "FF")
#: Faster noise than half the log's rate folds down, evenly over what is logged: so that at least half of it
#: stands above where loops end, the log goes at least twice as far.
_LEAST_END: Final = 2.0
#: Of a mean over frequencies, so many samples tell enough.
_MOST_SAMPLES: Final = 30_000
#: Less is not worth a number [%].
_LEAST_SHOWN: Final = 0.01


def find_command_noise(
    output: CleanSeries, terms: Sequence[ControllerTerms], clock: Clock, intervals: Sequence[Interval]
) -> CommandNoise | None:
    """Take the spectra of the output of each axis' rate controller, and of its terms as far as logged.

    Parameters
    ----------
    output : CleanSeries
        ``torque_command``, three columns, as the controller gave it.
    terms : sequence of ControllerTerms
    clock : Clock
        Of the log, on which ``output`` is.
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    CommandNoise or None
        None where the log is too slow to show what no loop makes, the flight too short, or nothing commanded.
    """
    spectra = _spectra(output, intervals)
    if spectra is None:
        return None
    mean, frequency_hz = spectra.mean, spectra.frequency_hz
    axes = {}
    for column, axis in enumerate(AXES):
        if not mean[:, column].any():
            continue
        logged = next((one for one in terms if one.axis == axis and {*_TERMS}.intersection(one.values)), None)
        of_terms = {} if logged is None else _of_terms(logged, clock, intervals, frequency_hz)
        axes[axis] = AxisCommandNoise(
            rms=Quantity(_rms(frequency_hz, mean[:, column]), "1", normal=(0.0, MOST_NOISE)),
            terms={name: Quantity(_rms(frequency_hz, each), "1") for name, each in of_terms.items()},
            density=mean[1:, column],
            term_densities={name: each[1:] for name, each in of_terms.items()},
        )
    if not axes:
        return None
    worst = max(axes, key=lambda axis: axes[axis].rms.value)
    most = axes[worst].rms.value
    level: Level = "normal" if most <= MOST_NOISE else "high" if most <= 2.0 * MOST_NOISE else "severe"
    return CommandNoise(
        sentence=_sentence(axes, worst, level),
        level=level,
        axes=axes,
        above_hz=LOOPS_END_HZ,
        frequency_hz=frequency_hz[1:],
    )


def _spectra(series: CleanSeries, intervals: Sequence[Interval]) -> Periodograms | None:
    found = periodograms(*records([series], intervals, _MOST_SAMPLES))
    return None if found is None or found.frequency_hz[-1] < _LEAST_END * LOOPS_END_HZ else found


def _of_terms(
    logged: ControllerTerms, clock: Clock, intervals: Sequence[Interval], frequency_hz: FloatArray
) -> dict[str, FloatArray]:
    """Return the density of each term at some frequencies; none where they are logged more slowly."""
    names = [name for name in _TERMS if name in logged.values]
    rows = logged.rows
    time_s = clock.common_time(rows.time_s, rows.position)
    values = np.column_stack([np.asarray(logged.values[name], dtype=np.float64) for name in names])
    time_s, chosen = np.unique(time_s, return_index=True)
    values = values[chosen]
    known = np.isfinite(time_s) & np.isfinite(values).all(axis=1)
    time_s, values = time_s[known], values[known]
    if time_s.size < 2:
        return {}
    series = CleanSeries(
        name="torque_command",
        rows=rows,
        time_s=time_s,
        stored=values,
        period_s=typical_period(time_s),
        source="",
    )
    found = _spectra(series, intervals)
    if found is None:
        return {}
    return {
        name: np.interp(frequency_hz, found.frequency_hz, column)
        for name, column in zip(names, found.mean.T, strict=True)
        if column.any() and np.isfinite(column).all()
    }


def _rms(frequency_hz: FloatArray, density: FloatArray) -> float:
    fast = frequency_hz > LOOPS_END_HZ
    return float(np.sqrt(density[fast].sum() * frequency_hz[1]))


def _sentence(axes: Mapping[str, AxisCommandNoise], worst: str, level: Level) -> str:
    """Say how large the noise is, whether that is normal, and which term most of it comes from."""
    sizes = []
    for axis, one in axes.items():
        percent = 100.0 * one.rms.value
        size = number(percent, 2) if percent >= _LEAST_SHOWN else f"below {_LEAST_SHOWN}"
        sizes.append(f"{axis} {size} %")
    limit = f"{100.0 * MOST_NOISE:g} %"
    judged = {
        "normal": f"That is normal (below {limit}).",
        "high": f"Normal is below {limit}: more heats the motors.",
        "severe": f"That is more than twice the normal {limit}: the motors may run hot.",
    }[level]
    told = (
        f"Above {LOOPS_END_HZ:g} Hz no control loop of a multirotor works, and what the controller puts out "
        f"there is noise: {listed(sizes)} of its range (rms). {judged}"
    )
    power = {name: one.value**2 for name, one in axes[worst].terms.items()}
    whole = sum(power.values())
    main = max(power, key=lambda name: power[name], default="")
    if main and power[main] > 0.5 * whole:
        told += f" In {worst}, {main} makes most of it ({number(100.0 * power[main] / whole, 2)} %)."
    return told
