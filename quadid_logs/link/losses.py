"""What a recording lost on the link, and what else happened to it, in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from quadid_logs.counting import counted


@dataclass(slots=True, kw_only=True)
class Losses:
    """Counts of a recording, which its parts add to.

    Attributes
    ----------
    arrived, frames : int
        That arrived in time, and that never did.
    gaps : int
        Places at which frames are missing.
    longest_s : float
        Longest time without data at one of them [s].
    late : int
        Frames that arrived when they were requested again.
    repeated, foreign, senseless : int
        Frames that were there already, that were another program's, and that cannot be.
    events : list of str
        Sentences on what else happened.
    """

    arrived: int = 0
    frames: int = 0
    gaps: int = 0
    longest_s: float = 0.0
    late: int = 0
    repeated: int = 0
    foreign: int = 0
    senseless: int = 0
    events: list[str] = field(default_factory=list)

    def sentences(self) -> Iterator[str]:
        """Yield what to tell at the end."""
        if self.frames:
            percent = 100.0 * self.frames / (self.arrived + self.frames)
            yield (
                f"The link lost {self.frames} of {counted(self.arrived + self.frames, 'frame')} "
                f"({percent:.2g} %) in {counted(self.gaps, 'gap')}, the longest {self.longest_s:.2g} s. "
                "The log marks where."
            )
        else:
            yield f"No frame was lost on the link ({counted(self.arrived, 'frame')})."
        if self.late:
            yield f"{counted(self.late, 'frame')} arrived only when requested again."
        if self.foreign:
            yield (
                f"Another program received this vehicle's log too: {counted(self.foreign, 'frame')} for it "
                "were ignored. Use one recorder at a time."
            )
        if self.senseless:
            yield f"{counted(self.senseless, 'frame')} made no sense and were ignored."
        yield from self.events
