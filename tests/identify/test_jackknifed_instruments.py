"""What follows from the instruments, each second told by all the others."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from quadid_logs.identify.design import Design, _not_held, build_design
from quadid_logs.identify.first_stage import first_stage
from quadid_logs.identify.instruments import Projection, from_attitude
from quadid_logs.identify.structures import DAMPED

from .vehicles import QUAD, fly, multisine

N_CLUSTERS, LENGTH = 30, 5
CLUSTERS = np.repeat(np.arange(N_CLUSTERS), LENGTH)


def estimates(rng: np.random.Generator) -> tuple[float, float]:
    """Two-stage least squares and its jackknife where gusts of y reach x by feedback; the truth is 2."""
    n = CLUSTERS.size
    instruments = rng.standard_normal((n, 20))
    gusts = rng.standard_normal(N_CLUSTERS)[CLUSTERS] + 0.3 * rng.standard_normal(n)
    x = instruments @ np.full(20, 1.0 / np.sqrt(20.0)) - 0.8 * gusts
    y = 2.0 * x + gusts
    project = Projection.onto(instruments)
    explained, told = project(x[:, np.newaxis])[:, 0], project.jackknifed(x[:, np.newaxis], CLUSTERS)
    told_x = told(x[:, np.newaxis])[:, 0]
    return float(explained @ y / (explained @ x)), float(told_x @ y / (told_x @ x))


@pytest.mark.thorough
def test_instruments_told_by_other_seconds_keep_nothing_of_the_disturbances() -> None:
    """Over 400 draws; two-stage least squares keeps its share of what plain least squares are off by."""
    rng = np.random.default_rng(5)
    found = np.array([estimates(rng) for _ in range(400)])
    plain, jackknifed = np.median(found, axis=0) - 2.0
    assert plain < -0.07
    assert abs(jackknifed) < 0.25 * abs(plain)


def test_what_lies_in_the_instruments_is_told_alike_by_all_seconds() -> None:
    """A column that no disturbance reaches is its own best instrument."""
    instruments = np.random.default_rng(6).standard_normal((CLUSTERS.size, 4))
    columns = instruments @ np.array([[1.0, 2.0], [0.5, 0.0], [0.0, -1.0], [3.0, 0.1]])
    project = Projection.onto(instruments).jackknifed(columns, CLUSTERS)
    np.testing.assert_allclose(project(columns), columns, atol=1e-9)
    assert project.n_instruments == 2


def test_no_more_instruments_are_left_than_columns() -> None:
    """Each more would follow disturbances by chance, and tell nothing."""
    rng = np.random.default_rng(7)
    project = Projection.onto(rng.standard_normal((CLUSTERS.size, 12)))
    columns = rng.standard_normal((CLUSTERS.size, 3))
    assert project.jackknifed(columns, CLUSTERS).n_instruments == 3


@pytest.mark.parametrize("strength", [1.0, 12.0])
def test_each_second_is_told_by_a_fit_to_all_others(strength: float) -> None:
    """Whether a second holds as little of the manoeuvre as the others, or two thirds of it."""
    rng = np.random.default_rng(10)
    instruments = rng.standard_normal((CLUSTERS.size, 2))
    instruments[CLUSTERS == 12] = strength * np.array([[1, 0], [0, 1], [1, 0], [0, 1], [0, 0]])
    column = instruments @ np.array([[1.0], [2.0]]) + rng.standard_normal((CLUSTERS.size, 1))
    by_others = np.empty_like(column)
    for second in range(N_CLUSTERS):
        own = second == CLUSTERS
        by_others[own] = instruments[own] @ np.linalg.lstsq(instruments[~own], column[~own], rcond=None)[0]
    project = Projection.onto(instruments).jackknifed(column, CLUSTERS)
    np.testing.assert_allclose(project(by_others), by_others, atol=1e-9)


def test_a_manoeuvre_flown_within_one_second_is_told_by_that_second() -> None:
    """No other knows of it: told by them alone, nothing of it or anything would be left."""
    rng = np.random.default_rng(8)
    once = np.where(CLUSTERS == 12, rng.standard_normal(CLUSTERS.size), 0.0)
    throughout = rng.standard_normal(CLUSTERS.size)
    x = (3.0 * once + throughout + 0.1 * rng.standard_normal(CLUSTERS.size))[:, np.newaxis]
    told = Projection.onto(np.column_stack([once, throughout])).jackknifed(x, CLUSTERS)(x)
    left = (x - told)[CLUSTERS == 12]
    assert np.linalg.norm(left) < 0.2 * np.linalg.norm(x[CLUSTERS == 12])


@pytest.fixture(scope="module")
def design() -> Design:
    """A flight whose set-points are to be put in."""
    built = build_design(fly(QUAD, multisine(20.0)), 5.0, (DAMPED,))
    assert built is not None
    return built.high_passed(0.3)


def test_setpoints_that_follow_from_the_attitude_command_nothing(design: Design) -> None:
    """An angle controller that holds roll at zero asks for the rate that takes the roll angle back."""
    rng = np.random.default_rng(9)
    phi, theta, psi = rng.standard_normal((3, design.time_s.size))
    commanded = rng.standard_normal(design.time_s.size)
    held = dataclasses.replace(
        design,
        columns=design.columns | {"phi": phi, "theta": theta, "psi": psi},
        instruments=np.column_stack([-4.0 * phi, 4.0 * (commanded - theta), 4.0 * commanded]),
    )
    np.testing.assert_allclose(from_attitude(held), [1.0, 0.5, 0.0], atol=0.05)


def test_a_set_point_that_stands_still_is_no_instrument(design: Design) -> None:
    """What is slow was taken out of it: 1e-16 of it is left, which was scaled up to the others' length."""
    n = design.time_s.size
    still = np.tile([0.3, -0.1, 7.0], (n, 1))
    before = dataclasses.replace(design, instruments=still, high_pass_hz=0.0)
    assert Projection.onto(before.high_passed(0.3).instruments).n_instruments == 0


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_set_points_that_never_move_tell_no_torque(design: Design, value: float) -> None:
    """Of zeros nothing is left to make a basis of, which stopped the analysis."""
    found = first_stage(dataclasses.replace(design, instruments=np.full((design.time_s.size, 3), value)))
    assert found is not None
    assert not found.strong.any()


