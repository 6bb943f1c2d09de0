"""The published method: torque as logged, windows of consecutive samples."""

from __future__ import annotations

from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Model
from quadid_logs.data.settings import IdentifySettings
from quadid_logs.identify.design import Design
from quadid_logs.identify.excitation import ColumnNoise
from quadid_logs.identify.fit import fit_pooled
from quadid_logs.identify.model import build_model
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.windows import windows_at_full_rate


def fit_as_published(
    structure: Structure,
    data: FlightData,
    design: Design,
    settings: IdentifySettings,
    noise: ColumnNoise,
) -> Model:
    """Fit a structure of the paper, eq. (4)-(5) or (10)-(11).

    Parameters
    ----------
    structure : Structure
    data : FlightData
    design : Design
        Its rows, not high-passed.
    settings : IdentifySettings
        ``window``, ``stride``.
    noise : ColumnNoise

    Returns
    -------
    Model
    """
    windows = windows_at_full_rate(
        structure, data, design.smoothing_hz, settings, noise.of(structure.all_terms)
    )
    fit = fit_pooled(design, structure, None)
    return build_model(data, design, structure, fit, torque=design.torque.as_logged(), windows=windows)
