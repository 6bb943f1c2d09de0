"""Caveats about how torque follows from the outputs, and about the inertia that it leads to."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from quadid_logs.actuation.calibration import MASS_SIGMA
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification, Inertia, ThrustCurve
from quadid_logs.data.torque import Calibration, TorqueComparison, TorqueModel
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.maths.student import student_95
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2, ON_AXIS

#: Limited this often, effectiveness per command is lower than that per achieved torque by some percent.
_OFTEN_LIMITED = 0.01
#: Moments of inertia over mass times arm squared. All mass at the tips of a cross gives 0.5 about x and y
#: and 1 about z; the known vehicles lie at 0.06 to 0.4.
_INERTIA_RATIO = ((0.01, 0.6), (0.01, 0.6), (0.02, 1.1))
#: What is left of climbs in the mean of one block scatters between them; a flight of 4 s holds three [s].
_WEIGHT_BLOCK_S = 1.0

#: What to do where validation data do not tell which of two sources is right, or tell for rotor speeds.
_STRONGER = (
    "Fly stronger doublets on this axis: validation data do not show which of the two sources is right."
)
_CHECK_COMMANDS = (
    "Check the motor order and the battery compensation: the motor commands predict the flight worse than "
    "the rotor speeds."
)


def find_in_torque(log: FlightLog, data: FlightData, identification: Identification) -> Iterator[Finding]:
    """Yield the findings about airframe, mixer, saturation and calibration.

    Parameters
    ----------
    log : FlightLog
    data : FlightData
    identification : Identification

    Yields
    ------
    Finding
    """
    model = log.torque
    if model is None or data.input is None:
        return
    if not model.n_rotors and data.input.unit == "1":
        yield finding("QL309", "info", {"why": model.remarks, "pass": model.needs}, advice=_pass(model.needs))
    # Pulse widths that do not follow from the commands.
    check = model.check
    if check is not None and not check.fits and not data.input.achieved:
        yield finding(
            "QL307",
            "info",
            {
                "n_samples": check.n_samples,
                "mean_us": rounded(check.mean_us),
                "std_us": rounded(check.std_us),
                "air_density": check.density,
            },
        )
    if model.refused:
        yield finding("QL308", "info", {"why": list(model.refused)})
    if data.segments:
        yield from _saturation(model, data.input)
        yield from _sources(model.comparison)
    curve = identification.thrust_curve
    # Where no parameter holds the expo there is nothing to set; the result says what was found.
    if curve is not None and curve.corrected and curve.parameter:
        yield _other_expo(curve)
    best = identification.recommended
    if best is not None and best.inertia is not None:
        yield from _inertia(best.inertia, data.input.calibration)


def not_in_newton_metres(log: FlightLog, given: InputDescription) -> Finding:
    """Return the finding that effectiveness is per unit of command, with what would change that.

    Parameters
    ----------
    log : FlightLog
    given : InputDescription

    Returns
    -------
    Finding
        QL510.
    """
    needs = log.torque.needs if log.torque is not None else ()
    evidence: dict[str, object] = {"source": given.source}
    if any(given.calibration.known):
        evidence["n_m_per_command"] = [rounded(value) for value in given.calibration.n_m_per_command]
    return finding("QL510", "info", evidence, advice=_pass(needs))


def _pass(needs: tuple[str, ...]) -> str:
    if not needs:
        return ""
    return (
        "For torque in N m, describe the vehicle with --vehicle FILE.toml. Still missing: "
        f"{'; '.join(needs)}."
    )


def _saturation(model: TorqueModel, given: InputDescription) -> Iterator[Finding]:
    """Say which axes got less torque than was commanded."""
    often = [
        axis
        for axis, fraction in zip(AXES, model.saturated_fraction, strict=True)
        if math.isfinite(fraction) and fraction > _OFTEN_LIMITED
    ]
    if not often:
        return
    limited = {axis: rounded(each) for axis, each in zip(AXES, model.saturated_fraction, strict=True)}
    yield finding(
        "QL405",
        "info" if given.achieved else "warning",
        {"fraction_of_flight": limited, "torque": "as achieved" if given.achieved else "as commanded"},
        axes=often,
    )


def _sources(comparison: TorqueComparison | None) -> Iterator[Finding]:
    """Say that two sources of the torque disagree, and whether the flight tells which one is right."""
    if comparison is None or not comparison.differ:
        return
    axes = comparison.differ
    evidence: dict[str, object] = {
        "used": comparison.used,
        "other": comparison.other,
        "effectiveness_of_other_over_used": {
            axis: rounded(comparison.effectiveness_ratio[axis], 3) for axis in axes
        },
        "unexplained_by_used": {axis: rounded(comparison.unexplained[axis], 2) for axis in axes},
        "unexplained_by_other": {axis: rounded(comparison.unexplained_by_other[axis], 2) for axis in axes},
    }
    if not comparison.decided:
        yield finding("QL312", "warning", evidence, axes=axes, advice=_STRONGER)
        return
    advice = _CHECK_COMMANDS if comparison.takes_preferred else ""
    yield finding("QL312", "info", evidence, axes=axes, advice=advice)


def _other_expo(curve: ThrustCurve) -> Finding:
    """Return the finding that the autopilot's thrust curve is not that of the propellers."""
    evidence = {
        "expo": rounded(curve.expo, 3),
        "expo_ci95": [rounded(end, 3) for end in curve.ci95],
        "parameter": curve.parameter,
        "assumed": rounded(curve.assumed, 3),
        "effectiveness_over_flown_thrust": [rounded(float(end), 3) for end in curve.effectiveness[[0, -1]]],
    }
    wanted = min(max(curve.expo, 0.0), 1.0)
    advice = (
        f"Set {curve.parameter} from {curve.assumed:.2g} to {wanted:.2f}: the loop gain then no longer "
        "changes with throttle. The gain at hover changes too, so check the tuning with small inputs first."
    )
    return finding("QL530", "info", evidence, advice=advice)


