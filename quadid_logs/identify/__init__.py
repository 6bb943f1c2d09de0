"""FlightData -> Identification: every structure fitted, the best one recommended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Identification, Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.design import build_design, smooth_segment
from quadid_logs.identify.excitation import column_noise, measure_excitation, noise_density
from quadid_logs.identify.instruments import with_strong_instruments
from quadid_logs.identify.model import (
    actuated_model,
    fit_as_published,
    fit_one_body,
    fit_rows_apart,
    moved_axes,
)
from quadid_logs.identify.select import most_moved
from quadid_logs.identify.structures import DAMPED, LINEAR_9, QUADROTOR_6, RIGID_BODY
from quadid_logs.vocabulary import ACCELERATION_SYMBOLS, RATE_SYMBOLS

__all__ = ["identify"]

#: Rigid-body motion and rate loops live below 5 Hz; above, the gyro's filters,
#: blade and frame dynamics add phase that no lag and delay describe.
_SMOOTHING_HZ = 5.0
#: At least eight samples per cycle at the cut-off, or the torque between samples is a guess.
_SAMPLES_PER_CYCLE = 8.0
#: Leaving this much more of held-out acceleration unexplained is chance: the
#: squared error of some hundred stretches is known to a tenth.
_WORSE = 0.1
_NOT_ONE_BODY = (
    "This flight does not show that the vehicle is one rigid body: its gyroscopic terms are not seen, "
    "or the rows fitted one by one explain held-out flight better."
)
#: Equivalent noise bandwidth of the Gaussian over its cut-off: sqrt(pi / ln 2) / 2.
_NOISE_BANDWIDTH = 1.0645
#: Rows per unknown below which a fit is arithmetic, not evidence.
_ROWS_PER_UNKNOWN = 5


def identify(data: FlightData, settings: IdentifySettings) -> Identification:
    """Fit all structures to the aligned flight.

    Parameters
    ----------
    data : FlightData
    settings : IdentifySettings

    Returns
    -------
    Identification
        Without models, and with ``skipped`` saying why, where the data hold
        too little to fit anything. Doubtful models are returned: `diagnose`
        judges them.
    """
    if not data.segments or data.input is None:
        return Identification(skipped="there is no stretch of flight with both body rates and torque")
    needed = [data.sources[name] for name in (data.input.kind, "body_rate") if name in data.sources]
    slowest_hz = min((source.rate_hz for source in needed), default=np.inf)
    if slowest_hz < settings.min_rate_hz:
        return Identification(skipped=f"torque and rates were logged at {slowest_hz:.3g} Hz only")
    smoothing_hz = settings.smoothing_hz or min(
        _SMOOTHING_HZ, 1.0 / (data.sample_period_s * _SAMPLES_PER_CYCLE)
    )
    data = most_moved(data, settings.most_samples)
    design = build_design(data, smoothing_hz, settings)
    n_needed = _ROWS_PER_UNKNOWN * len(DAMPED.columns)
    if design is None or np.count_nonzero(design.train) < n_needed:
        return Identification(skipped="the flight is too short for the number of unknowns")
    swift = design.without_slow(settings.high_pass_hz)
    design = with_strong_instruments(design, swift, moved_axes(swift, settings))
    noise = column_noise(noise_density(data), design.columns, _NOISE_BANDWIDTH * smoothing_hz)
    rows_apart = fit_rows_apart(data, design, settings)
    models = [actuated_model(data, rows_apart, settings, noise=noise)]
    one_body = fit_one_body(data, rows_apart, settings)
    if one_body is not None:
        models.append(actuated_model(data, one_body, settings, noise=noise))
    smooth = [smooth_segment(segment, data.sample_period_s, smoothing_hz) for segment in data.segments]
    models.append(fit_as_published(QUADROTOR_6, data, design, smooth, settings, noise=noise))
    if all(name in design.columns for name in LINEAR_9.regressors):
        models.append(fit_as_published(LINEAR_9, data, design, smooth, settings, noise=noise))
    ordered = _recommend(models, settings)
    return Identification(
        models=ordered,
        n_samples=data.n_samples,
        excitation=measure_excitation(
            data,
            signal_to_noise=_signal_to_noise(ordered[0]),
            rate_rms_rad_s=np.array([np.std(swift.columns[name]) for name in RATE_SYMBOLS]),
        ),
    )


def _recommend(models: list[Model], settings: IdentifySettings) -> tuple[Model, ...]:
    """Put the structure first that the user asked for, or else a physical one.

    The paper's own structures take the torque as logged. Whatever they
    explain, their B is that of no vehicle whose motors lag.
    """
    rows_apart, *others = models
    physical = next((model for model in others if _is_one_body(model, rows_apart)), rows_apart)
    wanted = next((model for model in models if model.structure == settings.structure), None)
    best = wanted or physical
    ordered = sorted(models, key=lambda model: model is not best)
    return tuple(
        replace(
            model,
            recommended=model is best,
            note=_NOT_ONE_BODY
            if model.structure == RIGID_BODY.name and model is not physical
            else model.note,
        )
        for model in ordered
    )


def _is_one_body(model: Model, rows_apart: Model) -> bool:
    """Say whether the vehicle is seen to be one rigid body.

    Its gyroscopic terms must be seen, or its shape is a guess; it must explain
    held-out flight as well as the rows one by one do; and the simpler model
    must be the more likely one.
    """
    own = set(zip(ACCELERATION_SYMBOLS, ("qr", "pr", "pq"), strict=True))
    seen = [p.identifiable for p in model.parameters if (p.target, p.regressor) in own]
    if model.structure != RIGID_BODY.name or not all(seen):
        return False
    left, left_apart = (
        1.0 - np.array([each.validation.r2_acceleration.get(name, -np.inf) for name in ACCELERATION_SYMBOLS])
        for each in (model, rows_apart)
    )
    return bool((left <= (1.0 + _WORSE) * left_apart).all()) and model.criterion < rows_apart.criterion


def _signal_to_noise(model: Model) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return explained over unexplained variance of held-out acceleration per axis; shape (3,)."""
    r2 = np.array([model.validation.r2_acceleration.get(name, float("nan")) for name in ACCELERATION_SYMBOLS])
    return np.asarray(np.maximum(r2, 0.0) / np.maximum(1.0 - r2, 1e-9), dtype=np.float64)
