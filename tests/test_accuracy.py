"""The accuracy benchmark: how it reads truths and gains, and that it runs without the other packages."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest

from benchmarks import accuracy, estimators
from benchmarks.methods import data_sets
from quadid_logs.align import cut
from quadid_logs.data.settings import AlignSettings
from quadid_logs.load import prepare
from quadid_logs.simulator import simulate


@pytest.fixture(scope="module")
def flight():
    """A short good flight, aligned, and its true gains."""
    flown = simulate("sysid-quad-x", seed=2, duration_s=25.0, rate_hz=200.0)
    data = cut(prepare(flown.log), AlignSettings())
    return data, np.diag(np.array(flown.truth["models"]["damped"]["B"]))


def test_the_gain_is_read_off_a_response_whatever_its_lag_and_damping():
    """K exp(-s d) / ((s + a)(1 + s tau)) with K = 150."""
    s = 2j * np.pi * estimators._READ_HZ
    response = 150.0 * np.exp(-0.012 * s) / ((s + 1.5) * (1.0 + 0.04 * s))
    assert estimators._gain_of_response(response) == pytest.approx(150.0, rel=1e-4)


def test_our_gains_are_nearer_the_truth_than_the_published_method(flight):
    """On every axis, and than least squares that knows of no lag."""
    data, truth = flight
    error = {
        name: np.abs(estimators.ESTIMATORS[name](data) / truth - 1.0)
        for name in ("quadid-logs", "paper", "least squares")
    }
    assert (error["quadid-logs"] < error["paper"]).all()
    assert (error["quadid-logs"] < error["least squares"]).all()


@pytest.mark.parametrize("name", accuracy.PACKAGES)
def test_each_package_gives_three_gains_of_the_right_size(flight, name):
    """None is used so that it cannot but fail: the right sign, and within a factor of two."""
    pytest.importorskip(name)
    data, truth = flight
    ratio = estimators.ESTIMATORS[name](data) / truth
    assert ((ratio > 0.5) & (ratio < 2.0)).all()


@pytest.mark.parametrize(
    "truth",
    [
        {"B_rad_s2_per_torque_setpoint": [[1.0, 9.0, 9.0], [9.0, 2.0, 9.0], [9.0, 9.0, 3.0]]},
        {
            "at_segment_mean": {
                "B_rad_s2_per_unit": [[1.0, 0.0, 0.0, 9.0], [0.0, 2.0, 0.0, 9.0], [0.0, 0.0, 3.0, 9.0]]
            }
        },
        {"at_hover": {"B_rad_s2_per_unit": {"M": [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]}}},
        {"linear_model": {"B_roll_pitch_yaw_ls_flight": [1.0, 2.0, 3.0]}},
    ],
)
def test_every_layout_of_a_firmware_truth_is_read(truth):
    """PX4's, ArduPilot's at the mean throttle, ArduPilot's at hover, Betaflight's."""
    known = data_sets.firmware_truth(truth)
    assert known is not None
    np.testing.assert_array_equal(known.effectiveness, [1.0, 2.0, 3.0])


@pytest.mark.thorough
def test_a_missing_package_is_named_and_left_out(monkeypatch, tmp_path, capsys):
    """And the table is written all the same."""
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        accuracy.importlib.util,
        "find_spec",
        lambda name, *rest: None if name in accuracy.PACKAGES else find_spec(name, *rest),
    )
    monkeypatch.setattr(data_sets, "SIMULATED", (("sysid-quad-x", "ardupilot", 100.0),))
    monkeypatch.setattr(sys, "argv", ["accuracy.py", "--short", "--output", str(tmp_path / "table.md")])
    assert accuracy.main() == 0
    table = (tmp_path / "table.md").read_text()
    assert "pysindy not installed" in table
    assert "| flight | quadid-logs | paper | least squares |" in table
    assert capsys.readouterr().out.startswith("Python ")
