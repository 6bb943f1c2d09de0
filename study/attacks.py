"""Fly what is likeliest to give a confident wrong number, and count what is told: `python study/attacks.py`.

Each attack is a small population of its own: vehicles, air and manoeuvre are drawn at random, and what is
attacked with is in every flight. The coverage study (`study/run.py`) draws the same effects rarely.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from quadid_logs.align import cut  # noqa: E402
from quadid_logs.data.log import FlightLog  # noqa: E402
from quadid_logs.data.settings import Settings  # noqa: E402
from quadid_logs.diagnose import diagnose  # noqa: E402
from quadid_logs.health import faults_of  # noqa: E402
from quadid_logs.identify import identify  # noqa: E402
from quadid_logs.identify.two_vehicles import with_lost_thrust  # noqa: E402
from quadid_logs.load import prepare  # noqa: E402
from quadid_logs.simulator import Scenario, fly, manoeuvres, plan_flights  # noqa: E402
from quadid_logs.simulator.airframes import hexa_x, quad_x, scaled  # noqa: E402
from quadid_logs.simulator.closed_loop import Setup, Tuning  # noqa: E402
from quadid_logs.simulator.effects import Effects  # noqa: E402
from quadid_logs.simulator.logger import Logging, log_flights  # noqa: E402
from quadid_logs.simulator.truth import flight_truth  # noqa: E402
from quadid_logs.vocabulary import AXES, ON_AXIS  # noqa: E402
from study.measure import per_command  # noqa: E402
from study.structural import FLOWN_DISTURBANCE_RAD_S2, log_uniform  # noqa: E402

TABLE: Final = ROOT / "docs" / "coverage" / "attacks.md"
_DURATION_S: Final = 40.0
#: Half-widths from the middle beyond which a usable interval is wrong.
_WRONG: Final = 1.5

Change = Callable[[FlightLog], FlightLog]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Attack:
    """One flight: how it is flown, what is done to its log, and each axis' true gain as a factor.

    ``second`` is flown behind the first in the same log. ``factors`` are the gains that the vehicle has in
    the course of the log over those of the first flight's airframe, (n, 3).
    """

    scenario: Scenario
    autopilot: str = "ardupilot"
    change: Change | None = None
    second: Scenario | None = None
    factors: tuple[tuple[float, float, float], ...] = ((1.0, 1.0, 1.0),)
    settings: dict[str, float | str] = dataclasses.field(default_factory=dict)


def _scenario(
    rng: np.random.Generator, effects: dict[str, Any], quad: bool = False, **changes: Any
) -> Scenario:
    """Draw a vehicle of 5 to 15 inches in calm or gusty air with all axes excited at once."""
    frame = quad_x if rng.random() < 0.7 or quad else hexa_x
    gust = float(rng.choice([0.05, 0.3, 1.0]))
    air = {"disturbance_rad_s2": (gust, gust, 0.33 * gust)}
    described: dict[str, Any] = {
        "name": "attack",
        "sentence": "",
        "airframe": partial(scaled, frame(), rng.uniform(0.5, 1.5)),
        "manoeuvre": manoeuvres.multisine if rng.random() < 0.5 else manoeuvres.sticks,
        "duration_s": _DURATION_S,
        "gyro_filter_hz": rng.uniform(30.0, 80.0),
        "logging": Logging(rate_hz=float(rng.choice([200.0, 400.0]))),
        "effects": Effects(**(air | effects)),
    }
    return Scenario(**(described | changes))


def _rotor_dead_zone(rng: np.random.Generator) -> Attack:
    """Take 0.5 to 4 % from each rotor's command."""
    size = log_uniform(rng, 0.005, 0.04)
    return Attack(scenario=_scenario(rng, {"rotor_dead_zone": size}), settings={"size": size})


def _circular(rng: np.random.Generator) -> Attack:
    """Log, as torque, the inertia that somebody assumed times the differentiated rate."""
    rate_hz, assumed = float(rng.choice([50.0, 100.0, 200.0, 400.0])), rng.uniform(0.6, 1.5)
    forward = bool(rng.random() < 0.5)
    autopilot = str(rng.choice(["ardupilot", "px4", "betaflight"]))
    scenario = _scenario(rng, {}, quad=autopilot == "betaflight", logging=Logging(rate_hz=rate_hz))
    return Attack(
        scenario=scenario,
        autopilot=autopilot,
        change=partial(with_computed_torque, scale=assumed, forward=forward),
        settings={"rate_hz": rate_hz, "scale": assumed, "autopilot": autopilot, "forward": str(forward)},
    )


def _cut_values(rng: np.random.Generator) -> Attack:
    """Cut the torque, not rounded, to steps of 0.2 to 2 % of the full command."""
    step = log_uniform(rng, 0.002, 0.02)
    return Attack(
        scenario=_scenario(rng, {}), change=partial(with_cut_torque, step=step), settings={"size": step}
    )


