"""Write the sample logs anew: `make samples`. Same seeds, same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from quadid_logs.cli.simulate import write_simulation
from quadid_logs.simulator import simulate

FOLDER = Path(__file__).resolve().parent


class Sample(NamedTuple):
    """A sample log: its file name, and what is flown and logged in it."""

    name: str
    scenario: str
    autopilot: str
    duration_s: float
    rate_hz: float | None


SAMPLES = (
    Sample("sysid-quad-x.bin", "sysid-quad-x", "ardupilot", 30.0, 100.0),
    Sample("products-of-inertia.ulg", "products-of-inertia", "px4", 20.0, 100.0),
    Sample("betaflight-doublets.bbl", "doublets", "betaflight", 25.0, 250.0),
    Sample("doublets.tlog", "doublets", "ardupilot", 20.0, 50.0),
    Sample("default-logging.bin", "default-logging", "ardupilot", 40.0, None),
    Sample("damaged.bin", "damaged", "ardupilot", 20.0, 100.0),
)


def main() -> None:
    """Fly and write every sample beside this file."""
    for sample in SAMPLES:
        simulation = simulate(
            sample.scenario,
            seed=1,
            duration_s=sample.duration_s,
            rate_hz=sample.rate_hz,
            autopilot=sample.autopilot,
        )
        write_simulation(simulation, FOLDER / sample.name)


if __name__ == "__main__":
    main()
