"""Fetch a log from a fake vehicle over a link that loses packets, and compare it.

The fake vehicle runs in the same process, so the rate is that of both ends together.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from pathlib import Path

from quadid_logs.link.fetch import Logs
from tests.link.fake_vehicle import FakeVehicle


def main() -> None:
    """Fetch once and print size, time and whether the bytes are equal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=20.0)
    parser.add_argument("--loss", type=float, default=0.01)
    given = parser.parse_args()
    content = random.Random(0).randbytes(int(given.megabytes * 1e6))
    vehicle = FakeVehicle({"/APM/LOGS/1.BIN": content}, loss=given.loss, reorder=0.0)
    with tempfile.TemporaryDirectory() as folder, vehicle, Logs(vehicle.address) as logs:
        began_s = time.monotonic()
        fetched = logs.fetch(logs.logs[-1], Path(folder))
        spent_s = time.monotonic() - began_s
        equal = fetched.path.read_bytes() == content
    print(
        f"{given.megabytes:g} MB with {given.loss:.1%} loss: {spent_s:.0f} s, "
        f"{'identical' if equal else 'DIFFERENT'}, "
        f"checksum {'compared' if fetched.checked else 'not compared'}"
    )


if __name__ == "__main__":
    main()
