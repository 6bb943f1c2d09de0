"""The model for other programs: the same numbers, their signs and axes, and refusals."""

from __future__ import annotations

import io
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from quadid_logs.cli import main
from quadid_logs.data.model import Inertia
from quadid_logs.data.result import Result
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.errors import EmptyLogError
from quadid_logs.report.model_files import model_bytes, rate_matrices
from tests.synthetic_results import hostile_result, refused_result

TENSOR = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.04]])


@pytest.fixture(scope="module")
def calibrated(usable: Result) -> Result:
    """Return a result with a full inertia tensor and a mass."""
    first, *others = usable.identification.models
    inertia = Inertia(matrix=TENSOR, ci95_low=TENSOR - 1e-4, ci95_high=TENSOR + 1e-4)
    models = (replace(first, inertia=inertia), *others)
    return replace(
        usable,
        identification=replace(usable.identification, models=models),
        vehicle=Vehicle(mass_kg=1.5),
    )


def test_matlab_gets_the_matrices_and_their_names(calibrated: Result) -> None:
    """Read back with scipy."""
    found = loadmat(io.BytesIO(model_bytes(calibrated, ".mat")), squeeze_me=True)
    model = calibrated.identification.models[0]
    np.testing.assert_array_equal(found["A"], model.A)
    np.testing.assert_array_equal(found["B"], model.B)
    assert list(found["regressors"]) == list(model.regressors)
    np.testing.assert_array_equal(found["inertia_kg_m2"], TENSOR)


def test_matlab_gets_intervals_units_and_verdicts(calibrated: Result) -> None:
    """A number without them claims more than the flight told."""
    found = loadmat(io.BytesIO(model_bytes(calibrated, ".mat")), squeeze_me=True)
    model = calibrated.identification.models[0]
    for item in model.parameters:
        matrix, names = ("B", model.inputs) if item.regressor in model.inputs else ("A", model.regressors)
        place = model.targets.index(item.target), names.index(item.regressor)
        assert (found[f"{matrix}_ci95_low"][place], found[f"{matrix}_ci95_high"][place]) == item.ci95
        assert found[f"{matrix}_unit"][place] == item.unit
    assert model.actuator is not None
    np.testing.assert_array_equal(found["lag_ci95_s"], model.actuator.lag_ci95_s)
    np.testing.assert_array_equal(found["delay_ci95_s"], model.actuator.delay_ci95_s)
    np.testing.assert_array_equal(found["inertia_ci95_low_kg_m2"], TENSOR - 1e-4)
    verdicts = {axis: verdict.verdict for axis, verdict in calibrated.diagnosis.axes.items()}
    assert dict(zip(found["axes"], found["verdict"], strict=True)) == verdicts


@pytest.mark.parametrize("name", ["lag", "delay"])
def test_a_time_that_cannot_be_told_from_zero_makes_no_pole(calibrated: Result, name: str) -> None:
    """A lag of 9e-11 s put poles at -1e10 rad/s into the model: no solver gets past them."""
    first, *others = calibrated.identification.models
    assert first.actuator is not None
    nothing: dict[str, Any] = {f"{name}_s": 9e-11, f"{name}_ci95_s": (0.0, 0.004)}
    model = replace(first, actuator=replace(first.actuator, **nothing))
    result = replace(calibrated, identification=replace(calibrated.identification, models=(model, *others)))
    assert np.abs(run_script(result)["vehicle"].poles()).max() < 1e4
    assert f"left out, indistinguishable from zero: {name}\n" in model_bytes(result, ".py").decode()


def run_script(result: Result) -> dict[str, Any]:
    """Run the exported script with python-control, and return what it defines."""
    names: dict[str, Any] = {}
    exec(compile(model_bytes(result, ".py").decode(), "model.py", "exec"), names)
    return names


