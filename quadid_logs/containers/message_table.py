"""Rows of one message type as columns: what DataFlash files hold, as bytes or as text."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from quadid_logs.arrays import AnyArray, IntArray
from quadid_logs.containers.dataflash_index import MessageDefinition
from quadid_logs.data.log import LostBytes
from quadid_logs.errors import ShapeError


class Unit(NamedTuple):
    """Unit of a column: the logged value times `factor` is in `label`."""

    label: str
    factor: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MessageTable:
    """All rows of one message type, in file order.

    Attributes
    ----------
    name : str
        The vendor's name of the message type.
    columns : mapping of str to ndarray, each of shape (n_rows,) or (n_rows, 32)
        One array per field, in the unit in which the log holds it.
    position : ndarray of int64, shape (n_rows,)
        Byte offset of each row in the file.
    units : mapping of str to Unit
        Unit of the columns for which the log states one.
    """

    name: str
    columns: Mapping[str, AnyArray]
    position: IntArray
    units: Mapping[str, Unit] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for label, values in self.columns.items():
            if len(values) != len(self.position):
                raise ShapeError(
                    f"{self.name}.{label} has {len(values)} rows, but there are {len(self.position)}."
                )

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.position)

    def has(self, *labels: str) -> bool:
        """Say whether all these columns exist."""
        return all(label in self.columns for label in labels)

    def has_numbers(self, *labels: str) -> bool:
        """Say whether all these columns exist and hold one number per row."""
        found = [self.columns.get(label) for label in labels]
        return all(each is not None and each.ndim == 1 and each.dtype.kind in "iuf" for each in found)

    def has_text(self, *labels: str) -> bool:
        """Say whether all these columns exist and hold text."""
        found = [self.columns.get(label) for label in labels]
        return all(each is not None and each.dtype.kind == "U" for each in found)

    def integers(self, label: str) -> IntArray:
        """Return a column of numbers as int64, -1 where it holds no integer of 63 bits."""
        values = self.columns[label]
        if values.dtype.kind == "i":
            return values.astype(np.int64)
        inside = np.abs(values.astype(np.float64)) < 2.0**63  # false for NaN
        return np.where(inside, values, 0).astype(np.int64) - np.where(inside, 0, 1)

    def column(self, field: str) -> AnyArray | None:
        """Return a column that holds one number per row; None where there is none.

        A damaged or foreign definition may turn any column into text.
        """
        return self.columns[field] if self.has_numbers(field) else None

    def named_values(self, names: str, values: str) -> dict[str, float]:
        """Return the last value of each name in two columns; empty where one of them is not there."""
        if not (self.has_text(names) and self.has_numbers(values)):
            return {}
        pairs = zip(self.columns[names].tolist(), self.columns[values].tolist(), strict=True)
        return {name: float(value) for name, value in pairs if name}

    def only(self, labels: Collection[str] | None) -> MessageTable:
        """Return the columns with these labels, all where None."""
        if labels is None:
            return self
        return replace(self, columns={label: v for label, v in self.columns.items() if label in labels})

    def rows(self, mask: AnyArray) -> MessageTable:
        """Return the rows that a mask or an index array selects."""
        return MessageTable(
            name=self.name,
            columns={label: values[mask] for label, values in self.columns.items()},
            position=self.position[mask],
            units=self.units,
        )


class MessageSource(Protocol):
    """A log file whose messages can be read by type."""

    @property
    def path(self) -> str:
        """The file, as the user named it."""

    @property
    def n_bytes(self) -> int:
        """Size of the file [bytes]."""

    @property
    def counts(self) -> Mapping[str, int]:
        """Rows per message type."""

    @property
    def definitions(self) -> Collection[MessageDefinition]:
        """What the file defines."""

    @property
    def lost(self) -> tuple[LostBytes, ...]:
        """What could not be read."""

    def read_messages(
        self, types: Collection[str] | None = None, labels: Collection[str] | None = None
    ) -> dict[str, MessageTable]:
        """Read some columns of some message types, all where None."""

    def first_and_last(self) -> dict[str, MessageTable]:
        """Read the first and the last row of every type."""


#: Damaged numbers may be signalling NaN or near overflow: they pass on as NaN or infinity, silently.
damaged_numbers_pass = partial(np.errstate, invalid="ignore", over="ignore")


def join_tables(tables: list[MessageTable]) -> MessageTable:
    """Join the tables of one message type whose definition changed inside the file.

    Rows come out in file order. A column that one of the definitions lacks is
    NaN there (empty for text), never a made-up zero.

    Parameters
    ----------
    tables : list of MessageTable
        At least one.
    """
    if len(tables) == 1:
        return tables[0]
    position = np.concatenate([table.position for table in tables])
    order = np.argsort(position, kind="stable")
    labels = list(dict.fromkeys(label for table in tables for label in table.columns))
    units: dict[str, Unit] = {}
    for table in tables:
        units.update(table.units)
    return MessageTable(
        name=tables[0].name,
        columns={label: _joined_column(tables, label)[order] for label in labels},
        position=position[order],
        units=units,
    )


def _joined_column(tables: list[MessageTable], label: str) -> AnyArray:
    """Stack one column over all tables; text wins over numbers where the kinds differ."""
    present = [table.columns[label] for table in tables if label in table.columns]
    text = any(values.dtype.kind == "U" for values in present)
    shape = present[0].shape[1:] if all(v.shape[1:] == present[0].shape[1:] for v in present) else ()
    parts = []
    for table in tables:
        values = table.columns.get(label)
        if values is None or values.shape[1:] != shape:
            blank = np.full((table.n_rows, *shape), "" if text else np.nan)
            parts.append(blank)
        else:
            parts.append(values.astype(np.str_) if text else values)
    return np.concatenate(parts)
