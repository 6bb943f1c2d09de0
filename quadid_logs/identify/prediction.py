"""How a model predicts a flight that it was not fitted to: another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.flight import FlightData
from quadid_logs.data.model import Actuator, FitSeries, Model, ThrustCurve, Validation
from quadid_logs.errors import EmptyLogError
from quadid_logs.identify.design import Design, build_design
from quadid_logs.identify.rotors import Rotors, rotors_known, with_lag_on_rotors
from quadid_logs.identify.structures import Structure
from quadid_logs.identify.terms import Term
from quadid_logs.identify.thrust_curve import with_expo
from quadid_logs.identify.validate import validate


def predict_flight(
    model: Model, terms: Sequence[Term], data: FlightData, curve: ThrustCurve | None = None
) -> tuple[Validation, FitSeries]:
    """Hold a model against a flight of which nothing is fitted, all of it held out.

    Parameters
    ----------
    model : Model
    terms : sequence of Term
        Those of its regressors, in their order.
    data : FlightData
        Of the other flight, its torque in the unit of the model's inputs.
    curve : ThrustCurve, optional
        Of the flight that the model is from: the torque of the other is rebuilt by it.

    Returns
    -------
    Validation, FitSeries
        As `validate` gives them for the model's own flight; the slow motion that air and trim bring counts
        against neither the acceleration nor the high-passed rates.

    Raises
    ------
    EmptyLogError
        If the flight lacks a regressor of the model, or no segment is as long as the filters reach.
    """
    if curve is not None and rotors_known(data):
        data = with_expo(data, curve.expo if curve.corrected else curve.assumed)
    structure = Structure(
        model.structure,
        model.states,
        tuple(terms),
        model.targets,
        "as published" if model.actuator is None else "equation by equation",
    )
    design = build_design(data, model.smoothing_hz, (structure,)) if data.segments else None
    if design is None:
        raise EmptyLogError(
            "The other flight has no segment that is long enough to predict.",
            hint="See `quadid-log info LOG`.",
        )
    everything = np.ones(design.time_s.shape, dtype=np.bool_)
    design = replace(design, held_out=everything, edge=~everything)
    known = {*design.columns, *design.torque.symbols}
    if missing := [symbol for symbol in structure.regressors if symbol not in known]:
        raise EmptyLogError(f"The other flight does not hold {', '.join(missing)!a}.")
    n_disturbances = len(design.disturbances(structure))
    return validate(
        design,
        structure,
        np.column_stack([model.A, model.B]),
        _torque(design, structure, model.actuator, data),
        # Air speed and products of rates that the fit set aside were those of its own flight.
        disturbance=np.zeros((len(model.targets), n_disturbances)),
        high_pass_hz=0.0 if model.band is None else float(model.band.low_hz[0]),
    )


def _torque(design: Design, structure: Structure, actuator: Actuator | None, data: FlightData) -> FloatArray:
    """Return the torque as the structure takes it: behind rotors, lag and delay, or as logged."""
    if actuator is None:
        return design.torque.as_logged()
    if np.isfinite(actuator.lag_up_s) and rotors_known(data) and data.input is not None:
        design = with_lag_on_rotors(design, data.input, Rotors(actuator.lag_up_s, actuator.lag_down_s))
    return design.torque.behind(actuator.lag_s, actuator.delay_s, structure.inputs)
