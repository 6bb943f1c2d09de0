"""Regressors and targets of the whole flight, smoothed alike, cut into blocks.

Every column passes the same zero-phase Gaussian, and the target is its
derivative applied to the measured rate (the weak form with Gaussian test
functions).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from quadid_logs.arrays import BoolArray, FloatArray, IntArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.identify.driven import by_driven_axis
from quadid_logs.identify.structures import DISTURBANCES, STRUCTURES, Structure
from quadid_logs.identify.terms import ANGLES, RATE_TERMS, TRIM, RotorField, Term, column_of
from quadid_logs.identify.torque import RowGrid, RowTorque
from quadid_logs.maths.band import delay_response, gaussian_reach_s, high_pass
from quadid_logs.maths.least_squares import without_rounding
from quadid_logs.vocabulary import TORQUE_SYMBOLS

#: Fraction of the flight that no fit sees; taken in blocks, never shuffled.
HELD_OUT_FRACTION: Final = 0.3
#: Longer than the memory of the dynamics (under 1 s), short enough for both sets to see all manoeuvres.
HELD_OUT_BLOCK_S: Final = 5.0
#: Where those leave one of the sets without excitation, shorter ones; the shortest outlast the memory still.
_BLOCKS_S = (HELD_OUT_BLOCK_S, 0.5 * HELD_OUT_BLOCK_S, 0.25 * HELD_OUT_BLOCK_S)
#: A sixth of what a fair division gives to the held-out blocks.
_LEAST_EXCITATION = HELD_OUT_FRACTION / 6.0
#: Rows per second over the smoothing cut-off: the Gaussian is down to 2e-4 at
#: five times its cut-off, the Nyquist frequency of the rows.
_ROWS_PER_CUTOFF = 10.0
#: Dropped at the start of a segment, where the actuator's past is unknown:
#: seven time constants of the slowest published motor (72 ms).
_ACTUATOR_MEMORY_S = 0.5
#: Longer segments are cut into chunks of this length and more: each end costs
#: under a second, so less than a hundredth is lost.
_CHUNK_S = 120.0
#: From a rate setpoint to the rate that follows it, a rate loop takes 30 to 300 ms.
_INSTRUMENT_DELAYS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.22, 0.3, 0.4)
#: Throttle is logged to a thousandth or so: what varies less is rounding, and its product with N is N.
_LEAST_THROTTLE = 1e-3
#: Leaving out more than this fraction of the rows for saturation leaves too little flight.
_MOST_TOUCHED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """Rows of the regression, all chunks one after the other.

    Attributes
    ----------
    time_s : ndarray, shape (n_rows,)
    columns : dict of str to ndarray, shape (n_rows,)
        Smoothed regressors and targets by symbol; "1" is the constant. Torques
        are not among them: see `torque`.
    chunk : ndarray of int, shape (n_rows,)
        Number of the gap-free chunk, an index into ``chunks``.
    block : ndarray of int, shape (n_rows,)
        Consecutive intervals of `HELD_OUT_BLOCK_S`.
    held_out : ndarray of bool, shape (n_rows,)
        Rows of blocks that no fit may see.
    edge : ndarray of bool, shape (n_rows,)
        Rows whose kernel reaches across from one set into the other; in neither.
    period_s, smoothing_hz : float
    torque : RowTorque
        On the same rows, to be shaped by an actuator.
    chunks : tuple of Segment
        The gap-free chunks themselves, at their full rate, of ``sample_period_s``.
    high_pass_hz : float
        What is slower was taken out of columns, torques and instruments; 0 where nothing was.
    instruments : ndarray, shape (n_rows, n_instruments), or None
        What was commanded, now and some tenths of a second ago: it moves the
        vehicle, but no disturbance and no noise moves it.
    held_per_s : ndarray, shape (3, 3), or None
        Rate set-points per angle (as rows) that were taken out of the instruments; None where nothing was.
    """

    time_s: FloatArray
    columns: dict[str, FloatArray]
    chunk: IntArray
    block: IntArray
    held_out: BoolArray
    edge: BoolArray
    period_s: float
    smoothing_hz: float
    torque: RowTorque
    chunks: tuple[Segment, ...]
    sample_period_s: float
    high_pass_hz: float = 0.0
    instruments: FloatArray | None = None
    held_per_s: FloatArray | None = None
    #: Columns without what is slower than a frequency: a search comes back to a few of them.
    _columns_above: dict[float, dict[str, FloatArray]] = field(default_factory=dict, init=False, repr=False)
    _instruments_above: dict[float, FloatArray] = field(default_factory=dict, init=False, repr=False)

    @property
    def train(self) -> BoolArray:
        """Rows to fit to; shape (n_rows,)."""
        return ~(self.held_out | self.edge)

    def high_passed(self, high_pass_hz: float) -> Design:
        """Return the same rows without mean, drift and what is slower than `high_pass_hz`.

        There the air moves the vehicle: gusts, and the moment of the drag at
        the speed that it has picked up, which no gyro tells.
        """
        if high_pass_hz not in self._columns_above:
            self._columns_above[high_pass_hz] = {
                name: self.high_pass(column[:, np.newaxis], high_pass_hz)[:, 0]
                for name, column in self.columns.items()
            }
        if self.instruments is not None and high_pass_hz not in self._instruments_above:
            self._instruments_above[high_pass_hz] = self.high_pass(self.instruments, high_pass_hz)
        return replace(
            self,
            columns=self._columns_above[high_pass_hz],
            instruments=None if self.instruments is None else self._instruments_above[high_pass_hz],
            torque=replace(self.torque, high_pass_hz=high_pass_hz),
            high_pass_hz=high_pass_hz,
        )

    def high_pass(self, columns: FloatArray, high_pass_hz: float) -> FloatArray:
        """Take what is slow out of columns, chunk by chunk; shape (n_rows, n_columns) stays."""
        if not high_pass_hz:
            return columns
        parts = [high_pass(part, self.period_s, high_pass_hz) for part in self._by_chunk(columns)]
        return without_rounding(np.concatenate(parts), columns)

    def _by_chunk(self, columns: FloatArray) -> list[FloatArray]:
        """Split rows into those of each gap-free chunk."""
        return np.split(columns, np.flatnonzero(np.diff(self.chunk)) + 1)

    def without_instruments(self) -> Design:
        """Return the same rows for plain least squares."""
        return self._of_these_columns(replace(self, instruments=None, held_per_s=None))

    def without_held(self, held_per_s: FloatArray) -> Design:
        """Return the same rows, what of the logged rate set-points follows from the attitude taken out.

        Parameters
        ----------
        held_per_s : ndarray, shape (3, 3)
            Rate set-points [rad/s] per angle [rad]; angles as rows.
        """
        grids = [
            _coarser_grid(chunk.n_samples, self.sample_period_s, self.smoothing_hz) for chunk in self.chunks
        ]
        instruments = _instruments([_not_held(chunk, held_per_s) for chunk in self.chunks], grids)
        if instruments is not None:
            instruments = self.high_pass(instruments, self.high_pass_hz)
        return self._of_these_columns(replace(self, instruments=instruments, held_per_s=held_per_s))

    def instrumented_as(self, other: Design) -> Design:
        """Return the same rows with the instruments that another design of the flight chose."""
        if other.instruments is None:
            return self.without_instruments()
        return self if other.held_per_s is None else self.without_held(other.held_per_s)

    def with_chunks(self, chunks: Sequence[Segment]) -> Design:
        """Return the same rows with other torque and thrust of the same chunks of the flight."""
        changed = replace(self.with_torque([chunk.torque for chunk in chunks]), chunks=tuple(chunks))
        return self._of_these_instruments(changed)

    def with_torque(self, torques: Sequence[FloatArray]) -> Design:
        """Return the same rows with other torques, one array (n_samples, 3) per chunk."""
        return self._of_these_instruments(replace(self, torque=self.torque.replaced(torques)))

    def _of_these_columns(self, other: Design) -> Design:
        """Let a design that has the same columns know what was high-passed of them."""
        object.__setattr__(other, "_columns_above", self._columns_above)
        return other

    def _of_these_instruments(self, other: Design) -> Design:
        """Let a design that has the same columns and instruments know what was high-passed of both."""
        object.__setattr__(other, "_instruments_above", self._instruments_above)
        return self._of_these_columns(other)

    def disturbances(self, structure: Structure) -> tuple[str, ...]:
        """Return the columns that move the vehicle beside those of a structure; the paper's own have none."""
        if not structure.actuated:
            return ()
        symbols = (term.symbol for term in DISTURBANCES)
        return tuple(each for each in symbols if each in self.columns and each not in structure.columns)

    def thinned(self, n_rows: int) -> Design:
        """Return a design of about `n_rows` rows, of whole chunks spread over the flight."""
        step = int(np.ceil(self.time_s.size / n_rows))
        if step <= 1 or len(self.chunks) < step:
            return self
        chosen = range(0, len(self.chunks), step)
        rows = np.isin(self.chunk, chosen)
        return replace(
            self,
            time_s=self.time_s[rows],
            columns={name: column[rows] for name, column in self.columns.items()},
            chunk=self.chunk[rows],
            block=self.block[rows],
            held_out=self.held_out[rows],
            edge=self.edge[rows],
            torque=self.torque.chosen(chosen),
            chunks=tuple(self.chunks[number] for number in chosen),
            instruments=None if self.instruments is None else self.instruments[rows],
        )

    def stack(
        self, symbols: Sequence[str], torque: FloatArray, inputs: Sequence[str] = TORQUE_SYMBOLS
    ) -> FloatArray:
        """Return the named columns, those of `inputs` taken from `torque`; shape (n_rows, n_symbols)."""
        known = self.columns | dict(zip(inputs, torque.T, strict=True))
        return np.column_stack([known[symbol] for symbol in symbols])


