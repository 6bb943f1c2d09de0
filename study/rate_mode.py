"""What `tune` recommends where no angle loop is known: `python study/run.py --rate-mode`.

Vehicles drawn at random are flown once and tuned as if they flew in rate mode: the angle gain is taken out of
their logs. The gains of the next flight are held against the true rate loop: its margins, how much its answer
to set-points resonates, and what gusts make of the attitude, over the flown gains.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np

from quadid_logs.autopilots import named
from quadid_logs.control.loop import close
from quadid_logs.data.controller import AxisController
from quadid_logs.data.result import Result
from quadid_logs.data.tuning import GOOD
from quadid_logs.pipeline import _closed_loop
from quadid_logs.simulator import fly
from quadid_logs.tuning import recommend
from quadid_logs.vocabulary import AXES
from study.optimum import Judge, draw_in_gusts, judge_of
from study.tuning import analyzed, run_study, setup_of

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
    scenario, autopilot, settings, factors = draw_in_gusts(seed, number, _GUSTS)
    setup = setup_of(scenario, autopilot, factors, 1000 * seed + 10 * number)
    flown = analyzed(fly(setup), scenario)
    result = without_angle_loop(flown)
    tuning = recommend(result, GOOD, AXES[:2])
    axes: dict[str, dict[str, Any]] = {}
    for place, axis in enumerate(AXES[:2]):
        found = tuning.axes[axis]
        axes[axis] = {"verdict": found.verdict, "reasons": [one.code for one in found.reasons]}
        if found.verdict != "change":
            continue
        judge = judge_of(setup, flown.log.parameters, place)
        parameters = result.log.parameters
        following = {**parameters, **{name: one.next for name, one in found.changes.items()}}
        for name, gains in (("flown", parameters), ("next", following)):
            controllers = named(autopilot).controllers(result.log, gains)
            assert controllers is not None
            axes[axis][name] = _true(controllers.axes[axis], judge)
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


def _true(controller: AxisController, judge: Judge) -> dict[str, float]:
    """Return the worst margin over its limit, the resonance [dB], and the attitude error in the gusts."""
    loop = close(controller, judge.plant, _FREQUENCY_HZ)
    return {
        "spare": judge.spare(controller),
        "resonance_db": float(20.0 * np.log10(np.abs(loop.target_to_rate).max())),
        "error_rad": judge.error_rad(controller),
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
        f"{failed} failed: {len(changed)} of {len(axes)} axes get other gains.",
        "",
        "| true rate loop | flown gains: median (smallest, largest) | next gains |",
        "|---|---|---|",
    ]
    for name, title in (("spare", "smallest margin over its limit"), ("resonance_db", "resonance [dB]")):
        cells = [_spread([one[when][name] for one in changed]) for when in ("flown", "next")]
        lines.append(f"| {title} | {' | '.join(cells)} |")
    ratio = [one["next"]["error_rad"] / one["flown"]["error_rad"] for one in changed]
    lines.append(f"| attitude error by gusts, relative to flown gains | 1 | {_spread(ratio)} |")
    kept = sum(one["next"]["spare"] >= min(1.0, one["flown"]["spare"]) for one in changed)
    lines += [
        "",
        "True margins meet the limits, or are no further below them than before, "
        f"on {kept} of {len(changed)} axes.",
    ]
    return "\n".join(lines) + "\n"


def _spread(values: list[float]) -> str:
    return f"{np.median(values):.2f} ({min(values):.2f}, {max(values):.2f})"


def main(arguments: list[str] | None = None) -> int:
    """Fly what is missing of the study, then print and write its table."""
    return run_study(
        arguments,
        "Tune rate loops, and hold them against the true ones.",
        (20, 1),
        "rate_mode",
        (measure_vehicle, summarise),
    )
