"""Yaw whose damping no flight shows: fly vehicles with rotor drag only, and compare their margins.

`python study/yaw_damping.py --vehicles 10`. A told margin is right within 3 degrees and 1 dB.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Final

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from quadid_logs.data.closed_loop import Estimated  # noqa: E402
from quadid_logs.simulator import fly  # noqa: E402
from quadid_logs.simulator.truth import flight_truth  # noqa: E402
from study import tuning  # noqa: E402

_YAW: Final = 2
_DEGREES, _DB = 3.0, 1.0
#: Of each rotor of a vehicle of 1.5 kg, which makes a lead of 0.06 to 0.18 s in half of the flights [kg m^2].
_ROTOR_KG_M2: Final = 1.4e-5


def compare(seed: int, number: int) -> tuple[str, list[tuple[Estimated | None, Estimated | None]]]:
    """Fly one vehicle without damping of yaw, every other with heavy rotors.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    str
        The verdict of the axis.
    list of tuple
        Phase margin [deg] and gain margin [dB] as told, and true.
    """
    scenario, autopilot, _ = tuning.draw_vehicle(seed, number)
    frame = scenario.airframe()
    damping = np.array(frame.rate_damping_n_m_s)
    damping[_YAW] = 0.0
    rotor = _ROTOR_KG_M2 * (frame.mass_kg / 1.5) ** 1.5 * (number % 2)
    still = dataclasses.replace(frame, rate_damping_n_m_s=damping, rotor_inertia_kg_m2=rotor)
    scenario = dataclasses.replace(scenario, airframe=lambda: still)
    setup = tuning.setup_of(scenario, autopilot, np.ones((4, 3)), number)
    record = fly(setup)
    result = tuning.analyzed(record, scenario)
    true = tuning.true_margins(setup, flight_truth((record,), scenario="", boot_s=0.0), _YAW).full
    loop = None if result.closed_loop is None else result.closed_loop.axes["yaw"].margins
    told = None if loop is None else loop.full or loop.rate
    pairs = [
        (None if told is None else getattr(told, name), None if true is None else getattr(true, name))
        for name in ("phase_margin_deg", "gain_margin_db")
    ]
    return result.diagnosis.axes["yaw"].verdict, pairs


def main(arguments: list[str] | None = None) -> int:
    """Fly the vehicles and print the bar."""
    parser = argparse.ArgumentParser(description="Margins of a yaw whose damping cannot be seen.")
    parser.add_argument("--vehicles", type=int, default=10)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args(arguments)
    right = 0
    for number in range(options.vehicles):
        verdict, pairs = compare(options.seed, number)
        near = all(
            told is not None and true is not None and abs(told.value - true.value) <= within
            for (told, true), within in zip(pairs, (_DEGREES, _DB), strict=True)
        )
        right += near
        texts = [
            "not told"
            if told is None or true is None
            else f"{told.value:.1f} {told.ci95}, true {true.value:.1f}"
            for told, true in pairs
        ]
        print(f"vehicle {number} {verdict}: {'; '.join(texts)}", flush=True)
    print(f"{right} of {options.vehicles} told within {_DEGREES:g} degrees and {_DB:g} dB")
    return 0 if right == options.vehicles else 1


if __name__ == "__main__":
    raise SystemExit(main())
