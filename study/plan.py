"""Fly plans and hold the promised interval against the achieved one: `python study/plan.py`.

Vehicles of several sizes are flown by their plans in three airs; what `identify` then says of the control
effectiveness is compared with what the plan promised, and with the truth.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from quadid_logs.align import cut  # noqa: E402
from quadid_logs.data.settings import Settings  # noqa: E402
from quadid_logs.identify import identify  # noqa: E402
from quadid_logs.load import prepare  # noqa: E402
from quadid_logs.planning import AIRS, make_plan  # noqa: E402
from quadid_logs.simulator import Scenario, fly, plan_flights  # noqa: E402
from quadid_logs.simulator.airframes import quad_x, scaled  # noqa: E402
from quadid_logs.simulator.effects import Effects  # noqa: E402
from quadid_logs.simulator.logger import Logging, log_flights  # noqa: E402
from quadid_logs.simulator.sweep import sweeps_in_turn  # noqa: E402
from quadid_logs.simulator.truth import flight_truth  # noqa: E402
from quadid_logs.vocabulary import AXES, ON_AXIS  # noqa: E402

#: Propellers of the flown vehicles [inch].
SIZES: Final = (5.0, 7.0, 10.0, 15.0)
RESULTS: Final = ROOT / "docs" / "tuning" / "plan.json"
PAUSE_S: Final = 6.0
RATIO: Final = (0.7, 1.4)


def flights(sizes: tuple[float, ...]) -> Iterator[dict[str, Any]]:
    """Yield one row for each axis of each flight."""
    for number, size in enumerate(sizes):
        for air, gust in AIRS.items():
            yield from flight(size, air, gust, 10 * number + len(air))


def flight(propeller_inch: float, air: str, gust: float, seed: int) -> Iterator[dict[str, Any]]:
    """Fly a plan once, and yield a row for each axis."""
    planned = make_plan("ardupilot", propeller_inch=propeller_inch, air=air)
    filter_hz = max(289.22 * propeller_inch**-0.838, 20.0)
    scenario = Scenario(
        name="plan",
        sentence="",
        airframe=partial(scaled, quad_x(), propeller_inch / 10.0),
        manoeuvre=partial(
            sweeps_in_turn,
            sweeps=[(AXES.index(axis), each) for axis, each in planned.sweeps.items()],
            pause_s=PAUSE_S,
        ),
        gyro_filter_hz=filter_hz,
        effects=Effects(disturbance_rad_s2=(gust, gust, 0.33 * gust)),
        logging=Logging(rate_hz=200.0),
    )
    setups = plan_flights(scenario, seed=seed, duration_s=planned.duration_s, rate_hz=200.0)
    records = tuple(fly(setup) for setup in setups)
    truth = flight_truth(records, scenario="plan", boot_s=scenario.logging.boot_s)["models"]["damped"]["B"]
    data = cut(prepare(log_flights(records, scenario.logging), None), Settings().align)
    model = identify(data, Settings().identify).recommended
    for number, (axis, promised) in enumerate(planned.excitations.items()):
        found = None if model is None else model.entries[ON_AXIS[axis]]
        low, high = (np.nan, np.nan) if found is None else found.ci95
        half = np.nan if found is None else 0.5 * (high - low) / abs(found.value)
        inside = [promised.start_hz, promised.crossover_hz, promised.phase_crossover_hz, promised.stop_hz]
        yield {
            "propeller_inch": propeller_inch,
            "air": air,
            "axis": axis,
            "magnitude": promised.magnitude,
            "record_s": promised.record_s,
            "promised": round(promised.half_width, 4),
            "achieved": round(float(half), 4),
            "ratio": round(float(half) / promised.half_width, 3),
            "true_inside": bool(low <= truth[number][number] <= high),
            "crossovers_inside": bool(np.all(np.diff(inside) > 0.0)),
        }


def summary(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the figures that the page quotes."""
    ratio = np.array([row["ratio"] for row in rows])
    return {
        "axes": len(rows),
        "ratio_within": float(np.mean((ratio >= RATIO[0]) & (ratio <= RATIO[1]))),
        "median_ratio": float(np.median(ratio)),
        "true_inside": float(np.mean([row["true_inside"] for row in rows])),
        "crossovers_inside": float(np.mean([row["crossovers_inside"] for row in rows])),
    }


def main(arguments: list[str]) -> int:
    """Fly the sizes that are given, all by default, and write what came out."""
    rows = []
    for row in flights(tuple(map(float, arguments)) or SIZES):
        rows.append(row)
        print(json.dumps(row), flush=True)
    print(json.dumps(summary(rows)))
    if not arguments:
        RESULTS.write_text(json.dumps({"summary": summary(rows), "rows": rows}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
