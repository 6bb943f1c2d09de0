"""What one damaged place in a log costs beyond itself.

Run with ``python benchmarks/damage_places.py``; prints a Markdown table. Each
intact log of the corpus below 20 MB is damaged at one random place, twelve
times: 1 B to 64 kB of zeros, noise, a copy from elsewhere or a flood of
headers, or one flipped bit. Rows that touch the damage are its price; what is
counted are the others that were lost, and rows that stand where none was.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from benchmarks.damage import our_places
from benchmarks.logs import corpus_folder

MOST_BYTES = 20e6
PER_LOG = 12
HEADS = {".bin": b"\xa3\x95\x80", ".tlog": b"\xfd\x10\x00\x00", ".ulg": b"\x40\x00D\x01\x00"}
KINDS = ("zeros", "noise", "copy", "headers", "one bit")
#: So many rows before and behind the damage may be affected.
FEW = 2


class Cost(NamedTuple):
    """Rows lost though they do not touch the damage, and rows made up outside of it."""

    lost: int
    made_up: int
    where: str


def main() -> None:
    """Damage, read, compare, print."""
    folder = corpus_folder()
    rng = random.Random(0)
    costs: dict[str, list[Cost]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as scratch:
        for path in _intact_logs(folder):
            for _ in range(PER_LOG):
                kind = rng.choice(KINDS)
                costs[kind].append(_cost(path, kind, rng, Path(scratch)))
    print(
        f"| damage | logs | most other rows lost | logs that lost more than {FEW} | rows made up elsewhere |"
    )
    print("|---|---|---|---|---|")
    for kind in KINDS:
        found = costs[kind]
        dear = sum(cost.lost > FEW for cost in found)
        most, made_up = max(cost.lost for cost in found), sum(cost.made_up for cost in found)
        print(f"| {kind} | {len(found)} | {most} | {dear} | {made_up} |")
    print()
    for cost in (cost for found in costs.values() for cost in found if cost.lost > FEW):
        print(f"{cost.lost} rows: {cost.where}")


def _intact_logs(folder: Path) -> list[Path]:
    """Return the logs whose rows can be counted and that are not too long."""
    logs = [path for part in ("real", "firmware") for path in sorted((folder / part).iterdir())]
    return [path for path in logs if path.suffix.lower() in HEADS and path.stat().st_size < MOST_BYTES]


def _cost(path: Path, kind: str, rng: random.Random, folder: Path) -> Cost:
    """Damage one place of a log and count."""
    content = path.read_bytes()
    rows = our_places(path)
    # The header and the first definitions stand nowhere else: without them there is no log.
    first = int(rows[min(5, len(rows) - 1)])
    size = 1 if kind == "one bit" else min(int(2 ** rng.uniform(0.0, 16.0)), len(content) // 4)
    start = rng.randrange(first, len(content) - size)
    damaged = bytearray(content)
    damaged[start : start + size] = _damage(kind, content[start : start + size], content, path, rng)
    copy = folder / f"log{path.suffix}"
    copy.write_bytes(damaged)
    found = our_places(copy)
    ends = np.append(rows[1:], len(content))
    others = rows[(ends <= start) | (rows >= start + size)]
    made_up = np.setdiff1d(found, rows)
    return Cost(
        lost=int(np.count_nonzero(~np.isin(others, found))),
        made_up=int(np.count_nonzero((made_up < start) | (made_up >= start + size))),
        where=f"{path.name}, {size} B of {kind} at {start}",
    )


def _damage(kind: str, there: bytes, content: bytes, path: Path, rng: random.Random) -> bytes:
    """Return as many damaged bytes."""
    size = len(there)
    if kind == "zeros":
        return bytes(size)
    if kind == "noise":
        return rng.randbytes(size)
    if kind == "copy":
        place = rng.randrange(len(content) - size)
        return content[place : place + size]
    if kind == "headers":
        head = HEADS[path.suffix.lower()]
        return (head * (size // len(head) + 1))[:size]
    return bytes([there[0] ^ 1 << rng.randrange(8)])


if __name__ == "__main__":
    main()
