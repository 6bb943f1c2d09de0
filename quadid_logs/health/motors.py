"""What the motors were sent: balance, headroom, limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from quadid_logs.align.series import CleanSeries, Interval
from quadid_logs.arrays import FloatArray
from quadid_logs.data.catalogue import MOST_SATURATED
from quadid_logs.data.health import Level, Motors, Quantity
from quadid_logs.data.torque import TorqueModel
from quadid_logs.health.records import averaged, in_flight
from quadid_logs.numerals import beside, number

#: A published log analyzer warns where the highest motor's mean lies more than 75 us above the lowest one's,
#: and fails above 150 us (source: docs/health.md).
_WARN_US, _FAIL_US = 75.0, 150.0
#: Beside what is normal, less than this fraction of it is no difference that a pilot can do anything about.
_ALIKE: Final = 0.1
#: Pulses go from 1000 to 2000 us: the same as a fraction of the range.
_RANGE_US: Final = 1000.0
#: Rounding of outputs at an end of their range; the steps of a pulse are a thousandth.
_AT_END: Final = 2e-3
_FEWEST: Final = 20
_RARELY: Final = 0.01
#: With one rotor of a way, its own weakness is not told from a yaw torque.
_FEWEST_OF_A_WAY: Final = 2
#: A motor within this fraction of the longest arm of an axis lies on it.
_ON_AXIS: Final = 0.2


def find_motors(
    outputs: CleanSeries, torque: TorqueModel | None, intervals: Sequence[Interval]
) -> Motors | None:
    """Compare the motors with each other and with the ends of their range.

    Parameters
    ----------
    outputs : CleanSeries
        ``motor_thrust`` in the order of the motors, or ``output_pwm`` by channel.
    torque : TorqueModel or None
        What is known of the rotors.
    intervals : sequence of (start_s, end_s)
        Of flight.

    Returns
    -------
    Motors or None
        None where it is not known which outputs drive motors, or none was logged in flight.
    """
    n_rotors = 0 if torque is None else torque.n_rotors
    record = in_flight(outputs, intervals)
    values = record.values
    pulses = outputs.name == "output_pwm"
    if pulses:
        channels = () if torque is None else torque.channels
        if not channels or max(channels) > values.shape[1]:
            return None
        values = values[:, [channel - 1 for channel in channels]]
    elif n_rotors and values.shape[1] >= n_rotors:
        values = values[:, :n_rotors]
    if len(values) < _FEWEST or values.shape[1] < 2:
        return None
    good = np.isfinite(values).all(axis=1)
    values = values[good]
    if len(values) < _FEWEST or not values.std(axis=0).all():
        return None
    # What is published counts in microseconds, of the outputs as they were sent.
    as_sent = values.mean(axis=0)
    spread = Quantity(float(np.ptp(as_sent)), "us" if pulses else "1", normal=(0.0, _WARN_US))
    if not pulses:
        spread = spread._replace(normal=(0.0, _WARN_US / _RANGE_US))
    spread_us = spread.value * (1.0 if pulses else _RANGE_US)
    level: Level = "normal" if spread_us <= _WARN_US else "high" if spread_us <= _FAIL_US else "severe"
    limits = None if torque is None else torque.output_range_us
    known = not pulses or limits is not None
    if pulses and limits is not None:
        values = (values - limits[0]) / (limits[1] - limits[0])
    mean = values.mean(axis=0)
    names = motor_names(torque, values.shape[1])
    against_yaw = _against_yaw(torque, as_sent, pulses=pulses)
    highest = values.max(axis=1)
    headroom = Quantity(1.0 - float(np.percentile(highest, 100.0 * (1.0 - _RARELY))), "1") if known else None
    at_high = None
    if known:
        at_high = Quantity(float(np.mean(highest >= 1.0 - _AT_END)), "1", normal=(0.0, MOST_SATURATED))
    at_low = Quantity(float(np.mean(values.min(axis=1) <= _AT_END)), "1") if known else None
    short = averaged(record._replace(time_s=record.time_s[good], values=values))
    lacks_power = at_high is not None and at_high.value > MOST_SATURATED
    if at_low is None or at_low.value <= _RARELY:
        idle = ""
    else:
        idle = (
            f" A motor is at its lower limit in {number(100.0 * at_low.value, 2)} % of the flight, and "
            "cannot give less there."
        )
    hardest, least = names[int(np.argmax(mean))], names[int(np.argmin(mean))]
    pulses = spread.unit == "us"
    percent = 100.0 * _WARN_US / _RANGE_US
    if pulses:
        apart, limit = f"{beside(spread.value, _WARN_US, 0)} µs", f"{_WARN_US:g} µs"
    else:
        apart, limit = f"{beside(100.0 * spread.value, percent, 1)} % of its range", f"{percent:g} %"
    judged = {
        "normal": f"which is normal (below {limit})",
        "high": f"more than the normal {limit}",
        "severe": f"more than twice the normal {limit}",
    }[level]
    told = f"{hardest.capitalize()} works hardest, {apart} above {least}, {judged}."
    if spread.value < (_WARN_US if pulses else _WARN_US / _RANGE_US) * _ALIKE:
        told = "All motors work alike."
    if not (at_high is None or headroom is None):
        if at_high.value > 0.0:
            judged = f", more than the normal {100.0 * MOST_SATURATED:.0f} %"
            most = judged if at_high.value > MOST_SATURATED else ""
            share = number(100.0 * at_high.value, 2)
            told = f"{told} A motor is at its upper limit in {share} % of the flight{most}."
        else:
            told = (
                f"{told} In 99 % of the flight at least {100.0 * headroom.value:.0f} % of the range is in "
                "reserve."
            )
    return Motors(
        sentence=told + idle + against_yaw,
        level="high" if lacks_power and level == "normal" else level,
        names=names,
        unit="1" if known else "us",
        mean=mean,
        low=np.asarray(np.percentile(values, 5.0, axis=0)),
        high=np.asarray(np.percentile(values, 95.0, axis=0)),
        spread=spread,
        hardest=int(np.argmax(mean)),
        headroom=headroom,
        at_high=at_high,
        at_low=at_low,
        time_s=short.time_s,
        output=short.values,
    )


def motor_names(torque: TorqueModel | None, n_motors: int) -> tuple[str, ...]:
    """Return each motor's number and its place.

    "motor 1 (front right)" and the like.
    """
    if torque is None or torque.n_rotors != n_motors or torque.position.shape[0] != n_motors:
        return tuple(f"motor {n + 1}" for n in range(n_motors))
    # FRD, the longest arm 1.
    reach, names = float(np.abs(torque.position[:, :2]).max()) or 1.0, []
    for n, (x, y, _) in enumerate((torque.position / reach).tolist()):
        along = "" if abs(x) < _ON_AXIS else ("front" if x > 0.0 else "back")
        across = "" if abs(y) < _ON_AXIS else ("right" if y > 0.0 else "left")
        names.append(f"motor {n + 1} ({' '.join(filter(None, (along, across))) or 'middle'})")
    return tuple(names)


def _against_yaw(torque: TorqueModel | None, as_sent: FloatArray, *, pulses: bool) -> str:
    """Say that all rotors that turn one way work harder than all others, by more than is normal of any two.

    Neither a load that was moved nor one weak rotor does that.
    """
    if torque is None or torque.n_rotors != as_sent.size:
        return ""
    ways = {
        "counter-clockwise": as_sent[torque.spin > 0.0],
        "clockwise": as_sent[torque.spin < 0.0],
    }
    if min(outputs.size for outputs in ways.values()) < _FEWEST_OF_A_WAY:
        return ""
    harder = max(ways, key=lambda way: float(ways[way].mean()))
    less = max(float(outputs.max()) for way, outputs in ways.items() if way != harder)
    apart = float(ways[harder].min()) - less
    if apart <= (_WARN_US if pulses else _WARN_US / _RANGE_US):
        return ""
    told = f"{apart:.0f} µs" if pulses else f"{100.0 * apart:.0f} % of the range"
    return (
        f" All motors that turn {harder} work at least {told} harder than the others, against a yaw torque. "
        "Check that no motor and no arm is twisted."
    )
