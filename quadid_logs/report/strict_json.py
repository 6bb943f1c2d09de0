"""Values as strict JSON: no NaN, no infinity, no arrays."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from quadid_logs.data.closed_loop import Estimated
from quadid_logs.data.health import Quantity

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def plain(value: Any) -> Any:
    """Return a value as JSON knows it: figures with their intervals, and dataclasses, by their fields."""
    if isinstance(value, Estimated | Quantity):
        value = value._asdict()
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = fields_of(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Iterable):
        return [plain(item) for item in value]
    return str(value)


def strict_text(content: Mapping[str, Any], *, compact: bool = False) -> str:
    """Return values as strict JSON in ASCII, in one line if `compact`."""
    return json.dumps(plain(content), indent=None if compact else 1, allow_nan=False) + "\n"


def fields_of(value: DataclassInstance) -> dict[str, Any]:
    """Return the fields of a dataclass by name, without copying them."""
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}


def some_fields(value: object, *names: str) -> dict[str, Any]:
    """Return fields of an object that JSON calls by the same names."""
    return {name: getattr(value, name) for name in names}
