"""``export`` writes what `analyze` works on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from quadid_logs import pipeline
from quadid_logs.cli import main
from quadid_logs.data.flight import FlightData
from quadid_logs.data.vehicle import Vehicle
from quadid_logs.simulator import simulate
from quadid_logs.writers import write_log

TOML = "mass_kg = 1.5\narm_length_m = 0.25\ntorque_to_thrust_m = 0.016\n"
VEHICLE = Vehicle(mass_kg=1.5, arm_length_m=0.25, torque_to_thrust_m=0.016)


@pytest.fixture(scope="module")
def saturated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight in which the mixer limits yaw: what was commanded is not what the motors gave."""
    path = tmp_path_factory.mktemp("saturated") / "flight.bin"
    write_log(simulate("saturation", seed=1, duration_s=25.0).log, path)
    return path


def exported(log: Path, folder: Path, *arguments: str) -> dict[str, np.ndarray]:
    """Return the columns that export writes."""
    path = folder / "series.parquet"
    assert main(["export", str(log), "-o", str(path), *arguments]) == 0
    return {name: column.to_numpy() for name, column in zip(*_columns(path), strict=True)}


def _columns(path: Path) -> tuple[list[str], list[object]]:
    table = pq.read_table(path)
    return table.column_names, table.columns


def joined(data: FlightData, name: str) -> np.ndarray:
    """Return one array of the segments that were fitted."""
    return np.concatenate([getattr(segment, name) for segment in data.segments])


def fitted(log: Path, vehicle: Vehicle | None = None) -> FlightData:
    """Return what `analyze` identifies, without waiting for what it finds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(pipeline, "judge", lambda _log, data, *_, **__: data)
        return pipeline.analyze(log, vehicle=vehicle)  # type: ignore[return-value]


def test_the_exported_series_are_those_that_were_fitted(saturated: Path, tmp_path: Path) -> None:
    """Time, rates, torque and saturation, sample by sample."""
    data, table = fitted(saturated), exported(saturated, tmp_path)
    np.testing.assert_array_equal(table["time_s"], joined(data, "time_s"))
    for name, columns in (
        ("body_rate_rad_s", ("p_rad_s", "q_rad_s", "r_rad_s")),
        ("torque", ("L_command", "M_command", "N_command")),
    ):
        np.testing.assert_array_equal(
            np.column_stack([table[column] for column in columns]), joined(data, name)
        )
    np.testing.assert_array_equal(table["saturated"] > 0, joined(data, "saturated"))


def test_the_export_differs_from_the_command_where_it_was_limited(saturated: Path, tmp_path: Path) -> None:
    """The flight does show the difference: yaw got less than was commanded."""
    table = exported(saturated, tmp_path)
    commanded = simulate("saturation", seed=1, duration_s=25.0).log.candidates("torque_command")[0]
    lost = np.interp(table["time_s"], commanded.time_s, commanded.values[:, 2]) - table["N_command"]
    assert np.abs(lost).max() > 0.2
    assert np.abs(lost[table["saturated"] == 0]).max() < 0.1


def test_a_vehicle_file_gives_the_series_in_newton_metres(saturated: Path, tmp_path: Path) -> None:
    """As in the analysis with the same file."""
    file = tmp_path / "quad.toml"
    file.write_text(TOML)
    data = fitted(saturated, VEHICLE)
    table = exported(saturated, tmp_path, "--vehicle", str(file))
    torque = np.column_stack([table[name] for name in ("L_n_m", "M_n_m", "N_n_m")])
    np.testing.assert_array_equal(torque, joined(data, "torque"))
