"""Small intact logs of every format: what the mutations start from."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import NamedTuple

from quadid_logs.align import cut
from quadid_logs.data.settings import AlignSettings
from quadid_logs.load import load
from quadid_logs.report.series_file import write_table
from quadid_logs.simulator import simulate
from quadid_logs.simulator.dialects import FIRMWARE, in_dialect
from quadid_logs.writers import write_log

REPOSITORY = Path(__file__).resolve().parents[1]
#: Kind of mutations, file of the corpus, first bytes of it to take.
CORPUS_PARTS = (
    ("dataflash", "real/ac33dev-erle-quadx-RATE50Hz-2015-03-31.bin", 120_000),
    ("dataflash", "damaged/truncated-80k-ac462-real.bin", 81_920),
    ("dataflash", "real/sdlog2-quad-70s.px4log", 120_000),
    ("ulog", "real/px4-1.12-f450-tumble-3s.ulg", 200_000),
    ("ulog", "damaged/appended-multiple.ulg", 200_000),
    ("tlog", "real/ac32dev-quad-handrotated-52s.tlog", 60_000),
    ("text", "real/ac311-quadx-nan.log", 60_000),
    ("text", "real/ac30-quadV-underpowered.log", 60_000),
    ("blackbox", "blackbox/bf42-btfl002.bbl", 120_000),
    ("blackbox", "blackbox/several-logs-in-one-file.bbl", 120_000),
    ("blackbox", "blackbox/bf3-log14.bfl", 120_000),
    ("blackbox", "blackbox/cleanflight-2016.txt", 120_000),
    ("blackbox", "blackbox/inav901.txt", 120_000),
    ("usd", "flown/crazyswarm2/logs/log09", 60_000),
    ("usd", "flown/crazyswarm2/logs/log183", 400_000),
    ("text", "real/x8coax_moments_hover.csv", 60_000),
)


class Seed(NamedTuple):
    """One intact log: what it is called, how its content is mutated, its content."""

    name: str
    kind: str
    suffix: str
    content: bytes


def load_seeds(*, whole: bool = False) -> list[Seed]:
    """Return logs flown by our simulator, as every format, and parts of the corpus where it is there.

    With `whole` the logs of the corpus are not cut to their first bytes.
    """
    return _simulated() + _from_corpus(whole=whole)


def _simulated() -> list[Seed]:
    """Fly 15 s at 50 Hz, write it in every format that we write."""
    seeds = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        for suffix, kind, autopilot in (
            (".bin", "dataflash", "ardupilot"),
            (".ulg", "ulog", "px4"),
            (".bbl", "blackbox", "betaflight"),
            (".tlog", "tlog", "ardupilot"),
            (".usd", "usd", "crazyflie"),
        ):
            flight = simulate("sysid-quad-x", seed=1, duration_s=15.0, rate_hz=50.0, autopilot=autopilot)
            write_log(flight.log, path / f"flight{suffix}")
            seeds.append(_seed(path / f"flight{suffix}", kind))
            if kind == "blackbox":
                for dialect in FIRMWARE:
                    write_log(in_dialect(flight.log, dialect), path / f"{dialect}{suffix}")
                    seeds.append(_seed(path / f"{dialect}{suffix}", kind))
        data = cut(load(path / "flight.bin"), AlignSettings())
        for suffix, kind in ((".csv", "text"), (".parquet", "plain")):
            write_table(data, path / f"table{suffix}")
            seeds.append(_seed(path / f"table{suffix}", kind))
    return seeds


def _from_corpus(*, whole: bool) -> list[Seed]:
    """Take some logs of the corpus, or their beginnings."""
    folder = Path(os.environ.get("QUADID_LOG_CORPUS", REPOSITORY.parent / "shared" / "logs"))
    return [
        _seed(folder / name, kind, None if whole else n_bytes)
        for kind, name, n_bytes in CORPUS_PARTS
        if (folder / name).is_file()
    ]


def _seed(path: Path, kind: str, n_bytes: int | None = None) -> Seed:
    """Read one seed."""
    return Seed(path.name, kind, path.suffix, path.read_bytes()[:n_bytes])
