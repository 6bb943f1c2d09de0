"""The extension point: one module adds an autopilot, and nothing else is touched."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from quadid_logs import autopilots, result_schema
from quadid_logs.cli import main
from quadid_logs.data.log import FlightLog
from quadid_logs.errors import SettingsError
from quadid_logs.load import read_log
from quadid_logs.pipeline import analyze
from quadid_logs.simulator import Simulation, simulate

from . import toy


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register the toy for one test."""
    monkeypatch.setattr(autopilots, "_registered", [])
    autopilots.register(toy.AUTOPILOT)


def install(entry_point: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lay a package with one entry point where Python finds installed packages."""
    package = folder / "toy_autopilot-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-autopilot\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(f"[quadid_logs.autopilots]\ntoy = {entry_point}\n")
    monkeypatch.syspath_prepend(folder)
    autopilots._installed.cache_clear()


@pytest.fixture
def forgotten() -> Iterator[None]:
    """Forget what a test has installed."""
    yield
    autopilots._installed.cache_clear()


@pytest.fixture
def installed(forgotten: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the toy for one test."""
    install("tests.autopilots.toy:AUTOPILOT", tmp_path, monkeypatch)


def toy_log(log: FlightLog) -> str:
    """Write gyro and commands of a log as the toy would."""
    rate, command = log.candidates("body_rate")[0], log.candidates("torque_command")[0]
    throttle = log.candidates("throttle")[0]
    lines = [
        *(f"GYRO {1e3 * t:.3f} " + " ".join(f"{v:.9g}" for v in row) + "\n"
          for t, row in zip(rate.time_s, np.degrees(rate.values), strict=True)),
        *(f"CMD {1e3 * t:.3f} " + " ".join(f"{100 * v:.9g}" for v in (*row, up)) + "\n"
          for t, row, up in zip(command.time_s, command.values, throttle.values[:, 0], strict=True)),
    ]  # fmt: skip
    return "TOY1\n" + "".join(sorted(lines, key=lambda line: float(line.split()[1])))


@pytest.fixture(scope="module")
def flight() -> Simulation:
    """Fly a flight with known truth."""
    return simulate("sysid-quad-x", seed=3, duration_s=25.0, rate_hz=100.0)


@pytest.fixture(scope="module")
def flown(flight: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log it as the toy does."""
    path = tmp_path_factory.mktemp("toy") / "flight.toy"
    path.write_text(toy_log(flight.log))
    return path


@pytest.mark.usefixtures("registered")
def test_one_module_adds_an_autopilot_down_to_the_model(flown: Path, flight: Simulation) -> None:
    """The on-axis effectiveness is the true one, to what a log without gyro filter and voltage can tell."""
    model = analyze(flown).identification.recommended
    assert model is not None
    found = {parameter.name: parameter.value for parameter in model.parameters}
    truth = np.diag(flight.truth["models"]["quadrotor-6"]["B"])
    np.testing.assert_allclose([found["B11"], found["B22"], found["B33"]], truth, rtol=0.1)


@pytest.mark.usefixtures("registered")
def test_a_registered_format_is_asked_and_named(flown: Path) -> None:
    """The registry answers for its format and its name."""
    log = read_log(flown)
    assert (log.format, log.autopilot, log.corrupt_bytes) == ("toy", "toy", 0)
    assert autopilots.named("toy").title == "Toy autopilot"


def test_without_it_the_file_is_unknown(flown: Path) -> None:
    """What was registered for one test is gone."""
    assert autopilots.named("toy").name == "other"
    with pytest.raises(Exception, match="not a recognised flight log"):
        read_log(flown)


@pytest.mark.usefixtures("installed")
def test_the_result_of_an_installed_autopilot_validates(
    flown: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Found by its entry point alone; the schema knows the new names, and still refuses others."""
    assert main(["analyze", str(flown), "--json", "--no-report"]) in (0, 1)
    content = json.loads(capsys.readouterr().out)
    assert (content["log"]["format"], content["log"]["autopilot"]) == ("toy", "toy")
    validator = jsonschema.Draft202012Validator(result_schema())
    validator.validate(content)
    content["log"]["autopilot"] = "another toy"
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(content)


def test_the_schema_of_this_package_alone_refuses_the_toy() -> None:
    """Its names are those of what is installed."""
    names = result_schema()["properties"]["log"]["properties"]
    assert "toy" not in names["format"]["enum"] + names["autopilot"]["enum"]


@pytest.mark.usefixtures("forgotten")
@pytest.mark.parametrize(
    ("entry_point", "said"),
    [
        ("no_such_module:AUTOPILOT", "cannot be loaded"),
        ("tests.autopilots.toy:SOURCES", "is not an Autopilot"),
    ],
)
def test_a_broken_package_is_one_line_that_names_it(
    entry_point: str, said: str, flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not left out in silence: its logs would be unknown files."""
    install(entry_point, tmp_path, monkeypatch)
    with pytest.raises(SettingsError, match=said) as raised:
        read_log(flown)
    assert raised.value.hint == "Update or uninstall the package toy-autopilot."
