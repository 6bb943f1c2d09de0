"""What is said about airframe, saturation and inertia: findings, words and drawing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from quadid_logs.autopilots.ardupilot.frames import frame_geometry
from quadid_logs.cli import main
from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.flight import FlightData, InputDescription
from quadid_logs.data.log import FlightLog
from quadid_logs.data.model import Identification, Inertia
from quadid_logs.data.torque import Calibration, TorqueModel
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.diagnose.torque_findings import find_in_torque
from quadid_logs.figures.rotor_layout import airframe_from_above
from quadid_logs.figures.spec import Figure, LeftOut
from quadid_logs.identify.inertia import inertia_of
from quadid_logs.identify.inference import Estimate
from quadid_logs.load import prepare
from quadid_logs.maths.normal import NORMAL_95
from quadid_logs.report.airframe_facts import airframe_facts
from tests.actuation.logs import ardupilot_log
from tests.synthetic_results import usable_result

CALIBRATED = Calibration(
    route="mass times specific force over the flight",
    n_m_per_command=(4.0, 4.0, 0.3),
    relative_sigma=(0.02, 0.02, 0.05),
    max_thrust_n=10.0,
    torque_to_thrust_m=0.016,
    mass_kg=2.0,
    arm_length_m=0.25,
)


def found_for(
    inertia: Inertia | None, model: TorqueModel, *, achieved: bool = True
) -> dict[str, dict[str, object]]:
    """Return the findings for a result with this inertia and torque model, evidence by code."""
    result = usable_result(8.0)
    log = replace(result.log, torque=model)
    given = InputDescription(
        kind="torque_command", unit="1", source="RATE", achieved=achieved, calibration=CALIBRATED
    )
    data: FlightData = replace(result.data, input=given)
    models = tuple(replace(each, inertia=inertia) for each in result.identification.models)
    found = list(find_in_torque(log, data, Identification(models=models)))
    return {each.code: {**each.evidence, "level": each.level, "axes": each.axes} for each in found}


def tensor(*moments: float) -> Inertia:
    """Return a diagonal tensor known to 5 %."""
    matrix = np.diag(moments)
    return Inertia(matrix=matrix, ci95_low=0.95 * matrix, ci95_high=1.05 * matrix)


def quad(**changes: object) -> TorqueModel:
    """Return the torque model of the synthetic result, changed."""
    model = usable_result(8.0).log.torque
    assert model is not None
    return replace(model, calibration=CALIBRATED, **changes)  # type: ignore[arg-type]


def test_a_plausible_inertia_is_no_finding() -> None:
    """0.02 kg m^2 for 2 kg on arms of 0.25 m is an ordinary quad."""
    assert "QL512" not in found_for(tensor(0.02, 0.021, 0.035), quad())


@pytest.mark.parametrize(
    ("moments", "word"),
    [
        ((0.02, 0.02, 0.06), "triangle"),
        ((0.2, 0.02, 0.21), "Ixx_over_m_r2"),
        ((0.0004, 0.02, 0.02), "Ixx_over_m_r2"),
    ],
)
def test_an_inertia_that_no_such_body_has_is_a_warning(moments: tuple[float, ...], word: str) -> None:
    """The sum of two moments, and the ratio to mass times arm squared, beyond their intervals."""
    evidence = found_for(tensor(*moments), quad())["QL512"]
    assert word in evidence
    assert evidence["level"] == "warning"


def test_saturation_is_a_warning_only_where_the_torque_is_a_command() -> None:
    """In achieved torque the cut is contained; only the axis that was limited is named."""
    limited = quad(saturated_fraction=(0.0, 0.0, 0.08))
    assert found_for(None, limited)["QL405"]["level"] == "info"
    commanded = found_for(None, limited, achieved=False)["QL405"]
    assert commanded["level"] == "warning"
    assert commanded["axes"] == ("yaw",)


def test_an_unknown_airframe_says_what_to_pass() -> None:
    """The finding carries the need, and info prints it."""
    unknown = TorqueModel(remarks=("nothing tells",), needs=("[[rotor]] tables",))
    assert found_for(None, unknown)["QL309"]["pass"] == ("[[rotor]] tables",)
    log = replace(usable_result(8.0).log, torque=unknown)
    assert "[[rotor]] tables" in dict(airframe_facts(log))["Airframe"]


def test_every_code_of_this_part_is_in_the_catalogue() -> None:
    """`explain` knows them."""
    assert {"QL307", "QL308", "QL309", "QL405", "QL512"} <= set(CATALOGUE)


def estimate_of(B: np.ndarray) -> Estimate:
    """Return an estimate with B only, known to 1 %."""
    return Estimate(theta=B, low=B - 0.01 * np.abs(B), high=B + 0.01 * np.abs(B), kept=np.ones_like(B, bool))


def test_the_calibration_widens_the_interval_of_the_inertia() -> None:
    """1.96 sigma of 2 % and 1 % of the fit add as roots of squares."""
    parameters = usable_result(8.0).identification.models[0].parameters
    trusted = [replace(each, identifiable=True) for each in parameters]
    given = InputDescription(kind="torque_command", unit="1", source="", calibration=CALIBRATED)
    found = inertia_of(estimate_of(np.diag([200.0, 180.0, 10.0])), trusted, given)
    assert found is not None
    np.testing.assert_allclose(np.diag(found.matrix), [4.0 / 200.0, 4.0 / 180.0, 0.3 / 10.0])
    half = (found.ci95_high - found.ci95_low)[0, 0] / 2.0
    assert half / found.matrix[0, 0] == pytest.approx(np.hypot(0.01, NORMAL_95 * 0.02))


def test_an_axis_that_nobody_calibrated_stays_empty() -> None:
    """NaN in its row and column, the others as if it did not exist."""
    parameters = usable_result(8.0).identification.models[0].parameters
    trusted = [replace(each, identifiable=True) for each in parameters]
    partly = replace(CALIBRATED, n_m_per_command=(4.0, 4.0, float("nan")))
    given = InputDescription(kind="torque_command", unit="1", source="", calibration=partly)
    found = inertia_of(estimate_of(np.diag([200.0, 180.0, 10.0])), trusted, given)
    assert found is not None
    assert np.isfinite(found.matrix[:2, :2]).all()
    assert np.isnan(found.matrix[2]).all()
    assert np.isnan(found.matrix[:, 2]).all()


def test_coaxial_rotors_share_a_place_in_the_drawing() -> None:
    """An octa-quad shows four places with two numbers each, and a line per rotor."""
    frame = frame_geometry(4, 1)
    model = TorqueModel(frame=frame.name, position=frame.position, spin=frame.spin)
    result = usable_result(8.0)
    figure = airframe_from_above(replace(result, log=replace(result.log, torque=model)))
    assert isinstance(figure, Figure)
    assert sorted(label.text for label in figure.panels[0].labels) == ["1 / 6", "2 / 5", "3 / 8", "4 / 7"]
    assert sum("clockwise" in curve.label for curve in figure.panels[0].curves) == 8


def test_an_unknown_airframe_is_not_drawn() -> None:
    """The figure is left out with the reason."""
    result = usable_result(8.0)
    figure = airframe_from_above(replace(result, log=replace(result.log, torque=TorqueModel())))
    assert isinstance(figure, LeftOut)


def test_info_takes_the_vehicle_file(
    corpus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`info --vehicle` prints the calibration route and what is still missing."""
    vehicle = tmp_path / "quad.toml"
    vehicle.write_text("mass_kg = 3.0\narm_length_m = 0.35\n")
    log = corpus / "firmware" / "ac47_quadx_default_logging.BIN"
    assert main(["info", str(log), "--vehicle", str(vehicle)]) == 0
    shown = capsys.readouterr().out
    assert "by mass times specific force" in shown
    assert "torque_to_thrust_m" in shown


def test_info_names_frame_motors_and_route() -> None:
    """What a pilot checks first."""
    log: FlightLog = prepare(ardupilot_log(), Vehicle(mass_kg=2.0, arm_length_m=0.3)).log
    facts = dict(airframe_facts(log))
    assert facts["Airframe"].startswith("quad x, 4 motors (FRAME_CLASS 1")
    assert "1: out 1 (+0.21, +0.21) ccw" in facts["Motors"]
    assert "by mass times specific force" in facts["Scale"]
    assert "torque_to_thrust_m" in facts["Scale"]
