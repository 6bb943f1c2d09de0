"""Which effects count as seen: beyond chance, and much of what the model leaves."""

from __future__ import annotations

import numpy as np
import pytest

from quadid_logs.data.model import EffectCheck, StructuralCheck
from quadid_logs.identify.structural import seen_effects

ROLL, YAW = 0, 2


def check(*effects: EffectCheck) -> StructuralCheck:
    nothing = np.zeros((0, 3))
    return StructuralCheck(
        effects=effects,
        timing=None,
        flight_gain=nothing,
        flight_half_width=nothing,
        persistence=np.zeros(3),
        spread=np.zeros(3),
        feedback=np.zeros(3),
    )


def dead_zone(axis: int, *, explained: float, statistic: float = 100.0) -> EffectCheck:
    return EffectCheck(axis=axis, effect="threshold", statistic=statistic, explained=explained, shift=0.2)


def test_a_dead_zone_that_explains_a_third_is_not_seen_alone() -> None:
    """Without set-points, small torques are answers to gusts and seem to have less effect."""
    assert not seen_effects(check(dead_zone(YAW, explained=0.32)), YAW)


def test_it_is_seen_where_another_axis_shows_it_clearly() -> None:
    """All axes have the same rotors."""
    yaw = dead_zone(YAW, explained=0.32)
    assert seen_effects(check(yaw, dead_zone(ROLL, explained=0.9)), YAW) == [yaw]


@pytest.mark.parametrize("weak", [{"explained": 0.2}, {"explained": 0.32, "statistic": 40.0}])
def test_it_must_be_beyond_chance_on_its_own_axis(weak: dict[str, float]) -> None:
    """What explains little, or might be chance, is no dead zone wherever else one is."""
    assert not seen_effects(check(dead_zone(YAW, **weak), dead_zone(ROLL, explained=0.9)), YAW)