def _limit_cycle(rng: np.random.Generator) -> Attack:
    """Let one axis oscillate at its limits beside axes that are flown well."""
    axis = int(rng.integers(3))
    gain = [1.0, 1.0, 1.0]
    gain[axis] = rng.uniform(4.0, 9.0)
    scenario = _scenario(rng, {}, tuning=Tuning(axis_gain=(gain[0], gain[1], gain[2])))
    return Attack(scenario=scenario, settings={"axis": AXES[axis], "gain": gain[axis]})


def _mixture(rng: np.random.Generator) -> Attack:
    """Put small effects together, in air as rough as flown."""
    effects = {
        "dead_zone": rng.uniform(0.0, 0.004),
        "spin_down_ratio": rng.uniform(2.0, 3.0),
        "flexible_mode_hz": rng.uniform(4.0, 12.0),
        "flexible_mode_gain": rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 0.15),
        "disturbance_rad_s2": tuple((rng.uniform(0.7, 1.3) * FLOWN_DISTURBANCE_RAD_S2).tolist()),
    }
    left_out = str(rng.choice(["dead_zone", "spin_down_ratio", "flexible_mode_hz", "none"]))
    effects.pop(left_out, None)
    return Attack(scenario=_scenario(rng, effects), settings={"without": left_out})


def _two_packs(rng: np.random.Generator) -> Attack:
    """Give the second flight of a log 8 % more or less thrust."""
    first = _scenario(rng, {})
    factor = float(rng.choice([0.92, 1.08]))
    frame = first.airframe()
    other = dataclasses.replace(frame, max_thrust_n=frame.max_thrust_n * factor)
    second = dataclasses.replace(first, airframe=lambda: other)
    return Attack(
        scenario=first, second=second, factors=((1.0,) * 3, (factor,) * 3), settings={"factor": factor}
    )


def _weak_motor(rng: np.random.Generator) -> Attack:
    """Let a motor give 80 % from the middle of the flight on."""
    scenario = _scenario(rng, {"motor_fault": 1, "motor_effectiveness": 0.8}, quad=True)
    # Each of four rotors has a quarter of every torque.
    return Attack(scenario=scenario, factors=((1.0,) * 3, (0.95,) * 3))


def _outages(rng: np.random.Generator) -> Attack:
    """Lose 44 ms of every 0.9 s."""
    return Attack(scenario=_scenario(rng, {}), autopilot="px4", change=with_outages)


def _gusty_sticks(rng: np.random.Generator) -> Attack:
    """Fly by sticks in air as rough as flown, logged by Betaflight with its set-points."""
    air = tuple((rng.uniform(0.7, 1.3) * FLOWN_DISTURBANCE_RAD_S2).tolist())
    scenario = _scenario(rng, {"disturbance_rad_s2": air}, quad=True, manoeuvre=manoeuvres.sticks)
    return Attack(scenario=scenario, autopilot="betaflight")


ATTACKS: Final[dict[str, Callable[[np.random.Generator], Attack]]] = {
    "rotor dead zone": _rotor_dead_zone,
    "circular torque": _circular,
    "cut values": _cut_values,
    "limit cycle beside good axes": _limit_cycle,
    "two small effects, rough air": _mixture,
    "two packs 8 % apart": _two_packs,
    "motor at 80 % from mid-flight": _weak_motor,
    "outages of 44 ms": _outages,
    "sticks in rough air, Betaflight": _gusty_sticks,
}


def with_computed_torque(log: FlightLog, *, scale: float, forward: bool) -> FlightLog:
    """Return the log with torques that were computed from the rates, as the only torque that it has."""
    rate = log.signals["body_rate"][0]
    step_s = float(np.median(np.diff(rate.rows.time_s)))
    slope = (
        np.diff(rate.values, axis=0, append=rate.values[-1:]) if forward else np.gradient(rate.values, axis=0)
    )
    given = log.signals["torque_command"][0]
    size = np.std(given.values, axis=0) / np.std(slope / step_s, axis=0) * scale
    torque = dataclasses.replace(given, rows=rate.rows, values=slope / step_s * size)
    signals = {
        name: each
        for name, each in log.signals.items()
        if name not in ("motor_thrust", "rotor_speed", "output_pwm", "unallocated_torque", "torque_command")
    }
    return dataclasses.replace(log, signals=signals | {"torque_command": (torque,)})


def with_cut_torque(log: FlightLog, *, step: float) -> FlightLog:
    """Return the log with each torque cut towards zero to a multiple of the step."""
    given = log.signals["torque_command"][0]
    torque = dataclasses.replace(given, values=np.trunc(given.values / step) * step)
    signals = {
        name: each
        for name, each in log.signals.items()
        if name not in ("motor_thrust", "rotor_speed", "output_pwm")
    }
    return dataclasses.replace(log, signals=signals | {"torque_command": (torque,)})


