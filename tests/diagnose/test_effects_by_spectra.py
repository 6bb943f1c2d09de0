"""What is said of effects that commands tell, and where a fit in time stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quadid_logs.data.catalogue import CATALOGUE
from quadid_logs.data.model import Effect, SpectralFit
from quadid_logs.diagnose.structural_findings import _by_spectra, find_in_structure
from tests.synthetic_results import usable_result

FIT = SpectralFit(
    mean=np.array([100.0, -1.0, 0.03, 0.005, 0.0]),
    covariance=np.eye(5),
    departure=0.03,
    commanded=0.7,
    r2_commanded=0.99,
    n_blocks=20,
    half_width=12.0,
    used=True,
)


@pytest.mark.parametrize(
    ("effects", "levels"),
    [
        (("threshold",), ["info"]),
        (("varying gain",), ["info"]),
        (("threshold", "limit"), ["warning", "warning"]),
        (("threshold", "tilt"), ["info", "info"]),
    ],
)
def test_one_effect_that_the_interval_covers_is_a_note_and_two_may_pass_for_each_other(
    effects: tuple[Effect, ...], levels: list[str]
) -> None:
    """With them the effectiveness is a fifth larger."""
    fit = replace(FIT, effects=effects, shift=0.2)
    assert [each.level for each in _by_spectra((fit,))] == levels


def test_two_effects_that_move_little_are_notes() -> None:
    """By a fiftieth."""
    fit = replace(FIT, effects=("threshold", "limit"), shift=0.02)
    assert {each.level for each in _by_spectra((fit,))} == {"info"}


@pytest.mark.parametrize("known", [True, False])
def test_a_log_of_motors_whose_rotors_are_known_is_not_asked_for_them(*, known: bool) -> None:
    """ "Log the motor outputs, and describe the rotors, where either is missing": neither was."""
    result = usable_result(8.0)
    fits = tuple(replace(FIT, effects=("asymmetry", "threshold"), shift=0.2) for _ in range(3))
    thrust = np.ones((result.data.segments[0].n_samples, 4)) if known else None
    segments = tuple(replace(one, rotor_thrust=thrust) for one in result.data.segments)
    found = find_in_structure(
        replace(result.data, segments=segments), replace(result.identification, spectral=fits)
    )
    advice = {one.advice for one in found if one.code == "QL527"}
    assert advice == {"" if known else CATALOGUE["QL527"].advice}
