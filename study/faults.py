"""Faults of rotors: how often each is named in simulated flights, and how often one is in flights without.

    python study/faults.py -o faults.jsonl [--clean 30] [--each 5] [--seed 0] [--seconds 30 40]

Every flight is a line of the file; a run that was stopped goes on where it ended. The flights are short
(30 to 40 s, unless told otherwise), of a careful pilot, of one who moves the sticks, of a hover in wind, all
in rough air, on all three autopilots in turn.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from quadid_logs.align import cut
from quadid_logs.data.settings import AlignSettings
from quadid_logs.health import health_of
from quadid_logs.load import prepare
from quadid_logs.simulator import fly, plan_flights
from quadid_logs.simulator.effects import Effects
from quadid_logs.simulator.logger import Logging, log_flights
from quadid_logs.simulator.scenarios import SCENARIOS
from quadid_logs.simulator.vendors import motor_order
from quadid_logs.simulator.wind import Wind

AUTOPILOTS = ("ardupilot", "px4", "betaflight")
ROUGH = (1.3, 1.3, 0.43)
#: What is flown without a fault: a scenario's manoeuvre, and the wind [m/s].
CLEAN = (
    ("gentle-hover", 2.0),
    ("pilot-sticks", 0.0),
    ("hover", 5.0),
    ("sysid-quad-x", 0.0),
    ("gentle-hover", 6.0),
)
#: The code that names each fault.
CODES = {
    "weak": "QL430",
    "step": "QL431",
    "ramp": "QL431",
    "bent": "QL432",
    "desync": "QL433",
    "mass": "QL434",
    "clipping": "QL435",
}


def fault(kind: str, rotor: int, rng: np.random.Generator) -> Effects:
    """Return the effects of a fault of one rotor, from 1, at a random time."""
    at = float(rng.uniform(0.35, 0.6))
    angle = float(rng.uniform(0.0, 2.0 * np.pi))
    return {
        "clean": Effects(),
        "weak": Effects(motor_fault=rotor, motor_fault_at=0.0),
        "step": Effects(motor_fault=rotor, motor_fault_at=at),
        "ramp": Effects(motor_fault=rotor, motor_fault_at=at - 0.1, motor_ramp_s=8.0),
        "bent": Effects(bent_propeller=rotor),
        "desync": Effects(desync_rotor=rotor, desync_at=at),
        "mass": Effects(mass_offset=(0.03 * np.cos(angle), 0.03 * np.sin(angle))),
        "clipping": Effects(
            bent_propeller=rotor, propeller_gyro_rad_s=1.5, propeller_acceleration_m_s2=250.0
        ),
    }[kind]


def flown(kind: str, seed: int, seconds: tuple[float, float]) -> dict[str, Any]:
    """Fly once and return what was found."""
    rng = np.random.default_rng([seed, *kind.encode()])
    autopilot = AUTOPILOTS[seed % len(AUTOPILOTS)]
    name, wind = CLEAN[seed // len(AUTOPILOTS) % len(CLEAN)] if kind == "clean" else ("gentle-hover", 2.0)
    rotor = int(rng.integers(1, 5))
    effects = dataclasses.replace(fault(kind, rotor, rng), disturbance_rad_s2=ROUGH)
    scenario = dataclasses.replace(SCENARIOS[name], effects=effects, wind=Wind(speed_m_s=wind))
    duration_s = round(float(rng.uniform(*seconds)), 1)
    setups = plan_flights(scenario, seed=seed, duration_s=duration_s, rate_hz=400.0, autopilot=autopilot)
    log = log_flights(tuple(fly(setup) for setup in setups), Logging())
    prepared = prepare(log)
    health = health_of(prepared, cut(prepared, AlignSettings()))
    order = list(motor_order(setups[0])) if autopilot == "betaflight" else list(range(4))
    rotors, vibration = health.rotors, health.vibration
    found = (
        []
        if rotors is None
        else [
            {
                "code": one.code,
                "rotor": order[one.rotor] + 1 if one.rotor >= 0 else 0,
                "p": one.p_value,
                "size": one.size.value,
            }
            for one in rotors.faults
        ]
    )
    for topic in (vibration, health.tracking):
        found += [] if topic is None else [{"code": code, "rotor": 0} for code in topic.findings]
    return {
        "kind": kind, "seed": seed, "autopilot": autopilot, "flight": name, "rotor": rotor,
        "duration_s": duration_s, "found": found,
    }  # fmt: skip


def named(row: dict[str, Any]) -> bool:
    """Return whether the fault was named, with its rotor where it has one."""
    code, needs_rotor = CODES[row["kind"]], row["kind"] not in ("mass", "clipping")
    return any(
        one["code"] == code and (not needs_rotor or one["rotor"] == row["rotor"]) for one in row["found"]
    )


def summary(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each kind."""
    for kind in ("clean", *CODES):
        mine = [row for row in rows if row["kind"] == kind]
        if not mine:
            continue
        if kind == "clean":
            alarms = [row for row in mine if row["found"]]
            yield f"clean      {len(alarms)} of {len(mine)} found: {[one['found'] for one in alarms]}"
        else:
            hits = sum(named(row) for row in mine)
            others = sum(
                any(
                    one["code"] not in (CODES[kind], "QL432" if kind == "clipping" else "")
                    for one in row["found"]
                )
                for row in mine
            )
            yield f"{kind:10} named in {hits} of {len(mine)}; another finding in {others}"


def main() -> None:
    """Fly what is not flown yet, and tell."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--clean", type=int, default=30)
    parser.add_argument("--each", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", choices=tuple(CODES), default=tuple(CODES))
    parser.add_argument("--seconds", nargs=2, type=float, default=(30.0, 40.0), metavar=("LOW", "HIGH"))
    options = parser.parse_args()
    rows = (
        [json.loads(line) for line in options.output.read_text().splitlines()]
        if options.output.exists()
        else []
    )
    done = {(row["kind"], row["seed"]) for row in rows}
    wanted = [("clean", options.seed + n) for n in range(options.clean)]
    wanted += [(kind, options.seed + n) for n in range(options.each) for kind in options.kinds]
    with options.output.open("a") as file:
        for kind, seed in wanted:
            if (kind, seed) not in done:
                rows.append(flown(kind, seed, tuple(options.seconds)))
                file.write(json.dumps(rows[-1]) + "\n")
                file.flush()
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