def build_design(
    data: FlightData, smoothing_hz: float, structures: Iterable[Structure] = STRUCTURES
) -> Design | None:
    """Smooth every segment and lay the rows out in blocks.

    Parameters
    ----------
    data : FlightData
        With segments.
    smoothing_hz : float
        Cut-off of the Gaussian [Hz].
    structures : iterable of Structure
        Whose terms are wanted.

    Returns
    -------
    Design, or None if no segment is longer than the filters' memory.
    """
    wanted = (*RATE_TERMS, *ANGLES, *DISTURBANCES, *(term for each in structures for term in each.terms))
    terms = tuple({term.symbol: term for term in wanted}.values())
    rotors = _rotors(data)
    grids, chunks, parts, times = [], [], [], []
    # Long segments in equal chunks: FFTs stay short, and a search may skip some.
    for chunk in (
        part
        for segment in data.segments
        for part in segment.parts(max(1, int(segment.n_samples * data.sample_period_s / _CHUNK_S)))
    ):
        grid = _coarser_grid(chunk.n_samples, data.sample_period_s, smoothing_hz)
        if grid.n_rows:
            grids.append(grid)
            chunks.append(chunk)
            # Products are formed before smoothing, as in eq. (11).
            found = ((term.symbol, column_of(term, chunk, data.sample_period_s, rotors)) for term in terms)
            raw = {symbol: column for symbol, column in found if column is not None}
            spectrum = grid.spectrum_of(np.column_stack(list(raw.values())))
            smoothed = dict(zip(raw, grid.lay(spectrum).T, strict=True))
            states = [term.symbol for term in (*RATE_TERMS, *ANGLES) if term.symbol in raw]
            slopes = grid.lay(spectrum[:, [list(raw).index(name) for name in states]], grid.s)
            smoothed |= {f"{name}_dot": slope for name, slope in zip(states, slopes.T, strict=True)}
            smoothed[TRIM.symbol] = np.ones(grid.n_rows)
            parts.append(smoothed)
            row_period_s = data.sample_period_s * grid.n_padded / grid.n_out
            times.append(
                chunk.start_s + row_period_s * np.arange(grid.rows.start, grid.rows.stop, dtype=np.float64)
            )
    if not parts:
        return None
    time_s = np.concatenate(times)
    number = np.repeat(np.arange(len(grids), dtype=np.int64), [grid.n_rows for grid in grids])
    period_s = float(np.median(np.diff(time_s)))
    reach_s = gaussian_reach_s(smoothing_hz)
    in_all = set.intersection(*map(set, parts))
    throttle = [segment.throttle for segment in data.segments if segment.throttle is not None]
    if len(throttle) < len(data.segments):
        mean_throttle = None
    else:
        all_throttle = np.concatenate(throttle)
        mean_throttle = float(all_throttle.mean()) if np.std(all_throttle) > _LEAST_THROTTLE else None
    torque = RowTorque.of(
        chunks,
        grids,
        mean_throttle=mean_throttle,
        gyro_filter=data.gyro_filter,
        row_period_s=period_s,
    )
    block, held_out, edge = _excited_blocks(number, period_s, reach_s, torque)
    marked = [segment.time_s[segment.saturated] for segment in data.segments]
    saturated_s = np.concatenate(marked)
    if data.input is None or data.input.achieved or not saturated_s.size:
        touched = np.zeros(time_s.shape, dtype=np.bool_)
    else:
        first = np.searchsorted(saturated_s, time_s - reach_s - _ACTUATOR_MEMORY_S)
        after = np.searchsorted(saturated_s, time_s + reach_s)
        touched = np.asarray(after > first, dtype=np.bool_)
        touched = touched if np.mean(touched) < _MOST_TOUCHED else np.zeros_like(touched)
    return Design(
        time_s=time_s,
        columns={name: np.concatenate([part[name] for part in parts]) for name in in_all},
        chunk=number,
        block=block,
        held_out=held_out,
        edge=edge | (touched & ~held_out),
        period_s=period_s,
        smoothing_hz=smoothing_hz,
        torque=torque,
        chunks=tuple(chunks),
        sample_period_s=data.sample_period_s,
        instruments=_instruments(chunks, grids),
    )


