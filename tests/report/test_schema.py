"""The schema of result.json comes from the code that writes it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any, Literal

import pytest

from quadid_logs import result_dict, result_schema
from quadid_logs.data.diagnosis import Finding
from quadid_logs.data.result import Result
from quadid_logs.report.schema import schema_of
from tests.conftest import REPOSITORY


class Colour(Enum):
    """Of a thing."""

    RED = "red"


@dataclass
class Thing:
    """One field of each kind."""

    name: str
    size_m: float
    ends: tuple[float, float]
    names: tuple[str, ...]
    by_axis: Mapping[str, int]
    colour: Colour
    side: Literal["left", "right"]
    other: bool | None = None


def test_the_published_schema_is_that_of_the_code() -> None:
    """Written with: python -m quadid_logs.report.schema > docs/result.schema.json."""
    published = (REPOSITORY / "docs" / "result.schema.json").read_text(encoding="utf-8")
    assert json.loads(published) == result_schema()


def test_nothing_is_left_to_fill_in() -> None:
    """A reader of the schema knows no keyword of ours."""
    assert "x-of" not in json.dumps(result_schema())


def test_a_dataclass_has_a_schema() -> None:
    """Numbers may be null, for NaN; what has a default may be missing."""
    schema = schema_of(Thing)
    number = {"type": ["number", "null"]}
    assert schema["required"] == ["name", "size_m", "ends", "names", "by_axis", "colour", "side"]
    assert schema["properties"] == {
        "name": {"type": "string"},
        "size_m": number,
        "ends": {"type": "array", "items": number, "minItems": 2, "maxItems": 2},
        "names": {"type": "array", "items": {"type": "string"}},
        "by_axis": {"type": "object", "additionalProperties": {"type": "integer"}},
        "colour": {"enum": ["red"]},
        "side": {"enum": ["left", "right"]},
        "other": {"anyOf": [{"type": "boolean"}, {"type": "null"}]},
    }


@pytest.mark.parametrize("kind", [set[int], bytes, tuple[int, str]])
def test_a_type_without_a_schema_is_refused(kind: Any) -> None:
    """Rather than described as anything."""
    with pytest.raises(TypeError, match="There is no schema"):
        schema_of(kind)


def test_every_setting_and_every_field_of_a_finding_is_described(usable: Result) -> None:
    """As they are written."""
    properties = result_schema()["properties"]
    assert set(properties["settings"]["properties"]) == set(result_dict(usable)["settings"])
    assert set(properties["findings"]["items"]["properties"]) == {each.name for each in fields(Finding)}
