"""Of a very long flight, the part that tells most."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, Segment

#: A flight is chosen from in pieces of a minute: long against the memory of
#: all filters, short against the time for which a pilot does one thing.
_PIECE_S = 60.0


def most_moved(data: FlightData, n_samples: int) -> FlightData:
    """Return the pieces of a flight that move the vehicle most, in order of time.

    Parameters
    ----------
    data : FlightData
    n_samples : int
        As many are kept, to a piece. A shorter flight stays as it is.

    Returns
    -------
    FlightData
    """
    if data.n_samples <= n_samples:
        return data
    pieces = list(_pieces(data))
    chosen, kept = [], 0
    for number in np.argsort(-_moved(pieces), kind="stable"):
        if kept >= n_samples:
            break
        chosen.append(int(number))
        kept += pieces[int(number)].n_samples
    return replace(data, segments=tuple(pieces[number] for number in sorted(chosen)))


def _moved(pieces: list[Segment]) -> FloatArray:
    """Return how much each piece moves, as its share of the motion of each axis; shape (n_pieces,).

    Shares, so that the axis that moves least counts as much as the others.
    """
    # Differences: a slow turn is no excitation, and neither is the bias of the gyro.
    energy = np.array([np.sum(np.diff(piece.body_rate_rad_s, axis=0) ** 2, axis=0) for piece in pieces])
    total = energy.sum(axis=0)
    share = np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0)
    return np.asarray(share.sum(axis=1) / [piece.n_samples for piece in pieces], dtype=np.float64)


def _pieces(data: FlightData) -> Iterator[Segment]:
    """Cut the segments into pieces of about a minute."""
    for segment in data.segments:
        n_pieces = max(1, round(segment.n_samples * data.sample_period_s / _PIECE_S))
        for first, after in pairwise(np.linspace(0, segment.n_samples, n_pieces + 1).astype(int)):
            yield segment.rows(slice(int(first), int(after)))
