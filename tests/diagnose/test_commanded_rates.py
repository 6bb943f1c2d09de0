"""A torque that leads to a rate: what a rate loop makes of its command, and what air makes of a torque."""

from __future__ import annotations

from dataclasses import replace

import pytest

from quadid_logs.data.model import Model
from quadid_logs.data.result import Result
from quadid_logs.diagnose.structural_findings import find_in_structure
from tests.synthetic_results import usable_result


def damped(achieved: bool) -> Result:
    """A vehicle that a unit of torque about roll would turn at 1.07 rad/s, within half a second."""
    result = usable_result()
    model = result.identification.recommended
    assert isinstance(model, Model)
    found = {("p_dot", "p"): (-2.4, -2.5, -2.3), ("p_dot", "L"): (2.58, 2.5, 2.7)}
    parameters = tuple(
        replace(one, value=found[place][0], ci95=found[place][1:])
        if (place := (one.target, one.regressor)) in found
        else one
        for one in model.parameters
    )
    models = (replace(model, parameters=parameters),)
    assert result.data.input is not None
    return replace(
        result,
        identification=replace(result.identification, models=models),
        data=replace(result.data, input=replace(result.data.input, achieved=achieved)),
    )


@pytest.mark.parametrize(("achieved", "named"), [(False, True), (True, False)])
def test_what_the_motors_gave_is_no_commanded_rate(achieved: bool, named: bool) -> None:
    """Per newton metre a rate near one is chance: a heavy vehicle with much drag has it."""
    result = damped(achieved)
    codes = [one.code for one in find_in_structure(result.data, result.identification)]
    assert ("QL521" in codes) == named