def test_a_constant_is_no_instrument_once_it_is_high_passed(design: Design) -> None:
    """The trim of a model is its own instrument, and a high pass leaves nothing of it."""
    n = design.time_s.size
    constant = design.high_pass(np.ones((n, 1)), 0.3)
    moving = design.high_pass(np.random.default_rng(10).standard_normal((n, 2)), 0.3)
    assert Projection.onto(np.column_stack([moving, constant])).n_instruments == 2


def test_set_points_that_an_angle_controller_makes_are_no_instruments_without_them(design: Design) -> None:
    """What follows from the attitude was taken out, and nothing else was commanded."""
    held = np.diag([-4.0, -5.0, -2.0])
    attitude = 0.1 * np.random.default_rng(11).standard_normal((2000, 3))
    chunk = dataclasses.replace(
        design.chunks[0], attitude_rad=attitude, reference=np.nextafter(attitude @ held, np.inf)
    )
    assert not _not_held(chunk, held).reference.any()


def test_without_attitude_no_setpoint_is_said_to_hold_one(design: Design) -> None:
    """Nor is any where there are no set-points."""
    columns = {name: column for name, column in design.columns.items() if name not in ("phi", "theta", "psi")}
    without = dataclasses.replace(design, columns=columns, instruments=np.zeros((design.time_s.size, 3)))
    assert not from_attitude(without).any()
    assert not from_attitude(dataclasses.replace(design, instruments=None)).any()
