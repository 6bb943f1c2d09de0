"""The confirming flight of recommended gains: what to set, to fly and to expect, and its parameter files."""

from __future__ import annotations

from collections.abc import Iterator

from quadid_logs.data.result import Result
from quadid_logs.data.tuning import Tuning
from quadid_logs.diagnose.advice import advice_for, plannable
from quadid_logs.planning import Plan, make_plan
from quadid_logs.report.gain_files import file_names
from quadid_logs.report.plan import CARD_FILE, parameter_files, settings_lines
from quadid_logs.report.tune_view import tune_again, tune_view, way_back


def flight_files(result: Result, tuning: Tuning) -> dict[str, str]:
    """Return the text of each file by its name: the card, and what makes the autopilot log and sweep.

    Empty where no gain changes.
    """
    changing = [axis for axis, found in tuning.axes.items() if found.verdict == "change"]
    if not changing:
        return {}
    planned = None
    if result.log.autopilot in plannable():
        log = result.log
        planned = make_plan(log.autopilot, changing, log.version, log.parameters, known=result)
    card = "\n".join(_card(result, tuning, changing, planned)) + "\n"
    return {CARD_FILE: card, **({} if planned is None else parameter_files(planned))}


def _card(result: Result, tuning: Tuning, axes: list[str], planned: Plan | None) -> Iterator[str]:
    """Yield the card as Markdown that reads well as plain text."""
    view, autopilot = tune_view(result, tuning), result.log.autopilot
    forth, _ = file_names(autopilot)
    yield from (f"# Confirming flight: {', '.join(axes)}", "", "## Set", "", f"- load {forth}")
    for axis in view.axes:
        yield from (f"  - {one.name} {one.now} -> {one.next}" for one in axis.gains)
    if planned is not None:
        yield from settings_lines(planned)
    else:
        # What to log with an autopilot whose settings are no numbers
        advice = advice_for(result.log.autopilot)
        if advice.before_setting:
            yield f"- {advice.before_setting}"
        yield f"- {advice.logging(result.log.format, result.log.parameters, result.log.version)}"
    yield from ("", "## Fly", "")
    steps = (
        "Choose calm air, a full battery, and 10 m of free space on all sides.",
        "Hover at 3 m for 20 s with small stick inputs. If the vehicle shakes or the motors buzz, land at "
        "once. Otherwise land after the 20 s.",
        *(
            (advice_for(result.log.autopilot).excitation(axes, result.log.version),)
            if planned is None
            else planned.steps()
        ),
        f"Take the log from the card, and run `{tune_again(result, tuning)}` on it. "
        f"{way_back(autopilot, tuning).sentence}",
    )
    yield from (f"{place}. {step}" for place, step in enumerate(steps, start=1))
    yield from ("", "## Expect", "")
    for axis in view.axes:
        if axis.gains:
            yield f"- {axis.axis}: {axis.promise} {axis.warning}"
