"""The schema of result.json: what json.py writes by hand is described by hand, everything else by the code.

`result.schema.json` beside this module describes the objects that have keys of their own. Where it says
``{"x-of": NAME}``, the schema of that name comes from a dataclass, a type or a registry, and what stands
beside it (descriptions, patterns) is added. So a name of an autopilot that a program brings along validates,
and a field that a dataclass gains is in the schema.
"""

from __future__ import annotations

import enum
import json
import sys
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from importlib import resources
from typing import Any, Final, Literal, Union, get_args, get_origin, get_type_hints

from quadid_logs.autopilots import formats, known
from quadid_logs.data import health
from quadid_logs.data.controller import FilterPlace, VersionRead
from quadid_logs.data.diagnosis import Finding, Verdict
from quadid_logs.data.log import LostBytes
from quadid_logs.data.model import Parameter, Validation
from quadid_logs.data.result import PooledLog
from quadid_logs.data.settings import Settings
from quadid_logs.report.provenance import Provenance

_OF: Final = "x-of"
#: NaN and infinity are null in JSON.
_NUMBER: Final = {"type": ["number", "null"]}
_SIMPLE: Final[Mapping[Any, dict[str, Any]]] = types.MappingProxyType(
    {
        bool: {"type": "boolean"},
        int: {"type": "integer"},
        str: {"type": "string"},
        float: _NUMBER,
        object: {},
    }
)


def result_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of result.json, with the autopilots and formats of this program.

    Returns
    -------
    dict

    Examples
    --------
    >>> from quadid_logs import result_schema
    >>> "usd" in result_schema()["properties"]["log"]["properties"]["format"]["enum"]
    True
    """
    written = resources.files("quadid_logs.report").joinpath("result.schema.json").read_text(encoding="utf-8")
    filled: dict[str, Any] = _filled(json.loads(written))
    return filled


def schema_of(kind: Any) -> dict[str, Any]:
    """Return the schema of a type as result.json writes it.

    Parameters
    ----------
    kind : type
        A dataclass, an enumeration, a `Literal`, or made of text, numbers, sequences, mappings and these.

    Returns
    -------
    dict
        Of a dataclass the fields without a default are required.

    Raises
    ------
    TypeError
        If it is of another type.

    Examples
    --------
    >>> schema_of(tuple[float, ...])
    {'type': 'array', 'items': {'type': ['number', 'null']}}
    """
    if kind in _SIMPLE:
        return dict(_SIMPLE[kind])
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        properties = {each.name: schema_of(hints[each.name]) for each in fields(kind)}
        required = [
            each.name for each in fields(kind) if each.default is MISSING and each.default_factory is MISSING
        ]
        return {"type": "object", "properties": properties, "required": required}
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return {"enum": [each.value for each in kind]}
    arguments = get_args(kind)
    origin = get_origin(kind)
    if origin is Literal:
        return {"enum": [*arguments]}
    if origin in (Union, types.UnionType):
        return {
            "anyOf": [{"type": "null"} if each is types.NoneType else schema_of(each) for each in arguments]
        }
    if origin is tuple and arguments[-1] is Ellipsis:
        return {"type": "array", "items": schema_of(arguments[0])}
    if origin is tuple and len(set(arguments)) == 1:
        n = len(arguments)
        return {"type": "array", "items": schema_of(arguments[0]), "minItems": n, "maxItems": n}
    if origin is Mapping:
        values = schema_of(arguments[1])
        return {"type": "object", **({"additionalProperties": values} if values else {})}
    raise TypeError(f"There is no schema of {kind}.")


def _settings() -> dict[str, Any]:
    """Return the schema of ``settings``, where those of all stages stand side by side."""
    properties: dict[str, Any] = {}
    for name, value in schema_of(Settings)["properties"].items():
        properties |= value.get("properties", {name: value})
    return {"type": "object", "properties": properties}


def _one_of(names: Iterable[str]) -> dict[str, Any]:
    """Return the schema of one of some names, each once."""
    return {"enum": [*dict.fromkeys(names)]}


#: What `result.schema.json` may name.
_KNOWN: Final[Mapping[str, Callable[[], dict[str, Any]]]] = types.MappingProxyType(
    {
        "autopilots": lambda: _one_of(each.name for each in known()),
        "formats": lambda: _one_of(each.name for each in formats()),
        "filter places": lambda: schema_of(FilterPlace),
        "finding": lambda: schema_of(Finding),
        "health level": lambda: schema_of(health.Level),
        "lost bytes": lambda: schema_of(LostBytes),
        "parameter": lambda: schema_of(Parameter),
        "pooled log": lambda: schema_of(PooledLog),
        "provenance": lambda: schema_of(Provenance),
        "settings": _settings,
        "validation": lambda: schema_of(Validation),
        "verdict": lambda: schema_of(Verdict),
        "version read": lambda: schema_of(VersionRead),
    }
)


def _filled(written: Any) -> Any:
    """Return a schema with what the code knows in its places."""
    if isinstance(written, list):
        return [_filled(each) for each in written]
    if not isinstance(written, dict):
        return written
    by_hand = {name: _filled(value) for name, value in written.items() if name != _OF}
    return _added(_KNOWN[written[_OF]](), by_hand) if _OF in written else by_hand


def _added(schema: dict[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema with more in it, which wins; objects in both are merged."""
    both = {
        name: _added(schema[name], value)
        for name, value in more.items()
        if isinstance(value, dict) and isinstance(schema.get(name), dict)
    }
    return {**schema, **more, **both}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(result_schema(), indent=2, ensure_ascii=False) + "\n")
