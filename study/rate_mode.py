"""What `tune` recommends where no angle loop is known: `python study/run.py --rate-mode`.

Vehicles drawn at random are flown once and tuned as if they flew in rate mode: the angle gain is taken out of
their logs. The gains of the next flight are held against the true rate loop: its margins, how much its answer
to set-points resonates, and what gusts make of the attitude, over the flown gains.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any, Final

import numpy as np

from quadid_logs.autopilots import named
from quadid_logs.control.loop import close
from quadid_logs.control.scaled_loop import scaled_loops, spare
from quadid_logs.data.closed_loop import Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD
from quadid_logs.pipeline import _closed_loop
from quadid_logs.simulate import fly
from quadid_logs.simulate.effects import disturbance_density
from quadid_logs.simulate.true_loop import true_plant
from quadid_logs.simulate.wind import Wind
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from study.tuning import (
    analyzed,
    draw_vehicle,
    fly_missing,
    flyable,
    of_each_gain,
    read,
    resting_truth,
    setup_of,
)

#: Light wind [rad/s^2].
_GUSTS: Final = 0.5
_FREQUENCY_HZ: Final = np.geomspace(0.05, 60.0, 500)


def measure_vehicle(seed: int, number: int) -> dict[str, Any]:
    """Fly and tune one vehicle, and hold its next gains against its true rate loop.

    Parameters
    ----------
    seed, number : int

    Returns
    -------
    dict
        By axis, ready for JSON.
    """
    drawn, autopilot, settings = draw_vehicle(seed, number)
    effects = dataclasses.replace(drawn.effects, disturbance_rad_s2=(_GUSTS, _GUSTS, 0.5 * _GUSTS))
    scenario = dataclasses.replace(drawn, wind=Wind(), effects=effects)
    factors = of_each_gain(flyable(scenario, autopilot, np.random.default_rng([seed, number, *b"detuning"])))
    setup = setup_of(scenario, autopilot, factors, 1000 * seed + 10 * number)
    result = without_angle_loop(analyzed(fly(setup), scenario))
    tuning = recommend(result, GOOD, AXES[:2])
    axes: dict[str, dict[str, Any]] = {}
    for place, axis in enumerate(AXES[:2]):
        found = tuning.axes[axis]
        axes[axis] = {"verdict": found.verdict, "reasons": [one.code for one in found.reasons]}
        if found.verdict != "change":
            continue
        plant = true_plant(setup, resting_truth(setup), place)
        parameters = result.log.parameters
        following = {**parameters, **{name: one.next for name, one in found.changes.items()}}
        for name, gains in (("flown", parameters), ("next", following)):
            controllers = named(autopilot).controllers(result.log, gains)
            assert controllers is not None
            axes[axis][name] = _true(controllers.axes[axis], plant)
        axes[axis]["told_error"] = found.attitude_error
    return {"number": number, "seed": seed, **settings, "axes": axes}


def without_angle_loop(result: Result) -> Result:
    """Return what an analysis finds of the same flight in a log that does not hold the angle gains.

    Parameters
    ----------
    result : Result

    Returns
    -------
    Result
    """
    tunable = named(result.log.autopilot).tunable(result.log.parameters)
    assert tunable is not None
    angle = {names.angle for names in tunable.axes.values()}
    kept = {name: value for name, value in result.log.parameters.items() if name not in angle}
    log = dataclasses.replace(result.log, parameters=kept)
    loop = _closed_loop(log, result.data, result.identification, result.diagnosis, result.settings)
    return dataclasses.replace(result, log=log, closed_loop=loop)


def _true(controller: AxisController, plant: Plant) -> dict[str, float]:
    """Return the worst margin over its limit, the resonance [dB], and the attitude error of unit gusts."""
    loop = close(controller, plant, _FREQUENCY_HZ)
    s = 2j * np.pi * _FREQUENCY_HZ
    answer = np.abs(1.0 / (s * (s - plant.damping[0]) * (1.0 + loop.rate[0]))) ** 2
    gusts = disturbance_density(_FREQUENCY_HZ)
    return {
        "spare": spare(scaled_loops(controller, plant, np.inf).margins(), GOOD),
        "resonance_db": float(20.0 * np.log10(np.abs(loop.target_to_rate).max())),
        "error_rad": float(np.sqrt(np.trapezoid(answer * gusts, _FREQUENCY_HZ))),
    }


def summarise(vehicles: list[dict[str, Any]]) -> str:
    """Return the table of the study.

    Parameters
    ----------
    vehicles : list of dict
        As of `measure_vehicle`.

    Returns
    -------
    str
        Markdown.
    """
    failed = sum("error" in one for one in vehicles)
    axes = [axis for one in vehicles if "error" not in one for axis in one["axes"].values()]
    changed = [one for one in axes if one["verdict"] == "change"]
    seeds = ", ".join(sorted({str(one["seed"]) for one in vehicles}))
    lines = [
        f"{len(vehicles)} vehicles (seed {seeds}), gusts of {_GUSTS:g} rad/s², roll and pitch, one flight, "
        f"{failed} failed: {len(changed)} of {len(axes)} axes are told other gains.",
        "",
        "| true rate loop | flown: median (least, most) | next gains |",
        "|---|---|---|",
    ]
    for name, title in (("spare", "worst margin over its limit"), ("resonance_db", "resonance [dB]")):
        cells = [_spread([one[when][name] for one in changed]) for when in ("flown", "next")]
        lines.append(f"| {title} | {' | '.join(cells)} |")
    ratio = [one["next"]["error_rad"] / one["flown"]["error_rad"] for one in changed]
    lines.append(f"| attitude error in gusts, over the flown gains | 1 | {_spread(ratio)} |")
    kept = sum(one["next"]["spare"] >= min(1.0, one["flown"]["spare"]) for one in changed)
    lines += ["", f"The limits, or what flew of them, are kept by {kept} of {len(changed)}."]
    return "\n".join(lines) + "\n"


def _spread(values: list[float]) -> str:
    return f"{np.median(values):.2f} ({min(values):.2f}, {max(values):.2f})"


def main(arguments: list[str] | None = None) -> int:
    """Fly what is missing of the study, then print and write its table."""
    from study.run import ROOT

    parser = argparse.ArgumentParser(description="Tune rate loops, and hold them against the true ones.")
    parser.add_argument("--vehicles", type=int, default=20, help="how many (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="another seed draws other vehicles (default 1)")
    parser.add_argument("--processes", type=int, default=1, help="vehicles at the same time (default 1)")
    parser.add_argument(
        "--output", type=Path, default=ROOT / "build" / "rate_mode", help="default build/rate_mode"
    )
    parser.add_argument("--publish", action="store_true", help="write docs/tuning/rate_mode.md")
    options = parser.parse_args(arguments)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / f"seed-{options.seed}.jsonl"
    fly_missing(path, options.seed, options.vehicles, options.processes, measure_vehicle)
    text = summarise([one for each in sorted(options.output.glob("seed-*.jsonl")) for one in read(each)])
    if options.publish:
        (ROOT / "docs" / "tuning" / "rate_mode.md").write_text(text, encoding="utf-8")
    print(text)
    return 0