def n_smoothed(segment: Segment, period_s: float, smoothing_hz: float) -> int:
    """Return how many rows `smooth_segment` leaves of a segment.

    Parameters
    ----------
    segment : Segment
    period_s, smoothing_hz : float
        Of its samples; cut-off of the Gaussian.

    Returns
    -------
    int
    """
    return RowGrid.of(segment.n_samples, period_s, smoothing_hz).n_rows


def smooth_segment(
    segment: Segment, period_s: float, smoothing_hz: float, names: Sequence[str], terms: Sequence[Term]
) -> tuple[FloatArray, FloatArray]:
    """Return times and smoothed columns of one segment at its full rate, torque as logged.

    This is what the paper's windows are cut from. The filter's reach is
    dropped at both ends, so the result may be empty.

    Parameters
    ----------
    segment : Segment
    period_s, smoothing_hz : float
        Of its samples; cut-off of the Gaussian.
    names : sequence of str
        Symbols of the columns: of terms, torques, and derivatives of rates and angles.
    terms : sequence of Term
        Those of the columns, beside rates, angles and torques.

    Returns
    -------
    time_s : ndarray, shape (n_rows,)
    columns : ndarray, shape (n_rows, n_names)
        Without rows where the segment lacks one of them.
    """
    grid = RowGrid.of(segment.n_samples, period_s, smoothing_hz)
    known = {term.symbol: term for term in (*RATE_TERMS, *ANGLES, *terms)}
    torques = dict(zip(TORQUE_SYMBOLS, segment.torque.T, strict=True))
    found = np.ones((grid.n_rows, len(names)))
    # One after the other: each is as long as the flight, and so is all that it is made by.
    for result, name in zip(found.T, names, strict=True):
        if name == TRIM.symbol:
            continue
        symbol = name.removesuffix("_dot")
        raw = torques[symbol] if symbol in torques else column_of(known[symbol], segment, period_s)
        if raw is None:
            return np.zeros(0), np.zeros((0, len(names)))
        spectrum = grid.spectrum_of(raw[:, np.newaxis])
        result[:] = grid.lay(spectrum, None if symbol == name else grid.s)[:, 0]
    return segment.time_s[grid.rows], found


