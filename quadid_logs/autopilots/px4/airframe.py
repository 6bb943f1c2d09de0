"""Which frame a PX4 log describes: CA_ROTORn_* from 1.13 on, the airframe's number before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.actuation.airframe import Airframe, Unknown
from quadid_logs.arrays import FloatArray
from quadid_logs.data.log import FlightLog, whole_number
from quadid_logs.maths.frames import normalised_allocation, torque_matrix

#: control_allocator/module.yaml: the defaults of CA_ROTORn_CT, CA_ROTORn_KM.
_DEFAULT_CT, _DEFAULT_KM = 6.5, 0.05
_MOST_ROTORS: Final = 12
#: No multirotor that anybody logs has longer arms [m].
_LONGEST_ARM_M: Final = 5.0
#: A rotor that leans further than this from the vertical is no lifting rotor of a multirotor.
_UPRIGHT: Final = 0.9


def find_airframe(log: FlightLog) -> Airframe | Unknown:
    """Read CA_ROTORn_*; before 1.13 the geometry was in a mixer file that no log holds.

    The allocation is scaled as in ControlAllocationPseudoInverse.cpp, `updateControlAllocationMatrixScale`.
    """
    count = whole_number(log.parameters.get("CA_ROTOR_COUNT", 0.0))
    if count <= 0:
        return _legacy(whole_number(log.parameters.get("SYS_AUTOSTART", 0.0)))
    rotors = _Rotors.of(log.parameters, min(count, _MOST_ROTORS))
    axis = rotors.axis
    if not (np.isfinite(axis).all() and (-axis[:, 2] > _UPRIGHT * np.linalg.norm(axis, axis=1)).all()):
        return Unknown(remark="Tilted rotors (CA_ROTORn_A*) are not modelled.")
    if not all(np.isfinite(each).all() for each in rotors):
        return Unknown(remark="CA_ROTOR* holds values that are not finite.")
    effectiveness = np.vstack(
        [torque_matrix(rotors.position, np.sign(rotors.ratio_m), 1.0), -np.ones(len(axis))]
    )
    effectiveness[2] = rotors.ratio_m
    effectiveness = effectiveness * rotors.thrust
    if np.linalg.matrix_rank(effectiveness) < 4:
        return Unknown(remark="The rotors in CA_ROTOR* cannot turn the vehicle about all axes.")
    # Airframe, with arms, thrust and moment ratio where they are meant in physical units.
    arms = np.hypot(rotors.position[:, 0], rotors.position[:, 1])
    level = np.abs(rotors.position[:, :2])
    no_arms = bool((np.isclose(level, 1.0) | (level == 0.0)).all()) or float(arms.max()) > _LONGEST_ARM_M
    no_thrust = bool(np.isclose(rotors.thrust, _DEFAULT_CT).all() or (rotors.thrust <= 0.0).any())
    no_ratio = bool(np.isclose(np.abs(rotors.ratio_m), _DEFAULT_KM).all())
    untouched = [
        text
        for is_default, text in (
            (no_arms, "arms of 1 m (CA_ROTORn_PX, PY)"),
            (no_thrust, f"a thrust of {_DEFAULT_CT} (CA_ROTORn_CT)"),
            (no_ratio, f"a torque-to-thrust ratio of {_DEFAULT_KM} (CA_ROTORn_KM)"),
        )
        if is_default
    ]
    remark = f"Not used as calibration, because they still have their defaults: {', '.join(untouched)}."
    return Airframe(
        name=f"{len(arms)} rotors",
        source="CA_ROTORn_PX, PY, KM",
        factors=normalised_allocation(effectiveness),
        position=rotors.position / float(arms.max()) if no_arms else rotors.position,
        spin=np.sign(rotors.ratio_m),
        in_metres=not no_arms,
        max_thrust_n=float("nan") if no_thrust else float(rotors.thrust.mean()),
        torque_to_thrust_m=float("nan") if no_ratio else float(np.abs(rotors.ratio_m).mean()),
        thrust_source="CA_ROTORn_CT",
        refused=(remark,) if untouched else (),
    )


class _Rotors(NamedTuple):
    """CA_ROTORn_P*, CT, KM and A*: places (n_rotors, 3), thrust (n_rotors,), ratio (n_rotors,), axes."""

    position: FloatArray
    thrust: FloatArray
    ratio_m: FloatArray
    axis: FloatArray

    @classmethod
    def of(cls, parameters: Mapping[str, float], count: int) -> _Rotors:
        """Read all rotors, defaults where nothing is logged."""
        prefixes = [f"CA_ROTOR{number}_" for number in range(count)]
        return cls(
            np.array([[parameters.get(f"{prefix}P{axis}", 0.0) for axis in "XYZ"] for prefix in prefixes]),
            np.array([parameters.get(f"{prefix}CT", _DEFAULT_CT) for prefix in prefixes]),
            np.array([parameters.get(f"{prefix}KM", _DEFAULT_KM) for prefix in prefixes]),
            np.array(
                [
                    [parameters.get(f"{prefix}A{axis}", -1.0 if axis == "Z" else 0.0) for axis in "XYZ"]
                    for prefix in prefixes
                ]
            ),
        )


class _Legacy(NamedTuple):
    """A shape of ROMFS/px4fmu_common/init.d/airframes up to 1.13, motors in their order.

    Arms clockwise from the nose [deg], spin +1 counter-clockwise from above.
    """

    numbers: range
    name: str
    angle_deg: tuple[float, ...]
    spin: tuple[float, ...]


_QUAD_SPIN: Final = (1.0, 1.0, -1.0, -1.0)
_HEXA_SPIN: Final = (-1.0, 1.0, -1.0, 1.0, 1.0, -1.0)
_OCTA_SPIN: Final = (-1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0)
_COAX_SPIN: Final = (1.0, -1.0) * 4
_QUAD_X: Final = "quad x", (45.0, -135.0, -45.0, 135.0), _QUAD_SPIN
#: The mixers quad_x and quad_w differ in arm angles only.
_SHAPES: Final = (
    _Legacy(range(4001, 4100), *_QUAD_X),
    _Legacy(range(10016, 10017), *_QUAD_X),
    _Legacy(range(10020, 10021), *_QUAD_X),
    _Legacy(range(5001, 5100), "quad plus", (90.0, -90.0, 0.0, 180.0), _QUAD_SPIN),
    _Legacy(range(6001, 6100), "hexa x", (90.0, -90.0, -30.0, 150.0, 30.0, -150.0), _HEXA_SPIN),
    _Legacy(range(7001, 7100), "hexa plus", (0.0, 180.0, -120.0, 60.0, -60.0, 120.0), _HEXA_SPIN),
    _Legacy(
        range(8001, 8100), "octa x", (22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5), _OCTA_SPIN
    ),
    _Legacy(
        range(9001, 9100), "octa plus", (0.0, 180.0, 45.0, 135.0, -45.0, -135.0, -90.0, 90.0), _OCTA_SPIN
    ),
    _Legacy(
        range(12001, 12100),
        "octaquad x",
        (45.0, -45.0, -135.0, 135.0, -45.0, 45.0, 135.0, -135.0),
        _COAX_SPIN,
    ),
)


def _legacy(airframe: int) -> Airframe | Unknown:
    """Draw a legacy airframe by its number; the mixer's scales are in a file that no log holds."""
    shape = next((each for each in _SHAPES if airframe in each.numbers), None)
    if shape is None:
        return Unknown(
            remark=(
                "Firmware before 1.13 keeps the geometry in a mixer file. The mixer file of airframe "
                f"{airframe} is not known."
            )
        )
    arm = np.deg2rad(shape.angle_deg)
    position = np.column_stack([np.cos(arm), np.sin(arm), np.zeros_like(arm)])
    position[np.abs(position) < 1e-12] = 0.0  # what only rounding keeps from zero
    spin = np.array(shape.spin)
    effectiveness = np.vstack([torque_matrix(position, spin, _DEFAULT_KM), -np.ones(len(spin))])
    return Airframe(
        name=shape.name,
        source=f"SYS_AUTOSTART {airframe}",
        factors=normalised_allocation(effectiveness),
        position=position,
        spin=spin,
        channels=tuple(range(1, len(spin) + 1)),
        channel_source="motor n on output n, as the mixer files before 1.13 have it",
        remarks=(
            "The arms of a symmetric frame are assumed. Before 1.13 the real geometry is in a mixer file, "
            "which the log does not hold.",
        ),
    )
