"""Estimates during flight: control effectiveness with its 95 % interval, and what to fly next.

Rows since the last update become block spectra (`identify.spectral`). Only these blocks are kept, so that an
update takes the same time after ten minutes as after one. The estimates are provisional: the analysis of the
whole log after landing decides, and knows how rotors answer large torques, which nothing is fitted to here.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.align import Prepared, cut
from quadid_logs.arrays import BoolArray, FloatArray
from quadid_logs.containers.tail import LogTail
from quadid_logs.data.flight import LEAST_FLIGHT_S, FlightData
from quadid_logs.data.log import NO_GYRO_FILTER
from quadid_logs.data.model import SpectralFit
from quadid_logs.data.settings import AlignSettings
from quadid_logs.errors import QuadidError
from quadid_logs.health.oscillation import find_oscillation
from quadid_logs.identify.spectral import (
    BLOCK_S,
    N_BEFORE_COMMANDS,
    blocks_that_turn,
    fit_spectra,
    flight_spectra,
)
from quadid_logs.load import prepare, read_log
from quadid_logs.maths.band import ComplexArray
from quadid_logs.maths.block_spectra import BlockSpectra
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.numerals import number
from quadid_logs.sentences import listed
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

#: Default target: relative half width of the 95 % interval.
TARGET: Final = 0.05
#: Length of the log that is read again at each update: two blocks, and the trimmed ends [s].
_TAIL_S: Final = 12.0
#: If many rows arrive at once, they are processed in parts of this length [s].
_STEP_S: Final = 4.0
_PART: Final = 1 << 15
#: Blocks overlap by half.
_HOP_S: Final = 0.5 * BLOCK_S
#: Five minutes; of a longer flight, the blocks with the strongest commands are kept.
_MOST_BLOCKS: Final = 150
_MOST_COMMANDS: Final = 6
#: Longest and shortest excitation that is advised at a time [s].
_MOST_S, _LEAST_S = 30.0, 4.0
#: Excitation for a first estimate: the smallest number of blocks that gives a variance, and one more [s].
_FIRST_S: Final = 12.0
#: After so much excitation of an axis more of it will not narrow its interval [s].
_ENOUGH_S: Final = 60.0
#: Saturation above this fraction is reported, as in the report (first level of QL311).
_SATURATED: Final = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveAxis:
    """The estimate of one axis so far.

    Attributes
    ----------
    axis : str
    effectiveness : float
        Control effectiveness [rad/s^2 per unit of torque], NaN if not known yet.
    half_width : float
        Relative half width of the 95 % interval; infinite if not known yet.
    excited_s : float
        Effective time of excitation [s].
    more_s : float
        Further excitation that the target needs [s]; 0 once it is reached.
    """

    axis: str
    effectiveness: float = float("nan")
    half_width: float = float("inf")
    excited_s: float = 0.0
    more_s: float = _FIRST_S

    def fraction(self, target: float) -> float:
        """Return the progress towards a target of the relative half width, 0 to 1."""
        return min(target / self.half_width, 1.0) if self.half_width < 1.0 else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveFigures:
    """The estimates of a flight so far.

    Attributes
    ----------
    flown_s : float
        Time in the air with usable data [s].
    axes : tuple of LiveAxis
        Roll, pitch, yaw.
    saturated : float
        Fraction of that time with the mixer at its limits.
    oscillation : str
        A sentence about an oscillation in the last seconds; "" if there is none.
    missing : str
        Why nothing can be estimated; "" if estimation is possible.
    unit : str
        Unit of the torque: "1" for the command, "N m" if the log calibrates it. The intervals exclude the
        error of that calibration.
    target : float
        Target of the relative half width.
    """

    flown_s: float = 0.0
    axes: tuple[LiveAxis, ...] = tuple(LiveAxis(axis=axis) for axis in AXES)
    saturated: float = 0.0
    oscillation: str = ""
    missing: str = "no log data yet"
    unit: str = "1"
    target: float = TARGET

    @property
    def is_enough(self) -> bool:
        """Whether every axis has reached the target."""
        return self.flown_s >= LEAST_FLIGHT_S and all(axis.more_s == 0.0 for axis in self.axes)

    @property
    def next_axis(self) -> LiveAxis | None:
        """The axis to excite next, with the widest interval; None if no excitation would help."""
        open_axes = [axis for axis in self.axes if 0.0 < axis.more_s < math.inf]
        return max(open_axes, key=lambda one: one.half_width, default=None)

    @property
    def hint(self) -> str:
        """What to do next, in a sentence."""
        if self.missing:
            return f"Waiting: {self.missing}."
        if self.is_enough:
            return f"All axes are known to {_percent(self.target)}: land."
        if self.saturated > _SATURATED:
            return "Move the sticks less: the motors are at their limits."
        axis = self.next_axis
        if axis is None:
            wide = listed([axis.axis for axis in self.axes if axis.more_s > 0.0])
            return f"More flight will hardly narrow {wide}: land, and read the report."
        return f"Fly {axis.axis} doublets for another {axis.more_s:.0f} s."


class _Block(NamedTuple):
    """A block: its start [s], its spectra, and by axis whether it was excited, and its commands."""

    start_s: float
    values: ComplexArray
    by_slope: ComplexArray
    moved: BoolArray
    commanded: FloatArray


@dataclass(slots=True, eq=False)
class _Blocks:
    """The blocks of one torque source, in order of time."""

    frequency_hz: FloatArray
    period_s: float
    blocks: list[_Block] = field(default_factory=list)

    def add(self, spectra: BlockSpectra) -> None:
        """Add the blocks of the new rows."""
        if spectra.frequency_hz.size != self.frequency_hz.size:
            return
        missing = N_BEFORE_COMMANDS + _MOST_COMMANDS - spectra.values.shape[2]
        turning = blocks_that_turn(spectra)
        for start_s, moved, *both in zip(
            spectra.start_s, turning, spectra.values, spectra.by_slope, strict=True
        ):
            values, by_slope = (np.pad(each, ((0, 0), (0, max(missing, 0)))) for each in both)
            commanded = values[:, N_BEFORE_COMMANDS : N_BEFORE_COMMANDS + 3]
            command = np.sum(np.abs(commanded) ** 2, axis=0)
            self.blocks.append(_Block(float(start_s), values, by_slope, moved, command * moved))
        while len(self.blocks) > _MOST_BLOCKS:
            total = np.sum([block.commanded for block in self.blocks], axis=0)
            weight = [float(np.sum(block.commanded / np.maximum(total, 1e-30))) for block in self.blocks]
            del self.blocks[int(np.argmin(weight))]

    def spectra(self) -> BlockSpectra:
        """Return the spectra of all blocks; consecutive blocks form a run."""
        start_s = np.array([block.start_s for block in self.blocks])
        breaks = np.abs(np.diff(start_s) - _HOP_S) > 0.25 * _HOP_S
        return BlockSpectra(
            frequency_hz=self.frequency_hz,
            values=np.array([block.values for block in self.blocks]),
            by_slope=np.array([block.by_slope for block in self.blocks]),
            start_s=start_s,
            run=np.concatenate([[0], np.cumsum(breaks)]),
            period_s=self.period_s,
        )

    def moved(self) -> list[int]:
        """Return the axes that moved more than those of a hovering vehicle."""
        return np.flatnonzero(np.sum([block.moved for block in self.blocks], axis=0) > 1).tolist()

    def excited_s(self) -> FloatArray:
        """Return the effective time of excitation of each axis [s]; shape (3,)."""
        power = np.array([block.commanded for block in self.blocks])
        whole = np.sum(power, axis=0)
        spread = np.divide(whole**2, np.sum(power**2, axis=0), out=np.zeros(3), where=whole > 0.0)
        return np.asarray(_HOP_S * spread, dtype=np.float64)


class LiveEstimate:
    """The estimate of a flight in progress from the bytes of its log.

    Parameters
    ----------
    target : float
        Target of the relative half width of the 95 % intervals.

    Examples
    --------
    >>> from pathlib import Path
    >>> flight = LiveEstimate()
    >>> flight.append(Path("sample_logs/sysid-quad-x.bin").read_bytes())
    >>> [axis.half_width < 0.1 for axis in flight.figures().axes]
    [True, True, True]
    """

    def __init__(self, target: float = TARGET) -> None:
        self._target = target
        self._tail = LogTail(_TAIL_S)
        self._taken_s = float("nan")
        self._begin_s = -math.inf
        self._counted_s = -math.inf
        self._rate_hz = 0.0
        self._by_source: dict[str, _Blocks] = {}
        self._gyro_filter = NO_GYRO_FILTER
        self._unit = "1"
        self._flown_s = self._saturated_s = 0.0
        self._oscillation, self._missing = "", "no log data yet"

    def append(self, content: bytes) -> None:
        """Add the next bytes of the log.

        Parameters
        ----------
        content : bytes
            The bytes may end inside a message; its rest follows with the next call.
        """
        for first in range(0, len(content), _PART):
            self._tail.append(content[first : first + _PART])
            if not abs(self._tail.end_s - self._taken_s) < _STEP_S:
                self._take()

    def figures(self) -> LiveFigures:
        """Return the present estimates."""
        if self._tail.end_s != self._taken_s:
            self._take()
        best = max(self._by_source.values(), key=lambda one: len(one.blocks), default=None)
        axes = LiveFigures().axes
        if best is not None and best.blocks:
            excited_s = best.excited_s()
            fits = fit_spectra(best.spectra(), self._gyro_filter, moved=best.moved())
            axes = tuple(
                _axis(name, fits[place] if fits else None, float(excited_s[place]), self._target)
                for place, name in enumerate(AXES)
            )
        return LiveFigures(
            flown_s=self._flown_s,
            axes=axes,
            saturated=self._saturated_s / self._flown_s if self._flown_s else 0.0,
            oscillation=self._oscillation,
            missing=self._missing,
            unit=self._unit,
            target=self._target,
        )

    # Damaged numbers become NaN or infinity without a warning.
    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def _take(self) -> None:
        """Read the tail and add its new blocks."""
        self._taken_s = self._tail.end_s
        if math.isnan(self._taken_s):
            return
        try:
            with tempfile.TemporaryDirectory(prefix="quadid-live-") as folder:
                path = Path(folder, "tail")
                path.write_bytes(self._tail.content())
                prepared = prepare(read_log(path))
            data = cut(prepared, AlignSettings(sample_rate_hz=self._rate_hz))
        except QuadidError as error:
            self._missing = printable(error.args[0], 200).rstrip(".")
            return
        self._missing = _missing(data)
        self._oscillation = _oscillation(prepared, data)
        if not data.segments or data.input is None:
            return
        self._rate_hz = self._rate_hz or 1.0 / data.sample_period_s
        self._gyro_filter, self._unit = data.gyro_filter, data.input.unit
        # Count the new rows: in flight, and at the limits.
        for segment in data.segments:
            if segment.end_s < self._counted_s - _TAIL_S:
                self._counted_s = -math.inf  # the clock was set back
            new = segment.time_s > self._counted_s
            self._flown_s += data.sample_period_s * float(np.count_nonzero(new))
            self._saturated_s += data.sample_period_s * float(np.count_nonzero(segment.saturated & new))
            self._counted_s = max(self._counted_s, segment.end_s)
        if data.segments[-1].end_s < self._begin_s - _TAIL_S:
            self._begin_s = -math.inf
        half_s = 0.5 * data.sample_period_s
        parts = [
            segment.rows(slice(int(np.searchsorted(segment.time_s, self._begin_s - half_s)), None))
            for segment in data.segments
            if not segment.planned
        ]
        parts = [part for part in parts if part.n_samples > 1]
        # Blocks arrive one by one: the flight modes to come are not known.
        parts = [replace(part, law=None) for part in parts]
        spectra = flight_spectra(replace(data, segments=tuple(parts))) if parts else None
        if spectra is None:
            return
        self._by_source.setdefault(data.input.source, _Blocks(spectra.frequency_hz, spectra.period_s)).add(
            spectra
        )
        self._begin_s = float(spectra.start_s[-1]) + _HOP_S


def _missing(data: FlightData) -> str:
    """Return why nothing can be estimated from the last rows; "" if estimation is possible."""
    if not data.flights:
        return printable(data.on_ground_reason, 200) or "the vehicle is not in the air"
    if not data.segments:
        if sum(end_s - start_s for start_s, end_s in data.flights) < _STEP_S:
            return "the vehicle has just taken off"
        return "body rates or torque are not logged, or too slowly"
    if not any(
        segment.command is not None and np.isfinite(segment.command).all(axis=1).any()
        for segment in data.segments
    ):
        return "set-points of this flight mode are not commands: fly in a mode that the sticks command"
    return ""


def _oscillation(prepared: Prepared, data: FlightData) -> str:
    """Return a sentence about an oscillation in the last seconds; "" if there is none."""
    rate, asked = (prepared.series.get(name) for name in ("body_rate", "body_rate_setpoint"))
    output = prepared.clean.first("torque_command")
    if rate is None or asked is None or output is None or not data.flights:
        return ""
    found = find_oscillation(rate, asked, output, prepared.series.get("rotor_speed"), data.flights)
    if found is None or not found.axes:
        return ""
    worst = found.axes[0]
    folded = ", or vibrates faster than the log can show" if found.may_be_folded else ""
    return f"{worst.axis.capitalize()} oscillates at {worst.line.frequency_hz:.1f} Hz{folded}."


def _axis(name: str, fit: SpectralFit | None, excited_s: float, target: float) -> LiveAxis:
    """Return the estimate of an axis, with the further excitation that it needs."""
    # Without commands, as in hover, there is no response of the vehicle.
    if fit is None or not fit.follows_commands or not 0.0 < fit.half_width < fit.gain:
        return LiveAxis(
            axis=name, excited_s=excited_s, more_s=math.inf if excited_s > _ENOUGH_S else _FIRST_S
        )
    half_width = fit.half_width / fit.gain
    if not fit.is_described:
        # A departure from one lag may be the same at all frequencies: it then affects the effectiveness.
        half_width += NORMAL_95 * fit.departure
    known = LiveAxis(axis=name, effectiveness=fit.gain, half_width=half_width, excited_s=excited_s)
    # Rounding must not make a pilot fly on.
    if half_width <= target * (1.0 + 1e-9):
        return replace(known, more_s=0.0)
    if excited_s > _ENOUGH_S:
        return replace(known, more_s=math.inf)
    # The variance of the estimate falls with the time of excitation.
    more_s = excited_s * ((half_width / target) ** 2 - 1.0)
    return replace(known, more_s=min(max(more_s, _LEAST_S), _MOST_S))


def _percent(half_width: float) -> str:
    return f"±{number(100.0 * half_width, 2)} %"


def axis_words(axis: LiveAxis) -> str:
    """Return the estimate of an axis as a short text.

    Examples
    --------
    >>> axis_words(LiveAxis(axis="roll", effectiveness=198.2, half_width=0.062, more_s=0.0))
    'roll 198 ±6.2 %'
    >>> axis_words(LiveAxis(axis="yaw"))
    'yaw not known yet'
    """
    if not axis.half_width < 1.0:
        return f"{axis.axis} not known yet"
    return f"{axis.axis} {number(axis.effectiveness, 3)} {_percent(axis.half_width)}"


def notes(figures: LiveFigures) -> tuple[str, ...]:
    """Return notes on saturation, oscillation and calibration."""
    saturated = figures.saturated > _SATURATED
    limit = f"The motors were at their limits in {100.0 * figures.saturated:.0f} % of the flight."
    scaled = figures.unit == "N m" and any(axis.half_width < 1.0 for axis in figures.axes)
    calibration = (
        "Values are per N m by the parameters. The intervals do not include the error of the parameters."
    )
    return tuple(
        filter(None, (limit if saturated else "", figures.oscillation, calibration if scaled else ""))
    )


def figure_line(figures: LiveFigures) -> str:
    """Return the estimates as one line."""
    known = ", ".join(map(axis_words, figures.axes))
    return " ".join([f"{figures.flown_s:.0f} s flown: {known}.", *notes(figures), figures.hint])


def figure_block(figures: LiveFigures, width: int = 24) -> tuple[str, ...]:
    """Return the estimates as lines; the bar of an axis is full once its interval reaches the target.

    Parameters
    ----------
    figures : LiveFigures
    width : int
        Width of a bar in characters.

    Examples
    --------
    >>> print(figure_block(LiveFigures(missing=""), width=8)[1])
    roll   ········  not known yet
    """
    lines = [f"{figures.flown_s:.0f} s flown"]
    for axis in figures.axes:
        filled = round(width * axis.fraction(figures.target))
        bar = "█" * filled + "·" * (width - filled)
        words = axis_words(axis).removeprefix(f"{axis.axis} ")
        lines.append(f"{axis.axis:6} {bar}  {words}")
    return (*lines, *notes(figures), figures.hint)
