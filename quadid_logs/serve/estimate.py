"""How far a job is and how long it still takes, from its size, its stages, and the jobs before it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from quadid_logs.serve.entries import Kind

#: Fraction of an analysis that is done when a stage begins, and when it ends.
_STAGES: Final[Mapping[str, tuple[float, float]]] = {
    "": (0.0, 0.04),  # the process begins
    "read": (0.04, 0.1),
    "align": (0.1, 0.15),
    "identify": (0.15, 0.85),
    "writing the report": (0.85, 1.0),
    # Only where the history needs a fit of its own, which takes as long as the first.
    "adding it to the history": (0.55, 1.0),
}
#: From here on the time that was taken says more about the rest than the size does.
_LATE: Final = 0.5
#: Before anything is known of this machine [s], [s/byte]: a log of 40 MB takes 10 s.
_BASE_S: Final = 3.0
_PER_BYTE_S: Final = 1.8e-7
#: Weight of the newest job in what is expected of the next.
_NEWEST: Final = 0.3
#: Of what takes longer than expected, so much of the rest seems done.
_NEVER_FULL: Final = 0.95


class Pace:
    """How long jobs take on this machine, learnt from those that are done."""

    def __init__(self) -> None:
        self._factor = 1.0

    def expected_s(self, n_bytes: int, kind: Kind = Kind.ANALYZE) -> float:
        """Return how long a job is expected to take [s].

        Parameters
        ----------
        n_bytes : int
            Of its logs together.
        """
        base = 2.0 * _BASE_S if kind is Kind.COMPARE else _BASE_S
        return self._factor * (base + _PER_BYTE_S * n_bytes)

    def learn(self, n_bytes: int, took_s: float, kind: Kind = Kind.ANALYZE) -> None:
        """Note how long a job took."""
        ratio = took_s / self.expected_s(n_bytes, kind)
        self._factor *= math.exp(_NEWEST * math.log(min(max(ratio, 0.1), 10.0)))


@dataclass(slots=True, kw_only=True)
class Progress:
    """Of one running job: when it and its stage began, on the monotonic clock [s]."""

    began_s: float
    expected_s: float
    stage: str = ""
    stage_began_s: float = 0.0
    shown: float = 0.0

    def begin_stage(self, stage: str, now_s: float) -> None:
        """Note that a stage begins; what was expected of the whole is set right by it."""
        self.stage, self.stage_began_s = stage, now_s
        before = _STAGES.get(stage, (0.0, 1.0))[0]
        if before >= _LATE:
            self.expected_s = (now_s - self.began_s) / before

    def fraction(self, now_s: float) -> float:
        """Return how much is done, never 1."""
        low, high = _STAGES.get(self.stage, (0.0, 1.0))
        expected_s = max((high - low) * self.expected_s, 1e-3)
        within = (now_s - (self.stage_began_s or self.began_s)) / expected_s
        now = low + (high - low) * _NEVER_FULL * (1.0 - math.exp(-1.5 * within))
        self.shown = max(self.shown, now)  # a bar that goes back tells nobody anything
        return self.shown

    def left_s(self, now_s: float) -> float:
        """Return how long it still takes [s]."""
        # What takes longer than expected will go on doing so.
        return (1.0 - self.fraction(now_s)) * max(self.expected_s, now_s - self.began_s)
