"""How long the simulator takes for one logged flight, on one core: `python benchmarks/simulator.py`."""

from __future__ import annotations

import time

from quadid_logs.simulator import simulate


def main() -> None:
    """Print the time beside its limit."""
    simulate("hover", duration_s=15.0)  # imports are not the simulator's time
    began = time.process_time()
    simulate("sysid-quad-x")
    print(f"one 60 s flight at 400 Hz, logged: {time.process_time() - began:.2f} s (limit 2 s)")


if __name__ == "__main__":
    main()