def test_the_python_script_makes_the_model_s_transfer_functions(calibrated: Result) -> None:
    """(s I - A)^-1 B behind lag and delay, at frequencies where the delay's Pade approximation is exact."""
    vehicle = run_script(calibrated)["vehicle"]
    model = calibrated.identification.models[0]
    rates, gains = rate_matrices(model)
    assert model.actuator is not None
    assert model.actuator.delay_s > 0.0
    for s in (2j * np.pi * frequency_hz for frequency_hz in (0.2, 1.0, 4.0)):
        actuator = np.exp(-s * model.actuator.delay_s) / (1.0 + s * model.actuator.lag_s)
        expected = np.linalg.solve(s * np.eye(3) - rates, gains) * actuator
        np.testing.assert_allclose(vehicle(s), expected, rtol=1e-4, atol=1e-6)


def test_the_python_script_names_torques_and_rates(calibrated: Result) -> None:
    """So that a loop can be closed by name."""
    rates = run_script(calibrated)["rates"]
    assert (rates.input_labels, rates.output_labels) == (["L", "M", "N"], ["p", "q", "r"])


def test_a_hostile_log_puts_no_code_into_the_script() -> None:
    """The file's name stays within its comment line."""
    result = hostile_result(path='x"\n"""\nimport os; hacked = True\r#.bin')
    assert "hacked" not in run_script(result)


def test_gazebo_gets_the_tensor_in_its_own_axes(calibrated: Result) -> None:
    """Forward-left-up: the products with x change their sign, the one of y and z does not."""
    block = ET.fromstring(model_bytes(calibrated, ".sdf"))
    found = {element.tag: float(element.text or "nan") for element in block.iter() if element.text.strip()}
    assert found == {
        "mass": 1.5,
        "ixx": 0.02,
        "ixy": -0.001,
        "ixz": 0.002,
        "iyy": 0.03,
        "iyz": 0.003,
        "izz": 0.04,
    }


def test_sitl_gets_its_own_keys(calibrated: Result) -> None:
    """As SIM_Frame.cpp reads them."""
    assert json.loads(model_bytes(calibrated, ".json")) == {
        "mass": 1.5,
        "moment_inertia": [0.02, 0.03, 0.04],
    }


@pytest.mark.parametrize("ending", [".sdf", ".json"])
def test_an_inertia_that_cannot_be_trusted_is_not_exported(calibrated: Result, ending: str) -> None:
    """Neither that of a refused axis nor one that is not known."""
    verdict = replace(calibrated.diagnosis.axes["yaw"], verdict="refused")
    axes = {**calibrated.diagnosis.axes, "yaw": verdict}
    refused = replace(calibrated, diagnosis=replace(calibrated.diagnosis, axes=axes))
    with pytest.raises(EmptyLogError, match="yaw must not be trusted"):
        model_bytes(refused, ending)
    first, *others = calibrated.identification.models
    unknown = replace(calibrated.identification, models=(replace(first, inertia=None), *others))
    with pytest.raises(EmptyLogError, match="--vehicle"):
        model_bytes(replace(calibrated, identification=unknown), ending)


def test_a_log_without_a_model_says_why() -> None:
    """The reason is the identification's."""
    with pytest.raises(EmptyLogError, match="no flight to identify from"):
        model_bytes(refused_result(), ".mat")


def test_the_command_writes_the_file_once(
    calibrated: Result,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """And refuses to replace it, and endings that say nothing."""
    monkeypatch.setattr("quadid_logs.pipeline.analyze", lambda *_a, **_k: calibrated)
    (tmp_path / "f.bin").touch()
    log, out = str(tmp_path / "f.bin"), tmp_path / "model.sdf"
    assert main(["export", log, "--model", "-o", str(out)]) == 0
    assert out.read_bytes() == model_bytes(calibrated, ".sdf")
    assert main(["export", log, "--model", "-o", str(out)]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["export", log, "--model", "-o", str(tmp_path / "model.xlsx")]) == 2
    assert "python-control" in capsys.readouterr().err
