"""Ways to find the on-axis effectiveness B11, B22, B33 from one aligned flight, ours and others'.

Each takes a `FlightData` and returns three gains [rad/s^2 per unit of torque],
NaN where it gives none. Every package is used as its documentation has it for
this kind of data; what had to be chosen is said where it is chosen.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify import identify
from quadid_logs.maths.sliding_windows import solve_windows, stack_windows

Estimator = Callable[[FlightData], FloatArray]

#: Where sysidentpy and nfoursid work: coarse enough that a lag of 50 ms is a few samples. The subspace
#: method's rate, block rows and order are the best for it of 48 combinations (25 and 50 Hz; 5, 10, 20 rows;
#: order 3 to 12; scaled or not) on five of these flights.
_ARX_HZ: Final = 50.0
_SUBSPACE_HZ: Final = 25.0
_BLOCK_ROWS: Final = 5
_ORDER: Final = 12
#: The band in which a discrete model's response is read: rate loops excite it, filters do not bend it.
_READ_HZ: Final = np.geomspace(0.3, 4.0, 30)
#: Of the common script: above the rate loop's band, below most vibration.
_LOW_PASS_HZ: Final = 10.0
#: The best of four between 0.03 and 0.3 s on most of six flights tried.
_SINDY_WINDOW_S: Final = 0.3


def paper(data: FlightData) -> FloatArray:
    """Invert H_k of six consecutive samples for every k, and take the median over k (eq. 10 to 11)."""
    parts = []
    for segment in data.segments:
        rates = segment.body_rate_rad_s
        p, q, r = rates.T
        regressors = np.column_stack([q * r, p * r, p * q, segment.torque])[:-1]
        slopes = np.diff(rates, axis=0) / data.sample_period_s
        solution = solve_windows(
            stack_windows(regressors, width=6, stride=1), stack_windows(slopes, width=6, stride=1)
        )
        parts.append(solution.coefficients)
    coefficients = np.median(np.concatenate(parts), axis=0)
    return np.asarray(coefficients[[0, 1, 2], [3, 4, 5]])


def least_squares(data: FlightData) -> FloatArray:
    """Least squares on zero-phase low-passed series, with damping and trim, no lag: the common script."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(
        2, min(_LOW_PASS_HZ, 0.4 / data.sample_period_s), fs=1.0 / data.sample_period_s, output="sos"
    )
    regressors, targets = [], []
    for segment in data.segments:
        rates = sosfiltfilt(sos, segment.body_rate_rad_s, axis=0)
        p, q, r = rates.T
        torque = sosfiltfilt(sos, segment.torque, axis=0)
        regressors.append(np.column_stack([q * r, p * r, p * q, rates, np.ones(len(rates)), torque]))
        targets.append(np.gradient(rates, data.sample_period_s, axis=0))
    theta, *_ = np.linalg.lstsq(np.vstack(regressors), np.vstack(targets), rcond=None)
    return np.asarray(np.diag(theta[-3:]))


def pysindy(data: FlightData) -> FloatArray:
    """Sparse regression (SINDy with control), derivative by its own smoothed finite differences.

    Terms: up to squares of the rates, torques as they are; threshold and all else are the package's own.
    It smooths states but not controls: the torques are given smoothed alike, which halves its error.
    """
    import pysindy as ps
    from scipy.signal import savgol_filter

    width = max(5, 2 * int(0.5 * _SINDY_WINDOW_S / data.sample_period_s) + 1)
    model = ps.SINDy(
        optimizer=ps.STLSQ(),
        feature_library=ps.GeneralizedLibrary(
            [ps.PolynomialLibrary(degree=2), ps.PolynomialLibrary(degree=1, include_bias=False)],
            inputs_per_library=[[0, 1, 2], [3, 4, 5]],
        ),
        differentiation_method=ps.SmoothedFiniteDifference(
            smoother_kws={"window_length": width, "polyorder": 3}
        ),
    )
    usable = [segment for segment in data.segments if segment.n_samples > width]
    model.fit(
        [segment.body_rate_rad_s for segment in usable],
        t=data.sample_period_s,
        u=[savgol_filter(segment.torque, width, 3, axis=0) for segment in usable],
        feature_names=["p", "q", "r", "L", "M", "N"],
    )
    coefficients = np.asarray(model.coefficients())
    names = model.get_feature_names()
    return np.array([coefficients[axis, names.index(name)] for axis, name in enumerate("LMN")])


