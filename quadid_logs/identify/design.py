"""Regressors and targets of the whole flight, smoothed alike, cut into blocks.

Every column passes the same zero-phase Gaussian, and the target is its
derivative applied to the measured rate (the weak form with Gaussian test
functions). The work is done on spectra, one FFT per segment, so that a trial
of another lag costs three inverse FFTs and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.log import GyroFilter
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.structures import THROTTLED_YAW, Structure
from quadid_logs.maths.band import (
    ComplexArray,
    angular_frequency,
    delay_response,
    filtered,
    gaussian_reach_s,
    gaussian_response,
    gyro_response,
    lag_response,
    without_slow,
)
from quadid_logs.maths.rigid_body import PRODUCTS, rate_products
from quadid_logs.vocabulary import TORQUE_SYMBOLS

#: Rows per second over the smoothing cut-off: the Gaussian is down to 2e-4 at
#: five times its cut-off, the Nyquist frequency of the rows.
_ROWS_PER_CUTOFF = 10.0
#: Dropped at the start of a segment, where the actuator's past is unknown:
#: seven time constants of the slowest published motor (72 ms).
_ACTUATOR_MEMORY_S = 0.5
#: Longer segments are cut into pieces of this length and more: each end costs
#: under a second, so less than a hundredth is lost.
_PIECE_S = 120.0
_STATES = ("p", "q", "r", "phi", "theta", "psi")
#: Speed along body x and y, as the tilt brings it.
AIR_SPEED = ("u", "v")
_GRAVITY_M_S2 = 9.81
#: Drag over mass of multirotors is 0.1 to 0.3 1/s. Which value hardly matters:
#: it shapes what is slower than 0.05 Hz.
_DRAG_1_S = 0.2
#: Columns of the torque that an actuator shapes.
_INPUTS = (*TORQUE_SYMBOLS, THROTTLED_YAW)
#: From a rate setpoint to the rate that follows it, a rate loop takes 30 to 300 ms.
_INSTRUMENT_DELAYS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.22, 0.3, 0.4)
#: Leaving out more than this share of the rows for saturation leaves too little flight.
_MOST_TOUCHED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SegmentSpectra:
    """Real FFTs of one segment's torque (its columns as `_INPUTS`), and what is needed to go back."""

    n_samples: int
    n_out: int
    s: ComplexArray
    smoothing: FloatArray
    torque: ComplexArray
    reference: ComplexArray | None
    rows: slice


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """Rows of the regression, all segments one after the other.

    Attributes
    ----------
    time_s : ndarray, shape (n_rows,)
    columns : dict of str to ndarray, shape (n_rows,)
        Smoothed regressors and targets by name; "1" is the constant. Torques
        are not among them: see `torque`.
    segment : ndarray of int, shape (n_rows,)
        Number of the gap-free piece, an index into ``spectra``.
    block : ndarray of int, shape (n_rows,)
        Consecutive stretches of `IdentifySettings.held_out_block_s`.
    held_out : ndarray of bool, shape (n_rows,)
        Rows of blocks that no fit may see.
    edge : ndarray of bool, shape (n_rows,)
        Rows whose kernel reaches across from one set into the other; in neither.
    period_s, smoothing_hz : float
    gyro_filter : GyroFilter
        Known filters of the logged rates; the torque passes them too.
    pieces : tuple of Segment
        The gap-free pieces themselves, at their full rate, of ``sample_period_s``.
    mean_throttle : float or None
    high_pass_hz : float
        What is slower was taken out of columns, torques and instruments; 0 where nothing was.
    instruments : ndarray, shape (n_rows, n_instruments), or None
        What was asked for, now and some tenths of a second ago: it moves the
        vehicle, but no disturbance and no noise moves it.
    """

    time_s: FloatArray
    columns: dict[str, FloatArray]
    segment: IntArray
    block: IntArray
    held_out: BoolArray
    edge: BoolArray
    period_s: float
    smoothing_hz: float
    gyro_filter: GyroFilter
    spectra: tuple[SegmentSpectra, ...]
    pieces: tuple[Segment, ...]
    sample_period_s: float
    mean_throttle: float | None
    high_pass_hz: float = 0.0
    instruments: FloatArray | None = None

    @property
    def train(self) -> BoolArray:
        """Rows to fit to."""
        return ~(self.held_out | self.edge)

    def without_slow(self, high_pass_hz: float) -> Design:
        """Return the same rows without mean, drift and what is slower than `high_pass_hz`.

        There the air moves the vehicle: gusts, and the moment of the drag at
        the speed that it has picked up, which no gyro tells.
        """
        return replace(
            self,
            columns={
                name: self.swift(column[:, np.newaxis], high_pass_hz)[:, 0]
                for name, column in self.columns.items()
            },
            instruments=None if self.instruments is None else self.swift(self.instruments, high_pass_hz),
            high_pass_hz=high_pass_hz,
        )

    def averaged(self, columns: FloatArray, n_rows: int) -> FloatArray:
        """Average columns over so many rows, piece by piece; beyond the ends they count as zero."""
        if n_rows <= 1:
            return columns
        from scipy.ndimage import uniform_filter1d

        parts = [uniform_filter1d(part, n_rows, axis=0, mode="constant") for part in self._by_piece(columns)]
        return np.concatenate(parts)

    def without_instruments(self) -> Design:
        """Return the same rows for plain least squares."""
        return replace(self, instruments=None)

    def with_torque(self, torques: Sequence[FloatArray]) -> Design:
        """Return the same rows with other torques, one array (n_samples, 3) per piece."""
        return replace(
            self,
            spectra=tuple(
                replace(part, torque=_spectrum(_inputs(torque, piece.throttle, self.mean_throttle)))
                for part, piece, torque in zip(self.spectra, self.pieces, torques, strict=True)
            ),
        )

    def swift(self, columns: FloatArray, high_pass_hz: float) -> FloatArray:
        """Take what is slow out of columns, piece by piece; shape (n_rows, n_columns) stays."""
        if not high_pass_hz:
            return columns
        parts = [without_slow(part, self.period_s, high_pass_hz) for part in self._by_piece(columns)]
        return np.concatenate(parts)

    def _by_piece(self, columns: FloatArray) -> list[FloatArray]:
        """Split rows into those of each gap-free piece."""
        return np.split(columns, np.flatnonzero(np.diff(self.segment)) + 1)

    def disturbances(self, structure: Structure) -> tuple[str, ...]:
        """Return the columns that move the vehicle beside those of a structure; the paper's own have none.

        Of a vehicle with products of inertia the squares of the rates turn it too. Left out, they
        pass for a gyroscopic term wherever cross talk of the gyro lets two rates move together.
        """
        if not structure.actuated:
            return ()
        squares = (name for name in PRODUCTS if name not in structure.columns)
        return (*(name for name in AIR_SPEED if name in self.columns), *squares)

    def thinned(self, n_rows: int) -> Design:
        """Return a design of about `n_rows` rows, of whole pieces spread over the flight."""
        step = int(np.ceil(self.time_s.size / n_rows))
        if step <= 1 or len(self.spectra) < step:
            return self
        chosen = range(0, len(self.spectra), step)
        rows = np.isin(self.segment, chosen)
        return replace(
            self,
            time_s=self.time_s[rows],
            columns={name: column[rows] for name, column in self.columns.items()},
            segment=self.segment[rows],
            block=self.block[rows],
            held_out=self.held_out[rows],
            edge=self.edge[rows],
            spectra=tuple(self.spectra[number] for number in chosen),
            pieces=tuple(self.pieces[number] for number in chosen),
            instruments=None if self.instruments is None else self.instruments[rows],
        )

    def stack(self, names: Sequence[str], torque: FloatArray) -> FloatArray:
        """Return the named columns with L, M, N (and N times throttle) taken from `torque`."""
        inputs = dict(zip(_INPUTS, torque.T, strict=False))
        return np.column_stack([inputs[name] if name in inputs else self.columns[name] for name in names])

    @property
    def has_throttle(self) -> bool:
        """Whether yaw torque times throttle is known."""
        return all(part.torque.shape[1] == len(_INPUTS) for part in self.spectra)

    def torque(self, lag_s: float, delay_s: float, *, throttled: bool = False) -> FloatArray:
        """Return the torque behind lag, delay and gyro filter, smoothed; shape (n_rows, 3).

        ``throttled`` adds a fourth column, yaw torque times the deviation of the throttle from its mean.
        """
        return self._shaped(
            lambda s: lag_response(s, lag_s) * delay_response(s, delay_s) * self.gyro_response(s),
            n_columns=len(_INPUTS) if throttled else 3,
        )

    def torque_by_lag(self, lag_s: float, delay_s: float) -> FloatArray:
        """Return the derivative of `torque` by the lag [unit/s]; shape (n_rows, 3)."""
        return self._shaped(
            lambda s: -s * lag_response(s, lag_s) ** 2 * delay_response(s, delay_s) * self.gyro_response(s)
        )

    def torque_by_delay(self, lag_s: float, delay_s: float) -> FloatArray:
        """Return the derivative of `torque` by the delay [unit/s]; shape (n_rows, 3)."""
        return self._shaped(
            lambda s: -s * lag_response(s, lag_s) * delay_response(s, delay_s) * self.gyro_response(s)
        )

    def torque_as_logged(self) -> FloatArray:
        """Return the torque smoothed but without any actuator, as the paper takes it."""
        return self._shaped(np.ones_like)

    def gyro_response(self, s: ComplexArray) -> ComplexArray:
        """Return what the gyro's known filters make of the torque; 1 where none is known."""
        return gyro_response(s, *self.gyro_filter)

    def _shaped(self, response: Callable[[ComplexArray], ComplexArray], *, n_columns: int = 3) -> FloatArray:
        parts = [
            filtered(
                part.torque[:, :n_columns],
                response(part.s[: part.n_out // 2 + 1]) * part.smoothing[: part.n_out // 2 + 1],
                n_samples=part.n_samples,
                n_out=part.n_out,
            )[part.rows]
            for part in self.spectra
        ]
        if self.high_pass_hz:
            parts = [without_slow(part, self.period_s, self.high_pass_hz) for part in parts]
        return np.concatenate(parts)


def build_design(data: FlightData, smoothing_hz: float, settings: IdentifySettings) -> Design | None:
    """Smooth every segment and lay the rows out in blocks.

    Parameters
    ----------
    data : FlightData
        With segments.
    smoothing_hz : float
        Cut-off of the Gaussian [Hz].
    settings : IdentifySettings

    Returns
    -------
    Design, or None if no segment is longer than the filters' memory.
    """
    parts: list[tuple[FloatArray, dict[str, FloatArray], IntArray, SegmentSpectra]] = []
    pieces = []
    mean_throttle = _mean_throttle(data)
    for piece in _pieces(data):
        part = _segment_rows(piece, len(parts), data.sample_period_s, smoothing_hz, mean_throttle)
        if part is not None:
            parts.append(part)
            pieces.append(piece)
    if not parts:
        return None
    names = set.intersection(*(set(columns) for _, columns, _, _ in parts))
    columns = {name: np.concatenate([columns[name] for _, columns, _, _ in parts]) for name in names}
    time_s = np.concatenate([time for time, _, _, _ in parts])
    segment_of = np.concatenate([number for _, _, number, _ in parts])
    period_s = float(np.median(np.diff(time_s)))
    block, held_out, edge = _blocks(segment_of, period_s, gaussian_reach_s(smoothing_hz), settings)
    edge |= _touched_by_saturation(data, time_s, gaussian_reach_s(smoothing_hz)) & ~held_out
    return Design(
        time_s=time_s,
        columns=columns,
        segment=segment_of,
        block=block,
        held_out=held_out,
        edge=edge,
        period_s=period_s,
        smoothing_hz=smoothing_hz,
        gyro_filter=data.gyro_filter,
        spectra=tuple(spectra for _, _, _, spectra in parts),
        pieces=tuple(pieces),
        sample_period_s=data.sample_period_s,
        mean_throttle=mean_throttle,
        instruments=_instruments([spectra for _, _, _, spectra in parts]),
    )


def _instruments(spectra: Sequence[SegmentSpectra]) -> FloatArray | None:
    """Return the smoothed references at several delays; None unless all pieces have them."""
    parts = []
    n_references = max(
        (0 if part.reference is None else part.reference.shape[1] for part in spectra), default=0
    )
    for part in spectra:
        if part.reference is None:
            return None
        n_bins = part.n_out // 2 + 1
        delayed = [
            filtered(
                part.reference,
                part.smoothing[:n_bins] * delay_response(part.s[:n_bins], delay_s),
                n_samples=part.n_samples,
                n_out=part.n_out,
            )[part.rows]
            for delay_s in _INSTRUMENT_DELAYS_S
        ]
        # Of pooled logs one may have a chirp of a system-ID mode, and the others none.
        missing = n_references - part.reference.shape[1]
        delayed = [np.pad(columns, ((0, 0), (0, missing))) for columns in delayed]
        parts.append(np.column_stack(delayed))
    return np.concatenate(parts)


def _mean_throttle(data: FlightData) -> float | None:
    """Return the mean throttle of the flight, None where the log has none or not throughout."""
    throttle = [segment.throttle for segment in data.segments if segment.throttle is not None]
    if len(throttle) < len(data.segments):
        return None
    return float(np.concatenate(throttle).mean())


def _pieces(data: FlightData) -> Iterator[Segment]:
    """Yield the segments, long ones in equal pieces: FFTs stay short, and a search may skip some."""
    for segment in data.segments:
        n_pieces = max(1, int(segment.n_samples * data.sample_period_s / _PIECE_S))
        edges = np.linspace(0, segment.n_samples, n_pieces + 1).astype(int)
        for first, after in pairwise(edges):
            yield segment.rows(slice(int(first), int(after)))


def smooth_segment(
    segment: Segment, period_s: float, smoothing_hz: float
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return times and smoothed columns of one segment at its full rate, torque as logged.

    This is what the paper's windows are cut from. The filter's reach is
    dropped at both ends, so the result may be empty.
    """
    reach = int(np.ceil(gaussian_reach_s(smoothing_hz) / period_s))
    rows = slice(reach, segment.n_samples - reach)
    if rows.stop <= rows.start:
        return np.zeros(0), {}
    columns = _smooth_columns(segment, period_s, smoothing_hz, n_out=segment.n_samples, rows=rows)
    s = angular_frequency(segment.n_samples, period_s)
    torque = filtered(
        _spectrum(segment.torque),
        gaussian_response(s, smoothing_hz),
        n_samples=segment.n_samples,
        n_out=segment.n_samples,
    )[rows]
    columns |= dict(zip(("L", "M", "N"), torque.T, strict=True))
    return segment.time_s[rows], columns


def _segment_rows(
    segment: Segment, number: int, period_s: float, smoothing_hz: float, mean_throttle: float | None
) -> tuple[FloatArray, dict[str, FloatArray], IntArray, SegmentSpectra] | None:
    """Return times, columns, segment numbers and spectra of one segment."""
    from scipy.fft import next_fast_len

    n_samples = segment.n_samples
    # Trying lags takes hundreds of FFTs of this length: let it be a fast one.
    n_needed = int(np.ceil(n_samples * period_s * _ROWS_PER_CUTOFF * smoothing_hz))
    n_out = min(n_samples, int(next_fast_len(n_needed, real=True)))
    row_period_s = period_s * n_samples / n_out
    reach = int(np.ceil(gaussian_reach_s(smoothing_hz) / row_period_s))
    rows = slice(reach + int(np.ceil(_ACTUATOR_MEMORY_S / row_period_s)), n_out - reach)
    if rows.stop <= rows.start:
        return None
    columns = _smooth_columns(segment, period_s, smoothing_hz, n_out=n_out, rows=rows)
    time_s = segment.start_s + row_period_s * np.arange(rows.start, rows.stop, dtype=np.float64)
    s = angular_frequency(n_samples, period_s)
    spectra = SegmentSpectra(
        n_samples=n_samples,
        n_out=n_out,
        s=s,
        smoothing=gaussian_response(s, smoothing_hz),
        torque=_spectrum(_inputs(segment.torque, segment.throttle, mean_throttle)),
        reference=None if segment.reference is None else _spectrum(segment.reference),
        rows=rows,
    )
    return time_s, columns, np.full(len(time_s), number, dtype=np.int64), spectra


def _inputs(torque: FloatArray, throttle: FloatArray | None, mean_throttle: float | None) -> FloatArray:
    """Return the torque, with yaw torque times throttle beside it where that is known."""
    if mean_throttle is None or throttle is None:
        return torque
    return np.column_stack([torque, torque[:, 2] * (throttle - mean_throttle)])


def _spectrum(columns: FloatArray) -> ComplexArray:
    return np.asarray(np.fft.rfft(columns, axis=0), dtype=np.complex128)


def _smooth_columns(
    segment: Segment, period_s: float, smoothing_hz: float, *, n_out: int, rows: slice
) -> dict[str, FloatArray]:
    """Return the smoothed regressors and the smoothed derivatives of rates and angles, by name."""
    raw = _raw_columns(segment, period_s)
    s = angular_frequency(segment.n_samples, period_s)
    smoothing = gaussian_response(s, smoothing_hz)
    spectrum = _spectrum(np.column_stack(list(raw.values())))
    smooth = filtered(spectrum, smoothing, n_samples=segment.n_samples, n_out=n_out)[rows]
    columns = dict(zip(raw, smooth.T, strict=True))
    differentiated = [name for name in _STATES if name in raw]
    places = [list(raw).index(name) for name in differentiated]
    slopes = filtered(spectrum[:, places], s * smoothing, n_samples=segment.n_samples, n_out=n_out)[rows]
    columns |= {f"{name}_dot": slope for name, slope in zip(differentiated, slopes.T, strict=True)}
    columns["1"] = np.ones(len(smooth))
    return columns


def _raw_columns(segment: Segment, period_s: float) -> dict[str, FloatArray]:
    """Return rates, their products, angles and air speed; the products before smoothing, as in eq. (11)."""
    p, q, r = segment.body_rate_rad_s.T
    columns = {
        "p": p,
        "q": q,
        "r": r,
        **dict(zip(PRODUCTS, rate_products(segment.body_rate_rad_s).T, strict=True)),
    }
    if segment.attitude_rad is not None:
        columns |= dict(zip(("phi", "theta", "psi"), segment.attitude_rad.T, strict=True))
        columns |= dict(zip(AIR_SPEED, _air_speed(segment.attitude_rad, period_s).T, strict=True))
    return columns


def _air_speed(attitude_rad: FloatArray, period_s: float) -> FloatArray:
    """Return what a tilt has brought of speed along x and y, up to slow errors [m/s]; shape (n_samples, 2).

    u' = -g sin(theta) - d u and v' = g sin(phi) cos(theta) - d v: thrust
    balances weight, drag is linear.
    """
    # Not scipy.signal: it takes a quarter of a second to import, and this is all that is needed of it.
    from scipy.linalg import solve_banded

    phi, theta = attitude_rad[:, 0], attitude_rad[:, 1]
    push = _GRAVITY_M_S2 * np.column_stack([-np.sin(theta), np.sin(phi) * np.cos(theta)])
    # speed[k] - decay * speed[k - 1] = period * push[k], from rest.
    diagonals = np.ones((2, len(push)))
    diagonals[1] = -np.exp(-_DRAG_1_S * period_s)
    return np.asarray(solve_banded((1, 0), diagonals, period_s * push), dtype=np.float64)


def _touched_by_saturation(data: FlightData, time_s: FloatArray, reach_s: float) -> BoolArray:
    """Mark rows in which a torque is felt that was asked for but not given; shape of `time_s`.

    Realised torque needs none of this. Where most rows would go, all stay:
    `diagnose` warns of it.
    """
    marked = [segment.time_s[segment.saturated] for segment in data.segments]
    saturated_s = np.concatenate(marked)
    if data.input is None or data.input.achieved or not saturated_s.size:
        return np.zeros(time_s.shape, dtype=np.bool_)
    first = np.searchsorted(saturated_s, time_s - reach_s - _ACTUATOR_MEMORY_S)
    after = np.searchsorted(saturated_s, time_s + reach_s)
    touched = np.asarray(after > first, dtype=np.bool_)
    return touched if np.mean(touched) < _MOST_TOUCHED else np.zeros_like(touched)


def _blocks(
    segment: IntArray, period_s: float, reach_s: float, settings: IdentifySettings
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Cut the rows into blocks and set every third or so aside."""
    n_rows = segment.size
    # At least six blocks, so that a short flight can still be held out and cross-validated.
    length = max(1, int(min(settings.held_out_block_s, n_rows * period_s / 6.0) / period_s))
    new_block = np.zeros(n_rows, dtype=bool)
    for first in np.flatnonzero(np.diff(segment, prepend=segment[0] - 1)):
        end = np.searchsorted(segment, segment[first], side="right")
        new_block[first:end:length] = True
    block = np.cumsum(new_block) - 1
    share = settings.held_out_fraction
    held_out = np.floor((block + 1) * share) > np.floor(block * share)
    reach = int(np.ceil(reach_s / period_s))
    change = np.flatnonzero((np.diff(held_out.astype(np.int8)) != 0) & (np.diff(segment) == 0))
    edge = np.zeros(n_rows, dtype=bool)
    for index in change:
        edge[max(index + 1 - reach, 0) : index + 1 + reach] = True
    return block.astype(np.int64), held_out, edge & ~held_out
