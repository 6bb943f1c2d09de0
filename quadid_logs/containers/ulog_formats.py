"""How the rows of ULog topics are laid out: formats, whose fields can be other formats.

Every format is taken apart once, however many others hold it, so that the work
grows with what is written in the file and not with what it unfolds to.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

#: Codes that mean the same to numpy and to `struct`, which is much faster for a single value.
BASIC_TYPES: Final = {
    "int8_t": "<b", "uint8_t": "<B", "int16_t": "<h", "uint16_t": "<H", "int32_t": "<i", "uint32_t": "<I",
    "int64_t": "<q", "uint64_t": "<Q", "float": "<f", "double": "<d", "bool": "<b", "char": "<b",
}  # fmt: skip
_MAX_ROW: Final = 65_533
_MAX_NESTING: Final = 8
#: A log of 250 topics has some 10 000 fields; more than these are laid out by formats that keep changing.
_MOST_FIELDS: Final = 100_000
_FIELD = re.compile(r"([A-Za-z0-9_]+)(?:\[(\d{1,5})\])? ([A-Za-z0-9_]+)\n?")
_FORMAT = re.compile(rf"([A-Za-z0-9_\-/]+):((?:(?:{_FIELD.pattern})?;)*(?:{_FIELD.pattern})?)")


class BrokenMessageError(ValueError):
    """The message's content does not follow the format; never leaves this package."""


class Field(NamedTuple):
    """One field of a format: a basic type or the name of another format; 0 means no array."""

    type_name: str
    n_elements: int
    name: str


class _Layout(NamedTuple):
    """A format with all its padding, and how many formats it holds one inside the other."""

    dtype: np.dtype[np.void]
    depth: int


@dataclass(slots=True, eq=False)
class Formats:
    """The formats that a file has defined so far, taken apart when a topic's layout asks for them.

    `fields` holds the fields of a format as they are written, separated by semicolons.
    """

    fields: dict[str, str] = field(default_factory=dict)
    _layouts: dict[str, _Layout] = field(default_factory=dict)
    _rows: dict[str, tuple[np.dtype[np.void], int]] = field(default_factory=dict)
    _held_by: dict[str, set[str]] = field(default_factory=dict)
    _n_fields: int = 0

    def define(self, definition: str) -> None:
        """Take the definition of a format as ``name:type field;type field;``.

        Raises
        ------
        BrokenMessageError
            If it is none.
        """
        match = _FORMAT.fullmatch(definition)
        if match is None:
            raise BrokenMessageError("a format without a name, or with an invalid field")
        # Most formats are never subscribed: only their grammar is checked here.
        if self.fields.get(match[1]) != match[2]:
            self.fields[match[1]] = match[2]
            # Drop the layouts of a format that has changed and of those that hold it; the others stay.
            name = match[1]
            changed = [name]
            while changed:
                each = changed.pop()
                self._layouts.pop(each, None)
                self._rows.pop(each, None)
                changed += self._held_by.pop(each, ())

    def row(self, name: str) -> tuple[np.dtype[np.void], int]:
        """Return the structured dtype of a topic's row and the row's size with padding at the end.

        Nested types become nested dtypes, arrays sub-arrays; padding at the end is
        left out because the autopilot does not write it.

        Raises
        ------
        BrokenMessageError
            If a format is missing, contains itself, or describes more bytes than a
            message can have, or if the formats of the file change all the time.
        """
        if name not in self._rows:
            full = self._layout(name, ()).dtype
            # A row's dtype without the padding at its end.
            kept = list(full.names or ())
            while kept and kept[-1].startswith("_padding"):
                kept.pop()
            fields: Any = full.fields
            if not kept:
                raise BrokenMessageError(f"{name} has no field")
            end = fields[kept[-1]][1] + fields[kept[-1]][0].itemsize
            self._rows[name] = (
                np.dtype(
                    {
                        "names": kept,
                        "formats": [fields[part][0] for part in kept],
                        "offsets": [fields[part][1] for part in kept],
                        "itemsize": end,
                    }
                ),
                full.itemsize,
            )
        return self._rows[name]

    def _layout(self, name: str, outer: tuple[str, ...]) -> _Layout:
        """Return one format, which the `outer` ones hold."""
        known = self._layouts.get(name)
        if known is None:
            if name not in self.fields or name in outer or len(outer) >= _MAX_NESTING:
                raise BrokenMessageError(f"no usable format {name!r}")
            names: list[str] = []
            seen: set[str] = set()
            types: list[np.dtype[np.generic]] = []
            size, depth = 0, 1
            for type_name, n_elements, field_name in self._fields(name):
                element: np.dtype[np.generic]
                if type_name in BASIC_TYPES:
                    element = np.dtype(BASIC_TYPES[type_name])
                else:
                    self._held_by.setdefault(type_name, set()).add(name)
                    inner = self._layout(type_name, (*outer, name))
                    element, depth = inner.dtype, max(depth, 1 + inner.depth)
                size += element.itemsize * max(1, n_elements)
                # A field without bytes would let a small file describe an endless row.
                if size > _MAX_ROW or not element.itemsize or field_name in seen:
                    raise BrokenMessageError(f"format {name!r} is impossible")
                names.append(field_name)
                seen.add(field_name)
                types.append(np.dtype((element, (n_elements,))) if n_elements else element)
            known = self._layouts[name] = _Layout(np.dtype(list(zip(names, types, strict=True))), depth)
        if len(outer) + known.depth > _MAX_NESTING:
            raise BrokenMessageError(f"no usable format {name!r}")
        return known

    def _fields(self, name: str) -> list[Field]:
        """Return the fields of a format, whose grammar was checked when it was defined."""
        if self._n_fields > _MOST_FIELDS:
            raise BrokenMessageError("formats that keep changing")
        parts = [part for part in self.fields[name].split(";") if part]
        self._n_fields += len(parts)
        found = [_FIELD.fullmatch(part) for part in parts]
        return [Field(match[1], int(match[2] or 0), match[3]) for match in found if match]
