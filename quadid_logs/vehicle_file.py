"""Read known properties of a vehicle from a TOML file."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.data.vehicle import Rotor, Vehicle
from quadid_logs.errors import VehicleFileError
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

#: Upper bounds for any multirotor. A larger value has the wrong unit.
_LARGEST = {
    "mass_kg": (250.0, "Give kg, not g."),
    "arm_length_m": (10.0, "Give m, not mm."),
    "max_thrust_n": (2000.0, "Give N for one rotor, not g."),
    "torque_to_thrust_m": (1.0, "Give N m of torque per N of thrust; 0.005 to 0.05 m is typical."),
}
_POSITIVE = tuple(_LARGEST)
_KEYS = ("name", *_POSITIVE, "rotor", "thrust_curve", "inertia_kg_m2")
_ROTOR_KEYS = ("position_m", "spin")
_SPINS = ("ccw", "cw")
#: Largest number of rotors; a longer list is a mistake.
_MOST_BYTES, _MOST_ROTORS = 1_000_000, 64


def read_vehicle(path: Path) -> Vehicle:
    r"""Read a vehicle file.

    Parameters
    ----------
    path : Path
        TOML file. All keys are optional: ``name``; ``mass_kg``; ``arm_length_m`` or ``[[rotor]]`` tables
        (``position_m = [x, y, z]`` in FRD [m], ``spin = "ccw"`` or ``"cw"`` seen from above);
        ``max_thrust_n`` or ``thrust_curve`` ([[command, thrust in N], ...]), both for one rotor;
        ``torque_to_thrust_m``; ``inertia_kg_m2`` (three moments, ``nan`` for an unknown moment, or a
        symmetric 3 by 3 tensor).

    Returns
    -------
    Vehicle

    Raises
    ------
    VehicleFileError
        If the file cannot be read, is not TOML, or holds an unknown key. Also if a value has the wrong type,
        is not positive, or is too large for any vehicle.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from quadid_logs import read_vehicle
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "quad.toml")
    ...     _ = file.write_text("mass_kg = 1.5\narm_length_m = 0.225")
    ...     vehicle = read_vehicle(file)
    >>> vehicle.mass_kg, vehicle.arm_length_m
    (1.5, 0.225)
    """
    content = _toml(path)
    _refuse_unknown(path, content, _KEYS)
    if "max_thrust_n" in content and "thrust_curve" in content:
        raise _wrong(path, "max_thrust_n and thrust_curve describe the same thing", "Give one of them.")
    if "arm_length_m" in content and "rotor" in content:
        raise _wrong(path, "arm_length_m and [[rotor]] describe the same thing", "Give one of them.")
    name = content.get("name", "")
    if not isinstance(name, str):
        raise _wrong(path, "name must be text", 'For example: name = "my quad".')
    numbers = {key: _positive(path, key, content[key]) for key in _POSITIVE if key in content}
    # The rotors.
    tables = content.get("rotor", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise _wrong(path, "rotor must be a list of tables", "Write [[rotor]] above each.")
    if len(tables) > _MOST_ROTORS:
        raise _wrong(path, f"{len(tables)} rotors are too many", f"At most {_MOST_ROTORS}.")
    rotors = []
    for table in tables:
        _refuse_unknown(path, table, _ROTOR_KEYS)
        missing = [key for key in _ROTOR_KEYS if key not in table]
        if missing:
            raise _wrong(
                path, f"a [[rotor]] lacks {' and '.join(missing)}", "Give position_m = [x, y, z] and spin."
            )
        if table["spin"] not in _SPINS:
            raise _wrong(
                path, f"spin is {printable(table['spin'], 40)!r}", 'Give "ccw" or "cw", seen from above.'
            )
        place_hint = "Give [x, y, z] in metres: to the front, to the right, down."
        position = _array(path, "position_m", table["position_m"], ((3,),), place_hint)
        x, y, z = (float(value) for value in position)
        rotors.append(Rotor(position_m=(x, y, z), spin=table["spin"]))
    thrust_curve = None
    if "thrust_curve" in content:
        hint = "Give [[command, thrust in N], ...] with rising commands from 0 to 1."
        thrust_curve = _array(path, "thrust_curve", content["thrust_curve"], ((-1, 2),), hint)
        command, thrust = thrust_curve.T
        rising = len(command) >= 2 and (np.diff(command) > 0.0).all() and (np.diff(thrust) >= 0.0).all()
        if not rising or (thrust_curve < 0.0).any() or command[-1] > 1.0:
            raise _wrong(path, "thrust_curve does not rise from 0", hint)
    return Vehicle(
        name=name,
        rotors=tuple(rotors),
        thrust_curve=thrust_curve,
        inertia_kg_m2=_inertia(path, content["inertia_kg_m2"]) if "inertia_kg_m2" in content else None,
        path=str(path),
        **numbers,
    )


def _toml(path: Path) -> dict[str, Any]:
    """Return the parsed file."""
    try:
        with path.open("rb") as file:
            raw = file.read(_MOST_BYTES + 1)
        if len(raw) > _MOST_BYTES:
            raise _wrong(path, "the file is far too long for a vehicle file", "Is it the right file?")
        return tomllib.loads(raw.decode("utf-8"))
    except OSError as error:
        raise VehicleFileError(
            f"Cannot read the vehicle file {printable(path)}: {error.strerror}."
        ) from error
    except (ValueError, RecursionError) as error:
        # Of ValueError: no TOML, no UTF-8, or an integer of thousands of digits.
        raise _wrong(
            path, f"it is not valid TOML ({printable(error)})", "See docs/vehicle.md for an example."
        ) from error


def _wrong(path: Path, what: str, hint: str) -> VehicleFileError:
    """Return the error of a malformed file."""
    return VehicleFileError(f"Vehicle file {printable(path)}: {what}.", hint=hint)


def _refuse_unknown(path: Path, content: Mapping[str, Any], keys: Iterable[str]) -> None:
    """Raise if there is an unknown key: a misspelt key would be ignored without notice."""
    known = tuple(keys)
    for key in content:
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1)
            hint = f"Did you mean {close[0]}?" if close else f"Known keys: {', '.join(known)}."
            raise _wrong(path, f"there is no key {printable(key, 60)!r}", hint)


def _positive(path: Path, key: str, value: Any) -> float:
    """Return a finite positive number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong(path, f"{key} must be a number, not {printable(value, 60)!r}", "Leave the unit out.")
    try:
        number = float(value)
    except OverflowError:
        raise _wrong(path, f"{key} has more digits than a number can have", "Is it the right file?") from None
    if not (math.isfinite(number) and number > 0.0):
        raise _wrong(
            path, f"{key} is {number:g}, but must be above 0", "Leave the key out if it is not known."
        )
    largest, hint = _LARGEST[key]
    if number > largest:
        raise _wrong(path, f"{key} is {number:g}, but no multirotor has more than {largest:g}", hint)
    return number


