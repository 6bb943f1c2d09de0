"""Damage to a finished log file, as cards and power cuts cause it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from quadid_logs.errors import SimulationError


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """What happens to a file, and where: ``at`` is a fraction of its length.

    ``n_bytes`` are overwritten with noise or zeros, or missing; "cut" ends the file at ``at``.
    """

    kind: Literal["noise", "zeros", "missing", "cut"]
    at: float
    n_bytes: int = 0


def damage_bytes(content: bytes, damages: tuple[Damage, ...], seed: int) -> bytes:
    r"""Return a file's content with all damages applied, the later ones in the file first.

    Parameters
    ----------
    seed : int
        Of the noise.

    Raises
    ------
    SimulationError
        If a damage lies outside the file.

    Examples
    --------
    >>> damage_bytes(b"abcdefgh", (Damage(kind="zeros", at=0.5, n_bytes=2),), 0)
    b'abcd\x00\x00gh'
    """
    rng, n_bytes = np.random.default_rng(seed), len(content)
    for damage in sorted(damages, key=lambda one: -one.at):
        if not 0.0 <= damage.at <= 1.0 or damage.n_bytes < 0:
            raise SimulationError(f"A damage at {damage.at:g} of the file with {damage.n_bytes} bytes.")
        begin = int(damage.at * n_bytes)
        end = max(min(begin + damage.n_bytes, len(content)), begin)
        if damage.kind == "cut":
            content = content[:begin]
            continue
        fill = {"noise": rng.bytes(end - begin), "zeros": bytes(end - begin), "missing": b""}
        content = content[:begin] + fill[damage.kind] + content[end:]
    return content
