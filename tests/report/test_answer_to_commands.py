"""The first picture of an axis that air moves as much as its commands do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.diagnosis import AxisVerdict
from quadid_logs.data.model import Response, SpectralFit
from quadid_logs.data.result import Result
from quadid_logs.figures.evidence import evidence_figure
from quadid_logs.figures.spec import Figure, Panel
from quadid_logs.figures.summary import summary_figure
from tests.synthetic_results import usable_result

GAIN, LAG_S, DELAY_S = 440.0, 0.02, 0.003
FIT = SpectralFit(
    mean=np.array([GAIN, -1.0, LAG_S, DELAY_S, 0.0]),
    covariance=np.eye(5),
    departure=0.03,
    commanded=0.9,
    r2_commanded=0.98,
    n_blocks=20,
    half_width=20.0,
    used=True,
)


def _flown(r2: float = 0.1, verdict: str = "usable") -> Result:
    """Return a flight whose roll commands tell; its torque alone explains so much of the rate."""
    made, frequency_hz = usable_result(), np.geomspace(1.0, 20.0, 12)
    s = 2j * np.pi * frequency_hz
    answer = Response(
        frequency_hz=frequency_hz,
        gain=GAIN * np.exp(-s * DELAY_S) / (1.0 + s * LAG_S),
        error=np.full(12, 0.1),
        coherence=np.full(12, 0.9),
        torque_power=np.ones(12),
    )
    model, *others = made.identification.models
    validation = replace(model.validation, r2_high_passed_rate={"p": r2, "q": 0.95, "r": 0.95})
    axes = {**made.diagnosis.axes, "roll": AxisVerdict(verdict=verdict, reasons=(), sentence="So.")}  # type: ignore[arg-type]
    return replace(
        made,
        diagnosis=replace(made.diagnosis, axes=axes),
        identification=replace(
            made.identification,
            models=(replace(model, validation=validation), *others),
            responses=(answer, answer, answer),
            spectral=(FIT, replace(FIT, used=False), replace(FIT, used=False)),
        ),
    )


def _roll(result: Result) -> Panel:
    figure = evidence_figure(result)
    assert isinstance(figure, Figure)
    return figure.panels[0]


def test_no_simulated_rate_is_described_where_none_is_shown() -> None:
    """Three axes by commands stood above a sentence on rates simulated from the torque."""
    found, every = _flown(), replace(FIT, used=True)
    model, *others = found.identification.models
    little = replace(model.validation, r2_high_passed_rate=dict.fromkeys("pqr", 0.1))
    identification = replace(
        found.identification,
        models=(replace(model, validation=little), *others),
        spectral=(every, every, every),
    )
    all_of_them = replace(found, identification=identification)
    simulated = {
        name: "Simulated from the logged torque" in evidence_figure(each).caption
        for name, each in {"one": found, "all": all_of_them}.items()
    }
    assert simulated == {"one": True, "all": False}


def test_an_axis_that_air_moves_shows_its_answer_to_commands() -> None:
    """Its simulated rate runs away from the measured one, and a pilot would believe neither."""
    panel = _roll(_flown())
    assert panel.x.unit == "Hz"
    (dots,) = (curve for curve in panel.curves if curve.mark == "bars")
    assert dots.y[0] == pytest.approx(GAIN / np.hypot(1.0, 2.0 * np.pi * LAG_S), rel=0.02)
    assert dots.high is not None
    assert dots.high[0] / dots.y[0] == pytest.approx(1.2)


@pytest.mark.parametrize(("r2", "verdict"), [(0.95, "usable"), (0.1, "refused")])
def test_an_axis_that_torque_tells_or_that_is_refused_shows_its_rate(r2: float, verdict: str) -> None:
    """There is nothing that is better known."""
    assert _roll(_flown(r2, verdict)).x.unit == "s"


def test_the_summary_shows_the_same() -> None:
    """It is the picture that is shared."""
    panel = summary_figure(_flown(), "Roll can be used.", {"roll": "440"}).panels[0]
    assert panel.x.unit == "Hz"
    assert panel.title == "Roll: usable, 440"