def _inertia(inertia: Inertia, calibration: Calibration) -> Iterator[Finding]:
    """Check the tensor against what a rigid body, and a multirotor, can have."""
    moment = np.diag(inertia.matrix)
    low, high = np.diag(inertia.ci95_low), np.diag(inertia.ci95_high)
    known = np.isfinite(moment)
    wrong = {}
    block = inertia.matrix[np.ix_(known, known)]
    if block.size and np.isfinite(block).all() and not (np.linalg.eigvalsh(block) > 0.0).all():
        wrong["positive_definite"] = "no"
    if known.all():
        for axis in range(3):
            others = [other for other in range(3) if other != axis]
            if low[axis] > high[others].sum():
                wrong["triangle"] = f"I{'xyz'[axis] * 2} exceeds the sum of the other two"
    size = calibration.mass_kg * calibration.arm_length_m**2
    if math.isfinite(size) and size > 0.0:
        for axis in (int(number) for number in np.flatnonzero(known)):
            least, most = _INERTIA_RATIO[axis]
            if high[axis] / size < least or low[axis] / size > most:
                ratio = rounded(float(moment[axis]) / size)
                wrong[f"I{'xyz'[axis] * 2}_over_m_r2"] = f"{ratio}, typically {least} to {most}"
    if wrong:
        yield finding(
            "QL512", "warning", {**wrong, "moments_kg_m2": [rounded(float(value)) for value in moment]}
        )


def find_in_given_inertia(
    data: FlightData, identification: Identification, vehicle: Vehicle | None
) -> Iterator[Finding]:
    """Compare the effectiveness with the inertia in the vehicle file, where torque is in N m.

    Parameters
    ----------
    data : FlightData
    identification : Identification
    vehicle : Vehicle or None

    Yields
    ------
    Finding
        QL515.
    """
    model = identification.recommended
    if model is None or vehicle is None or vehicle.inertia_kg_m2 is None:
        return
    if data.input is None or data.input.unit != "N m":
        return
    evidence: dict[str, object] = {}
    for axis, moment in zip(AXES, np.diagonal(vehicle.inertia_kg_m2), strict=True):
        if np.isnan(moment):
            continue
        on_axis = model.entries[ON_AXIS[axis]]
        low, high = on_axis.ci95
        evidence[f"{axis}_real_over_commanded"] = rounded(on_axis.value * moment, 3)
        evidence[f"{axis}_ci95"] = [rounded(low * moment, 3), rounded(high * moment, 3)]
        evidence[f"{axis}_identified"] = on_axis.identifiable
    title = "Ratio of real to commanded torque, by the inertia that was given: " + ", ".join(
        f"{axis} {evidence[f'{axis}_real_over_commanded']}"
        for axis in AXES
        if f"{axis}_real_over_commanded" in evidence
    )
    yield finding("QL515", "info", evidence, title=title)


def find_in_weight(data: FlightData, vehicle: Vehicle | None) -> Iterator[Finding]:
    """Hold a commanded thrust against the weight, where the mass is given.

    Over a flight the vertical acceleration is nothing in the mean, so that thrust times the cosine of the
    tilt is the weight.

    Parameters
    ----------
    data : FlightData
        Of pooled logs, the first flight's thrust is told.
    vehicle : Vehicle or None

    Yields
    ------
    Finding
        QL313 where the two differ.
    """
    thrust, attitude = data.overview.get("thrust_n"), data.overview.get("attitude")
    if thrust is None or attitude is None or vehicle is None or not vehicle.mass_kg:
        return
    upright = np.cos(attitude.values[:, 0]) * np.cos(attitude.values[:, 1])
    lift = thrust.values[:, 0] * np.interp(thrust.time_s, attitude.time_s, upright)
    blocks = []
    for start_s, end_s in data.flights:
        n_blocks = max(int((end_s - start_s) / _WEIGHT_BLOCK_S), 1)
        edges = np.searchsorted(thrust.time_s, np.linspace(start_s, end_s, n_blocks + 1))
        blocks += [float(lift[a:b].mean()) for a, b in pairwise(edges) if b > a]
    ratio = np.array(blocks) / (vehicle.mass_kg * GRAVITY_M_S2)
    ratio = ratio[np.isfinite(ratio)]
    if ratio.size < 2:
        return
    mean = float(ratio.mean())
    sigma = math.hypot(float(ratio.std(ddof=1)) / math.sqrt(ratio.size), MASS_SIGMA * mean)
    if abs(mean - 1.0) <= student_95(ratio.size - 1) * sigma:
        return
    evidence = {
        "commanded_thrust_over_weight": rounded(mean, 3),
        "ci95": [rounded(mean + end * student_95(ratio.size - 1) * sigma, 3) for end in (-1.0, 1.0)],
        "mass_kg": vehicle.mass_kg,
    }
    title = f"The controller commands {mean:.2f} N of thrust for each newton of weight"
    yield finding("QL313", "info", evidence, title=title)