def _coarser_grid(n_samples: int, period_s: float, smoothing_hz: float) -> RowGrid:
    """Return the coarsest grid that holds the smoothed band."""
    rows_hz = _ROWS_PER_CUTOFF * smoothing_hz
    return RowGrid.of(n_samples, period_s, smoothing_hz, rows_hz=rows_hz, settle_s=_ACTUATOR_MEMORY_S)


def _instruments(chunks: Sequence[Segment], grids: Sequence[RowGrid]) -> FloatArray | None:
    """Return the smoothed references at several delays; None unless all chunks have them."""
    references = [
        by_driven_axis(chunk.reference, chunk.torque, chunk.time_s)
        for chunk in chunks
        if chunk.reference is not None
    ]
    if len(references) < len(chunks):
        return None
    n_references = max(reference.shape[1] for reference in references)
    parts = []
    for reference, grid in zip(references, grids, strict=True):
        spectrum = grid.spectrum_of(reference)
        delayed = [grid.lay(spectrum, delay_response(grid.s, delay_s)) for delay_s in _INSTRUMENT_DELAYS_S]
        # Of pooled logs one may have a chirp of a system-ID mode, and the others none.
        missing = n_references - reference.shape[1]
        parts.append(np.column_stack([np.pad(columns, ((0, 0), (0, missing))) for columns in delayed]))
    return np.concatenate(parts)


