"""The paper's experiment: facts that were known before this code."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.simulator.paper_experiment import (
    PUBLISHED_B,
    SAMPLE_S,
    run_experiment,
)
from quadid_logs.simulator.paper_page import angle_turned, figures, page_text, windows_csv


@pytest.fixture(scope="module")
def experiment():
    """All runs and estimates."""
    return run_experiment()


def test_the_papers_convention_gives_the_known_values(experiment):
    """B11 of the windows k = 0, 5, 10, 20, as measured independently."""
    found = experiment.increments.B[[0, 5, 10, 20], 0, 0]
    np.testing.assert_allclose(found, [27.67, 24.99, 22.43, 25.30], atol=0.005)


def test_one_axis_at_a_time_has_rank_one_and_zeros_elsewhere(experiment):
    """The minimum-norm solution leaves A and the rest of B at zero."""
    for estimate in (experiment.increments, experiment.exact):
        assert np.all(estimate.rank == 1)
        assert np.abs(estimate.A).max() < 1e-14
        assert np.all(estimate.B[:, ~np.eye(3, dtype=bool)] == 0.0)


def test_all_axes_at_once_with_the_true_derivative_return_the_truth(experiment):
    """Rank 6, and A and B to 1e-8 in every window but the first, which begins at rest."""
    estimate = experiment.together_exact
    assert estimate.rank[0, 0] == 5
    assert np.all(estimate.rank[1:] == 6)
    A, B = experiment.true_A, experiment.true_B
    shape = estimate.B[1:].shape
    np.testing.assert_allclose(estimate.B[1:], np.broadcast_to(B, shape), atol=1e-8 * B.max())
    np.testing.assert_allclose(estimate.A[1:], np.broadcast_to(A, shape), atol=1e-8)


def test_the_published_diagonal_is_increments_per_sample(experiment):
    """Within a quarter of Ts / I on every axis, and far from 1 / I."""
    ratio = np.diagonal(np.array(PUBLISHED_B)) / np.diagonal(experiment.true_B)
    np.testing.assert_allclose(ratio, SAMPLE_S, rtol=0.25)


def test_the_page_tells_the_truth_and_the_rank(experiment):
    """The page names J^-1, the rank, and shows every element of [A B]."""
    text = page_text(experiment)
    assert "125.00, 125.00, 100.00" in text
    assert "rank 1 of 6" in text
    assert all(f"| {letter}{i}{j} |" in text for letter in "AB" for i in "123" for j in "123")


def test_every_window_is_in_the_table(experiment):
    """One line per window and estimate."""
    n_windows = len(experiment.exact.B)
    assert len(windows_csv(experiment).splitlines()) == 1 + 4 * n_windows


@pytest.mark.thorough
def test_the_figures_are_png(experiment):
    """Three PNG files, the same in every run."""
    first, second = figures(experiment), figures(experiment)
    assert set(first) == {"fig4.png", "windows.png", "tables.png"}
    assert all(content.startswith(b"\x89PNG") for content in first.values())
    assert first == second


def test_an_axis_that_is_not_excited_does_not_turn(experiment):
    """Fig. 4 showed it jump between 0 and 6.28 rad while the other one turned past half a turn."""
    for axis, run in enumerate(experiment.single):
        idle = np.delete(angle_turned(run.quaternion), axis, axis=1)
        np.testing.assert_allclose(idle, 0.0, atol=1e-9)


def test_the_angle_turned_is_the_integral_of_the_rate(experiment):
    """Over more than one turn, with I theta'' = 0.01 sin t from rest: theta = 0.01 / I (t - sin t)."""
    for axis, run in enumerate(experiment.single):
        expected = 0.01 * experiment.true_B[axis, axis] * (run.time_s - np.sin(run.time_s))
        assert expected[-1] > 2.0 * np.pi
        np.testing.assert_allclose(angle_turned(run.quaternion)[:, axis], expected, atol=1e-6)
