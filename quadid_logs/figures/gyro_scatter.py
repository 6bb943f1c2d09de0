"""The figure of body rates against attitude."""

from __future__ import annotations

import numpy as np

from quadid_logs.data.result import Result
from quadid_logs.figures.spec import Axis, Curve, Figure, LeftOut, Panel
from quadid_logs.numerals import plus_minus
from quadid_logs.vocabulary import AXES

#: Half the delay of a typical gyro filter: a lag known no better is none of interest.
_VAGUE_MS = 5.0


def gyro_against_attitude(result: Result) -> Figure | LeftOut:
    """Show for each angle how much it changed by the attitude, over what the body rates add up to."""
    title = "Gyro against attitude"
    check = result.data.gyro_check
    if check is None:
        reason = "Body rates and attitude were not logged together for long enough."
        return LeftOut(key="gyro", title=title, reason=reason)
    panels = []
    for number, axis in enumerate(AXES):
        by_rates = np.degrees(check.integrated_change[:, number])
        by_attitude = np.degrees(check.attitude_change[:, number])
        ends = np.array([min(by_rates.min(), by_attitude.min()), max(by_rates.max(), by_attitude.max())])
        panels.append(
            Panel(
                title=f"{axis.capitalize()} angle",
                x=Axis(label="by the body rates", unit="deg"),
                y=Axis(label="by the attitude", unit="deg"),
                curves=(
                    Curve(label="agreement", x=ends, y=ends, role="muted", mark="dashed"),
                    Curve(label=f"{axis}, per interval", x=by_rates, y=by_attitude, role=axis, mark="points"),
                ),
            )
        )
    # How the two lie in time, where the flight tells it
    lag_ms, half_width_ms = 1e3 * check.lag_s, 1e3 * check.lag_half_width_s
    if half_width_ms > _VAGUE_MS:
        lag = ""
    elif abs(lag_ms) < 1.0:
        lag = "Both are logged at the same time."
    else:
        order = "after" if lag_ms > 0.0 else "before"
        cause = ": the filter of the gyro delays them" if lag_ms > 0.0 else ""
        known_ms = max(half_width_ms, 0.1)
        lag = f"The rates come {plus_minus(abs(lag_ms), known_ms)} ms {order} the attitude{cause}."
    caption = (
        f"Change of each angle over {check.start_s.size} intervals of {check.length_s:g} s: by the body "
        "rates and by the attitude. If the points lie on the dashed line, units, signs and axes of the log "
        "are right. A round cloud shows nothing: the axis hardly turned, or the rates were logged too "
        f"slowly to add them up. {lag}"
    )
    return Figure(key="gyro", title=title, caption=caption, panels=tuple(panels), columns=3)
