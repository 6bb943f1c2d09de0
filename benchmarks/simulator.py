"""How long the simulator takes: one logged flight, and a batch of 200.

Run with ``python benchmarks/simulator.py [N_FLIGHTS]``. Processor time of one core.
"""

from __future__ import annotations

import dataclasses
import sys
import time

from quadid_logs.simulator import SCENARIOS, fly_many, plan_flights, simulate


def main() -> None:
    """Print both figures beside their limits."""
    n_flights = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    simulate("hover", duration_s=15.0)  # imports are not the simulator's time
    began = time.process_time()
    simulate("sysid-quad-x")
    print(f"one 60 s flight at 400 Hz, logged: {time.process_time() - began:.2f} s (limit 2 s)")
    scenario = SCENARIOS["sysid-quad-x"]
    (setup,) = plan_flights(scenario, seed=0, duration_s=60.0, rate_hz=400.0)
    setups = [dataclasses.replace(setup, seed=seed) for seed in range(n_flights)]
    began = time.process_time()
    fly_many(setups)
    print(f"{n_flights} such flights at once: {time.process_time() - began:.1f} s (limit 60 s for 200)")


if __name__ == "__main__":
    main()
