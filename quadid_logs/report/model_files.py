"""The model for other programs: MATLAB, python-control, and simulators."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from quadid_logs.arrays import AnyArray, FloatArray
from quadid_logs.data.model import Model
from quadid_logs.data.result import Result
from quadid_logs.errors import EmptyLogError, SettingsError
from quadid_logs.report.commands import on_log
from quadid_logs.report.verdict import input_unit, refused_names
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, AXES, RATE_SYMBOLS
from quadid_logs.writers.sitl_frame import TITLE as SITL_TITLE
from quadid_logs.writers.sitl_frame import sitl_frame

#: What each ending stands for.
MODEL_FORMATS = MappingProxyType(
    {".mat": "MATLAB", ".py": "python-control", ".sdf": "Gazebo's inertia", ".json": SITL_TITLE}
)


def check_model_format(path: Path) -> None:
    """Refuse an ending that says no format.

    Parameters
    ----------
    path : Path

    Raises
    ------
    SettingsError
    """
    if path.suffix.lower() not in MODEL_FORMATS:
        raise SettingsError(
            f"The name {printable(path.name, 80)!r} does not show the format.",
            hint=f"{', '.join(f'{ending} is {title}' for ending, title in MODEL_FORMATS.items())}.",
        )


def model_formats_of(result: Result) -> tuple[str, ...]:
    """Return the endings that the model of a result can be written with.

    Parameters
    ----------
    result : Result

    Returns
    -------
    tuple of str
        Of `MODEL_FORMATS`.
    """
    model = result.identification.recommended
    if model is None:
        return ()
    try:
        _trusted_inertia(result, model)
    except EmptyLogError:
        return (".mat", ".py")
    return tuple(MODEL_FORMATS)


def model_bytes(result: Result, ending: str) -> bytes:
    """Return the recommended model as a file.

    Parameters
    ----------
    result : Result
    ending : str
        One of `MODEL_FORMATS`: ``.mat`` holds A and B with intervals, units, names
        and verdicts; ``.py`` makes a python-control system of what can be told
        from zero; ``.sdf`` is an ``<inertial>`` block in Gazebo's
        forward-left-up axes; ``.json`` a frame file (`quadid_logs.writers.sitl_frame`).

    Returns
    -------
    bytes

    Raises
    ------
    EmptyLogError
        If there is no model, or (``.sdf``, ``.json``) no inertia of axes that
        can all be trusted.
    """
    model = result.identification.recommended
    if model is None:
        why = printable(result.identification.skipped) or "this log holds too little"
        hint = f"See `{on_log(result, 'analyze')}`."
        raise EmptyLogError(f"There is no model to export: {why}.", hint=hint)
    if ending == ".mat":
        return _matlab(result, model)
    if ending == ".py":
        return _python_control(result, model).encode()
    inertia = _trusted_inertia(result, model)
    # The mass that the user or the calibration names, NaN if nobody does.
    if result.vehicle is not None and result.vehicle.mass_kg is not None:
        mass_kg = result.vehicle.mass_kg
    else:
        mass_kg = result.data.input.calibration.mass_kg if result.data.input is not None else math.nan
    return (_sdf(inertia, mass_kg) if ending == ".sdf" else sitl_frame(inertia, mass_kg)).encode()


def _matlab(result: Result, model: Model) -> bytes:
    """Return A, B, lag, delay and inertia with intervals and units, and the verdicts."""
    from scipy.io import savemat

    low_A, high_A, unit_A = _intervals(model, model.regressors)
    low_B, high_B, unit_B = _intervals(model, model.inputs)
    verdicts = result.diagnosis.axes
    content: dict[str, object] = {
        "structure": model.structure,
        "A": model.A,
        "A_ci95_low": low_A,
        "A_ci95_high": high_A,
        "A_unit": unit_A,
        "B": model.B,
        "B_ci95_low": low_B,
        "B_ci95_high": high_B,
        "B_unit": unit_B,
        "regressors": np.array(model.regressors, dtype=object),
        "targets": np.array(model.targets, dtype=object),
        "inputs": np.array(model.inputs, dtype=object),
        "input_unit": input_unit(result),
        "axes": np.array(AXES, dtype=object),
        "verdict": np.array([verdicts[axis].verdict for axis in AXES], dtype=object),
    }
    if (actuator := model.actuator) is not None:
        content |= {"lag_s": actuator.lag_s, "lag_ci95_s": actuator.lag_ci95_s}
        content |= {"delay_s": actuator.delay_s, "delay_ci95_s": actuator.delay_ci95_s}
    if (inertia := model.inertia) is not None:
        content["inertia_kg_m2"] = inertia.matrix
        content["inertia_ci95_low_kg_m2"] = inertia.ci95_low
        content["inertia_ci95_high_kg_m2"] = inertia.ci95_high
    if model.discrete is not None:
        content |= {
            "A_d": model.discrete.A_d,
            "B_d": model.discrete.B_d,
            "sample_period_s": model.discrete.sample_period_s,
        }
    buffer = io.BytesIO()
    # The stubs know paths only; scipy takes any open file.
    savemat(cast("Any", buffer), content)
    return buffer.getvalue()


def _intervals(model: Model, columns: Sequence[str]) -> tuple[FloatArray, FloatArray, AnyArray]:
    """Return both ends of the 95 % intervals and the units; NaN and "" where an element was not fitted."""
    shape = (len(model.targets), len(columns))
    low, high = np.full(shape, np.nan), np.full(shape, np.nan)
    unit = np.full(shape, "", dtype=object)
    for i, target in enumerate(model.targets):
        for j, column in enumerate(columns):
            if (entry := model.entries.get((target, column))) is not None:
                (low[i, j], high[i, j]), unit[i, j] = entry.ci95, entry.unit
    return low, high, unit


def rate_matrices(model: Model) -> tuple[FloatArray, FloatArray]:
    """Return the linear part of the model in p, q, r.

    Parameters
    ----------
    model : Model

    Returns
    -------
    A, B : ndarray, shape (3, 3)
        [1/s], and [rad/s^2 per unit of torque].
    """
    rows = [model.targets.index(symbol) for symbol in ACCELERATION_SYMBOLS]
    rates = np.zeros((3, 3))
    for column, symbol in enumerate(RATE_SYMBOLS):
        if symbol in model.regressors:
            rates[:, column] = model.A[rows, model.regressors.index(symbol)]
    return rates, np.asarray(model.B[rows], dtype=np.float64)


def linear_actuator(model: Model) -> tuple[float, float]:
    """Return lag and delay of the actuator [s].

    One whose interval holds zero is left out: as a number it would be a pole at -1e10 rad/s.

    Parameters
    ----------
    model : Model

    Returns
    -------
    lag_s, delay_s : float
        0 where there is none, or it cannot be told from zero.
    """
    actuator = model.actuator
    if actuator is None:
        return 0.0, 0.0
    lag_s = actuator.lag_s if actuator.lag_ci95_s[0] > 0.0 else 0.0
    return lag_s, actuator.delay_s if actuator.delay_ci95_s[0] > 0.0 else 0.0


def _python_control(result: Result, model: Model) -> str:
    """Return a script that makes the system: rates behind lag and delay."""
    rates, gains = rate_matrices(model)
    lag_s, delay_s = linear_actuator(model)
    nothing = [name for name, value_s in (("lag", lag_s), ("delay", delay_s)) if not value_s]
    refused = refused_names(result)
    unit = "N m" if input_unit(result) == "N m" else "normalised command"
    name = printable(PurePath(result.log.path).name, 120)
    warning = f"# NOT TO BE TRUSTED: {', '.join(refused)}\n" if refused else ""
    left_out = f"# left out, indistinguishable from zero: {', '.join(nothing)}\n" if nothing else ""
    return f'''"""Rates p, q, r [rad/s] from torques L, M, N [{unit}]; written by quadid-logs."""
# from {name!a}, structure {model.structure}; linear part about hover
{left_out}{warning}import control
import numpy as np

A = np.array({_rounded(rates)})
B = np.array({_rounded(gains)})
lag_s, delay_s = {lag_s:.6g}, {delay_s:.6g}

rates = control.ss(A, B, np.eye(3), np.zeros((3, 3)), inputs=["L", "M", "N"], outputs=["p", "q", "r"])
lag = control.tf([1.0], [lag_s, 1.0]) if lag_s > 0.0 else control.tf([1.0], [1.0])
delay = control.tf(*control.pade(delay_s, 2)) if delay_s > 0.0 else control.tf([1.0], [1.0])
actuator = control.append(*(control.ss(lag * delay) for _ in range(3)))
vehicle = control.series(actuator, rates)
'''


def _rounded(matrix: FloatArray) -> str:
    """Return a matrix as Python text, to six significant digits."""
    return repr([[float(f"{value:.6g}") for value in row] for row in matrix])


def _trusted_inertia(result: Result, model: Model) -> FloatArray:
    """Return the tensor (3, 3) [kg m^2], refused unless every axis can be trusted."""
    refused = refused_names(result)
    if refused:
        raise EmptyLogError(
            f"The inertia cannot be exported: {', '.join(refused)} must not be trusted.",
            hint=f"`{on_log(result, 'analyze')}` says what to fly.",
        )
    matrix = None if model.inertia is None else model.inertia.matrix
    if matrix is None or not np.isfinite(np.diagonal(matrix)).all():
        raise EmptyLogError(
            "The inertia is not known about all axes: the torque is not calibrated to N m.",
            hint="Give mass_kg, arm_length_m and torque_to_thrust_m with --vehicle FILE.toml.",
        )
    return np.asarray(np.nan_to_num(matrix), dtype=np.float64)


def _sdf(inertia: FloatArray, mass_kg: float) -> str:
    """Return an inertial block; FRD to Gazebo's FLU turns half a circle about x."""
    turn = np.diag([1.0, -1.0, -1.0])
    flu = turn @ inertia @ turn
    mass = f"  <mass>{mass_kg:.6g}</mass>\n" if math.isfinite(mass_kg) else "  <!-- <mass> is not known -->\n"
    elements = "".join(
        f"    <i{names}>{flu[i, j]:.6g}</i{names}>\n"
        for names, i, j in (
            ("xx", 0, 0),
            ("xy", 0, 1),
            ("xz", 0, 2),
            ("yy", 1, 1),
            ("yz", 1, 2),
            ("zz", 2, 2),
        )
    )
    return f"<inertial>\n{mass}  <inertia>\n{elements}  </inertia>\n</inertial>\n"