def with_outages(log: FlightLog, every_s: float = 0.9, lost_s: float = 0.044) -> FlightLog:
    """Return the log without the rows of each outage; what is told once, as that motors are armed, stays."""
    signals = {}
    for name, each in log.signals.items():
        kept = []
        for signal in each:
            if signal.rows.time_s.size < log.signals["body_rate"][0].rows.time_s.size // 20:
                kept.append(signal)
                continue
            keep = np.mod(signal.rows.time_s, every_s) >= lost_s
            rows = dataclasses.replace(
                signal.rows, time_s=signal.rows.time_s[keep], position=signal.rows.position[keep]
            )
            kept.append(dataclasses.replace(signal, rows=rows, values=signal.values[keep]))
        signals[name] = tuple(kept)
    return dataclasses.replace(log, signals=signals)


def flown(attack: Attack, seed: int) -> tuple[FlightLog, np.ndarray]:
    """Return the log, and the true effectiveness of each axis in each of its parts, (n_parts, 3)."""
    setups: list[Setup] = []
    for number, scenario in enumerate((attack.scenario, attack.second)):
        if scenario is not None:
            setups += plan_flights(
                scenario,
                seed=seed + number,
                duration_s=scenario.duration_s,
                rate_hz=scenario.logging.rate_hz,
                autopilot=attack.autopilot,
            )
    records = tuple(fly(setup) for setup in setups)
    scenario = attack.scenario
    truth = flight_truth(records[:1], scenario=scenario.name, boot_s=scenario.logging.boot_s)
    log = per_command(log_flights(records, scenario.logging))
    log = attack.change(log) if attack.change else log
    return log, np.diagonal(truth["models"]["damped"]["B"])[np.newaxis, :3] * np.array(attack.factors)


def judged(name: str, number: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each axis of one flight of an attack."""
    rng = np.random.default_rng([seed, number, *name.encode()])
    attack = ATTACKS[name](rng)
    log, gains = flown(attack, 1000 * seed + number)
    prepared = prepare(log)
    data = cut(prepared, Settings().align)
    rotors = faults_of(prepared, data).rotors
    identification = with_lost_thrust(identify(data, Settings().identify), rotors)
    diagnosis = diagnose(prepared.log, data, identification, rotors=rotors)
    model = identification.recommended
    findings = sorted({found.code for found in diagnosis.findings})
    for axis in AXES:
        verdict = diagnosis.axes[axis]
        row: dict[str, Any] = {"attack": name, "number": number, "axis": axis, "verdict": verdict.verdict}
        row |= {"reasons": list(verdict.reasons), "findings": findings, **attack.settings}
        row |= {"gust": attack.scenario.effects.disturbance_rad_s2[0]}
        if model is not None and ON_AXIS[axis] in model.entries:
            entry, true = model.entries[ON_AXIS[axis]], gains[:, AXES.index(axis)]
            low, high = entry.ci95
            half = 0.5 * (high - low)
            miss = float(np.max(np.abs(true - 0.5 * (low + high)))) / half if math.isfinite(half) else 0.0
            row |= {
                "error": entry.value / float(true[0]) - 1.0,
                "half_width": half / entry.value,
                "miss": miss,
            }
        yield row


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return verdicts and errors by attack as Markdown."""
    lines = [
        "| attack | axes | usable | caution | refused | usable, true value outside "
        "| usable, beyond 1.5 half-widths | caution, true value outside "
        "| usable, largest error [half-widths] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in ATTACKS:
        mine = [row for row in rows if row["attack"] == name]
        usable, caution = ([r for r in mine if r["verdict"] == each] for each in ("usable", "caution"))
        misses, n_refused = [row["miss"] for row in usable], len(mine) - len(usable) - len(caution)
        lines.append(
            f"| {name} | {len(mine)} | {len(usable)} | {len(caution)} | {n_refused} "
            f"| {sum(miss > 1.0 for miss in misses)} | {sum(miss > _WRONG for miss in misses)} "
            f"| {sum(row['miss'] > 1.0 for row in caution)} | {max(misses, default=0.0):.2f} |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Fly, print a row for each axis, and the table."""
    parser = argparse.ArgumentParser(prog="python study/attacks.py", description=__doc__)
    parser.add_argument("--flights", type=int, default=16, help="of each attack (default 16)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--attacks", nargs="*", choices=list(ATTACKS), default=list(ATTACKS))
    parser.add_argument("--publish", action="store_true", help=f"write {TABLE.relative_to(ROOT)}")
    options = parser.parse_args(arguments)
    rows = []
    for name in options.attacks:
        for number in range(options.flights):
            for row in judged(name, number, options.seed):
                rows.append(row)
                print(json.dumps(row), flush=True)
    print(table(rows))
    if options.publish:
        TABLE.write_text(f"{options.flights} flights of each attack, seed {options.seed}.\n\n{table(rows)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
