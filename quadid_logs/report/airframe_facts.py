"""Airframe, motor map, saturation and calibration in words: for the report and for ``info``."""

from __future__ import annotations

import math

from quadid_logs.data.log import FlightLog
from quadid_logs.data.torque import TorqueModel
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.report.numbers import number, percent
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, TORQUE_SYMBOLS


def airframe_facts(log: FlightLog) -> list[tuple[str, str]]:
    """Return name and value of what is known of the airframe; empty where nobody looked.

    Examples
    --------
    >>> airframe_facts(FlightLog(path="", format="table", autopilot="other", n_bytes=0, signals={}))
    []
    """
    model = log.torque
    # Who logs a rover or a plane is not helped by how to describe its rotors.
    if model is None or not (model.n_rotors or log.may_be_multirotor):
        return []
    # Say what the frame is and what says so, or what to pass.
    if not model.n_rotors:
        frame = f"unknown; {_needs(model)}" if model.needs else "not known"
    else:
        frame = (
            f"{printable(model.frame, 60)}, {model.n_rotors} motors ({printable(model.frame_source, 120)})"
        )
    facts = [("Airframe", frame)]
    if model.n_rotors:
        unit = "m" if model.position_unit == "m" else "arms"
        spin = {1.0: "ccw", -1.0: "cw", 0.0: "?"}
        each = []
        for number_of in range(model.n_rotors):
            forward, right = (f"{float(value):+.2f}" for value in model.position[number_of, :2])
            output = f" out {model.channels[number_of]}" if model.channels else ""
            each.append(f"{number_of + 1}:{output} ({forward}, {right}) {spin[float(model.spin[number_of])]}")
        source = f"; outputs by {printable(model.channel_source, 80)}" if model.channel_source else ""
        placed = f"{', '.join(each)} [{unit} to front, right]{source}"
        facts.append(("Motors", placed))
        known = model.calibration
        parts = []
        if known.route:
            per = [
                f"{symbol} {number(value)} (±{percent(NORMAL_95 * sigma)})"
                for symbol, value, sigma in zip(
                    TORQUE_SYMBOLS, known.n_m_per_command, known.relative_sigma, strict=True
                )
                if math.isfinite(value)
            ]
            parts.append(
                f"by {printable(known.route, 80)}: N m per unit of command {', '.join(per) or 'unknown'}"
            )
            parts.append(f"largest thrust of a rotor {number(known.max_thrust_n, 3)} N")
        if math.isfinite(known.second_opinion):
            parts.append(f"the second-best method gives {number(known.second_opinion, 3)} times that thrust")
        if model.needs:
            parts.append(_needs(model))
        facts.append(("Scale", "; ".join(parts) or "not calibrated"))
    if model.check is not None:
        facts.append(
            (
                "Mixer",
                f"recomputed pulse widths differ from the logged ones by {model.check.mean_us:.2f} µs on "
                f"average, {model.check.std_us:.2f} µs rms ({model.check.n_samples} unsaturated rows; air "
                f"density: {printable(model.check.density, 60)})",
            )
        )
    # Say how often each axis got less than was commanded, "" where that is not known.
    fractions = zip(AXES, model.saturated_fraction, strict=True)
    saturation = ", ".join(
        f"{axis} {percent(fraction)} of the flight" for axis, fraction in fractions if math.isfinite(fraction)
    )
    if saturation:
        facts.append(("Limited", saturation))
    if model.rotor_speed:
        facts.append(("Rotor rpm", printable(model.rotor_speed, 160)))
    remarks = [printable(remark, 400) for remark in model.remarks]
    return facts + [("Remark", remark) for remark in dict.fromkeys(remarks)]


def _needs(model: TorqueModel) -> str:
    return f"give with --vehicle: {', '.join(printable(need, 120) for need in model.needs)}"