def nfoursid(data: FlightData) -> FloatArray:
    """Subspace identification (N4SID) of the longest segment."""
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    series, period_s = _discrete_series(data, _SUBSPACE_HZ)
    frame = pd.DataFrame(series, columns=["p", "q", "r", "L", "M", "N"])
    method = NFourSID(
        frame, output_columns=["p", "q", "r"], input_columns=["L", "M", "N"], num_block_rows=_BLOCK_ROWS
    )
    method.subspace_identification()
    space, _ = method.system_identification(rank=_ORDER)

    def response(z: complex) -> Any:
        return space.c @ np.linalg.solve(z * np.eye(_ORDER) - space.a, space.b) + space.d

    full = np.array([response(z) for z in np.exp(2j * np.pi * _READ_HZ * period_s)])
    return np.array([_gain_of_response(full[:, axis, axis]) for axis in range(3)])


def sysidentpy(data: FlightData) -> FloatArray:
    """Linear ARX per axis, terms chosen by its FROLS with AIC, on the longest segment."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    series, period_s = _discrete_series(data, _ARX_HZ)
    gains = []
    for axis in range(3):
        model = FROLS(
            order_selection=True,
            n_info_values=15,
            ylag=4,
            xlag=[[1, 2, 3, 4]] * 3,
            info_criteria="aic",
            estimator=LeastSquares(),
            basis_function=Polynomial(degree=1),
        )
        model.fit(X=series[:, 3:], y=series[:, axis : axis + 1])
        z = np.exp(2j * np.pi * _READ_HZ * period_s)
        numerator, denominator = np.zeros_like(z), np.ones_like(z)
        for (code,), theta in zip(model.final_model, np.ravel(model.theta), strict=True):
            # 1000 + k is the output k samples ago, (2 + j) * 1000 + k input j.
            signal, lag = divmod(int(code), 1000)
            if signal == 1:
                denominator -= theta * z ** (-lag)
            elif signal == 2 + axis:
                numerator += theta * z ** (-lag)
        gains.append(_gain_of_response(numerator / denominator))
    return np.array(gains)


def ours(data: FlightData) -> FloatArray:
    """Return the gains of the recommended model, whatever the verdict."""
    model = identify(data, IdentifySettings()).recommended
    return np.full(3, np.nan) if model is None else np.diag(model.B[:3]).copy()


ESTIMATORS: Final[dict[str, Estimator]] = {
    "quadid-logs": ours,
    "paper": paper,
    "least squares": least_squares,
    "pysindy": pysindy,
    "nfoursid": nfoursid,
    "sysidentpy": sysidentpy,
}


def _discrete_series(data: FlightData, rate_hz: float) -> tuple[FloatArray, float]:
    """Return rates and torques of the longest segment, anti-aliased, mean removed, (n, 6), and the period."""
    from scipy.signal import decimate

    segment: Segment = max(data.segments, key=lambda segment: segment.n_samples)
    series = np.column_stack([segment.body_rate_rad_s, segment.torque])
    factor = max(1, round(1.0 / (rate_hz * data.sample_period_s)))
    if factor > 1:
        series = decimate(series, factor, ftype="fir", axis=0, zero_phase=True)
    return series - series.mean(axis=0), factor * data.sample_period_s


def _gain_of_response(response: Any) -> float:
    """Read the acceleration gain K off a response of torque to rate.

    A discrete model has no B of its own: K exp(-s d) / ((s + a)(1 + s tau)) is fitted to what it says, so
    that neither its lag nor its damping is held against it.
    """
    from scipy.optimize import least_squares as solve

    s = 2j * np.pi * _READ_HZ

    def error(unknown: FloatArray) -> FloatArray:
        log_gain, damping, lag, delay = unknown
        model = np.exp(log_gain - s * delay) / ((s + damping) * (1.0 + s * lag))
        ratio = model / response - 1.0
        return np.concatenate([ratio.real, ratio.imag])

    start = [np.log(np.median(np.abs(s * response))), 1.0, 0.03, 0.01]
    found = solve(error, start, bounds=([-np.inf, -5.0, 0.0, -0.02], [np.inf, 20.0, 0.25, 0.1]))
    return float(np.exp(found.x[0]))
