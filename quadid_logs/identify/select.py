"""Of a very long flight, the part that is excited most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from quadid_logs.data.flight import FlightData

#: A flight is chosen from in chunks of a minute: long against the memory of
#: all filters, short against the time for which a pilot does one thing.
_CHUNK_S = 60.0


def most_excited(data: FlightData, n_samples: int) -> FlightData:
    """Return the chunks of a flight that move the vehicle most, in order of time.

    Parameters
    ----------
    data : FlightData
    n_samples : int
        As many are kept, to a chunk. A shorter flight stays as it is.

    Returns
    -------
    FlightData
    """
    if data.n_samples <= n_samples:
        return data
    chunks = [
        chunk
        for segment in data.segments
        for chunk in segment.parts(max(1, round(segment.n_samples * data.sample_period_s / _CHUNK_S)))
    ]
    chosen, kept = [], 0
    # Differences: a slow turn is no excitation, and neither is the bias of the gyro.
    energy = np.array([np.sum(np.diff(chunk.body_rate_rad_s, axis=0) ** 2, axis=0) for chunk in chunks])
    total = energy.sum(axis=0)
    # Fractions, so that the axis that moves least counts as much as the others.
    fraction = np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0)
    moved = fraction.sum(axis=1) / [chunk.n_samples for chunk in chunks]
    for number in np.argsort(-moved, kind="stable"):
        if kept >= n_samples:
            break
        chosen.append(int(number))
        kept += chunks[int(number)].n_samples
    return replace(data, segments=tuple(chunks[number] for number in sorted(chosen)))