def _array(path: Path, key: str, value: Any, shapes: tuple[tuple[int, ...], ...], hint: str) -> FloatArray:
    """Return an array of finite numbers of one of the shapes; -1 stands for any length."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise _wrong(path, f"{key} must hold numbers only", hint) from None
    fits = any(
        array.ndim == len(shape)
        and all(want in (-1, have) for want, have in zip(shape, array.shape, strict=True))
        for shape in shapes
    )
    if not fits or not np.isfinite(array).all():
        raise _wrong(path, f"{key} has the wrong shape or a number that is not finite", hint)
    return array


def _inertia(path: Path, value: Any) -> FloatArray:
    """Return the tensor (3, 3): symmetric and positive definite."""
    hint = "Give [Ixx, Iyy, Izz] or a symmetric 3 by 3 tensor in kg m^2. Write nan for an unknown moment."
    # Which of three moments are nan; nothing where none is, or all are.
    unknown = (
        [isinstance(each, float) and math.isnan(each) for each in value] if isinstance(value, list) else []
    )
    unknown = unknown if len(unknown) == len(AXES) and any(unknown) and not all(unknown) else []
    moments = (
        [1.0 if is_unknown else each for is_unknown, each in zip(unknown, value, strict=True)]
        if unknown
        else value
    )
    given = _array(path, "inertia_kg_m2", moments, ((3,), (3, 3)), hint)
    tensor = np.diag(given) if given.ndim == 1 else given
    if not np.allclose(tensor, tensor.T, rtol=1e-9, atol=0.0) or (np.linalg.eigvalsh(tensor) <= 0.0).any():
        raise _wrong(path, "inertia_kg_m2 is not symmetric and positive definite", hint)
    tensor = np.array(tensor, dtype=np.float64)
    tensor[np.flatnonzero(unknown), np.flatnonzero(unknown)] = np.nan
    return tensor