def _not_held(chunk: Segment, held_per_s: FloatArray) -> Segment:
    """Return a chunk whose rate set-points are less what follows from its attitude."""
    if chunk.reference is None or chunk.attitude_rad is None:
        return chunk
    reference = chunk.reference.copy()
    rest = reference[:, :3] - chunk.attitude_rad @ held_per_s
    reference[:, :3] = without_rounding(rest, reference[:, :3])
    return replace(chunk, reference=reference)


def _rotors(data: FlightData) -> RotorField | None:
    """Return where the rotors are, with their mean thrust; None unless it is known throughout."""
    thrust = [segment.rotor_thrust for segment in data.segments if segment.rotor_thrust is not None]
    if data.input is None or data.input.torque_per_thrust is None or len(thrust) < len(data.segments):
        return None
    mean = sum(each.sum() for each in thrust) / sum(each.size for each in thrust)
    return RotorField(data.input.torque_per_thrust, float(mean))


def _excited_blocks(
    chunk: IntArray, period_s: float, reach_s: float, torque: RowTorque
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Cut the rows into blocks of which both sets hold some excitation of each axis; as `lay_blocks`.

    Where a manoeuvre is so short that one set misses it, half as long blocks divide it among both.
    Only the torque is asked, so that no result can choose its own test.
    """
    change = np.diff(torque.as_logged(), axis=0, prepend=np.nan)
    change[np.diff(chunk, prepend=chunk[0] - 1) != 0] = 0.0
    energy = change**2
    whole = np.maximum(energy.sum(axis=0), np.finfo(float).tiny)
    laid: dict[float, tuple[IntArray, BoolArray, BoolArray]] = {}
    for length_s in _BLOCKS_S:
        blocks = lay_blocks(chunk, period_s, reach_s, length_s)
        fraction = energy[blocks[1]].sum(axis=0) / whole
        least = float(np.minimum(fraction, 1.0 - fraction).min())
        if least >= _LEAST_EXCITATION:
            return blocks
        laid[least] = laid.get(least, blocks)
    return laid[max(laid)]


def lay_blocks(
    chunk: IntArray, period_s: float, reach_s: float, length_s: float = HELD_OUT_BLOCK_S
) -> tuple[IntArray, BoolArray, BoolArray]:
    """Cut the rows into blocks and set every third or so aside.

    Parameters
    ----------
    chunk : ndarray of int, shape (n_rows,)
        Number of the gap-free chunk of each row.
    period_s, reach_s : float
        Between the rows, and of the smoothing kernel to either side [s].
    length_s : float
        Of a block [s].

    Returns
    -------
    block : ndarray of int, shape (n_rows,)
    held_out : ndarray of bool, shape (n_rows,)
    edge : ndarray of bool, shape (n_rows,)
        Rows of the others whose kernel reaches into a held-out block or back from it.
    """
    n_rows = chunk.size
    # At least six blocks, so that a short flight can still be held out and cross-validated.
    length = max(1, int(min(length_s, n_rows * period_s / 6.0) / period_s))
    new_block = np.zeros(n_rows, dtype=bool)
    for first in np.flatnonzero(np.diff(chunk, prepend=chunk[0] - 1)):
        end = np.searchsorted(chunk, chunk[first], side="right")
        new_block[first:end:length] = True
    block = np.cumsum(new_block) - 1
    held_out = np.floor((block + 1) * HELD_OUT_FRACTION) > np.floor(block * HELD_OUT_FRACTION)
    reach = int(np.ceil(reach_s / period_s))
    change = np.flatnonzero((np.diff(held_out.astype(np.int8)) != 0) & (np.diff(chunk) == 0))
    edge = np.zeros(n_rows, dtype=bool)
    for index in change:
        edge[max(index + 1 - reach, 0) : index + 1 + reach] = True
    return block.astype(np.int64), held_out, edge & ~held_out
