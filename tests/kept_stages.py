"""Stages of an analysis that many tests ask for with the same flight: each is worked out once for all.

What they return is kept by the content of what they are given, not by the file that it came from: a log that
the command line reads, a page shows and a tuning begins with is identified once. What is patched is not asked
from what is kept.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache, wraps
from types import FunctionType, ModuleType
from typing import Any, Final
from unittest.mock import patch
from weakref import WeakSet

import numpy as np
import pytest

from tests.kept import Shelf, modules_behind

#: What is kept, by kind: the module behind it.
STAGES: Final = {
    "identified": "quadid_logs.identify",
    "loops": "quadid_logs.control.closed_loop",
    "tuned-axes": "quadid_logs.tuning",
}
#: Where a patch changes what the stages return; who calls them may be patched.
_INSIDE: Final = ("quadid_logs.identify", "quadid_logs.control.closed_loop", "quadid_logs.control.recommend")
#: Whose calls of the stages are asked from what is kept.
_CALLERS: Final = ("quadid_logs", "tests", "benchmarks", "study")
_PATCHES: Final[WeakSet[pytest.MonkeyPatch]] = WeakSet()
_TOLD: frozenset[str] = frozenset()


class _Hashed:
    """A file of which only the hash is wanted."""

    def __init__(self) -> None:
        self.hash = hashlib.sha256()

    def write(self, part: Any) -> int:
        self.hash.update(part)
        return memoryview(part).nbytes


class _Content(pickle.Pickler):
    """Writes equal things equally, whether their parts are the same objects or copies; functions, too."""

    def __init__(self, file: _Hashed) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.fast = True

    def reducer_override(self, each: Any) -> Any:
        # However it lies in memory: what was kept lies as it likes.
        if isinstance(each, np.ndarray) and not each.dtype.hasobject:
            # SHA-256 is what processors have instructions for; a copy in the pickle would take as long again.
            read = hashlib.sha256(np.ascontiguousarray(each).reshape(-1).view(np.uint8))
            return tuple, (each.dtype.str, each.shape, read.digest())
        if not isinstance(each, FunctionType):
            return NotImplemented
        closed = tuple(cell.cell_contents for cell in each.__closure__ or ())
        where = each.__code__.co_firstlineno
        return tuple, (each.__module__, each.__qualname__, where, closed, each.__defaults__)


def content_key(*given: Any) -> bytes:
    """Return a hash of the content of anything."""
    hashed = _Hashed()
    _Content(hashed).dump(given)
    return hashed.hash.digest()


def watch_patches() -> None:
    """Note who patches."""
    setattr_of = pytest.MonkeyPatch.setattr

    @wraps(setattr_of)
    def noted(own: pytest.MonkeyPatch, *given: Any, **named: Any) -> None:
        _PATCHES.add(own)
        setattr_of(own, *given, **named)

    pytest.MonkeyPatch.setattr = noted  # type: ignore[method-assign]


def is_patched() -> bool:
    """Say whether something inside of the stages is patched now."""
    changed = (one for each in _PATCHES for one, _name, _before in each._setattr)
    names = {
        one.__name__ if isinstance(one, ModuleType) else getattr(one, "__module__", None) for one in changed
    }
    ours = {name for name in names if name is not None and name.startswith("quadid_logs.")}
    return bool(ours) and not ours.isdisjoint(inside())


@cache
def inside() -> frozenset[str]:
    """Return all modules in which a patch changes what the stages return."""
    return _TOLD or frozenset(modules_behind(*_INSIDE))


def tell_inside(modules: Iterable[str]) -> None:
    """Take them from a process that has read the code: each would read it once more."""
    global _TOLD
    _TOLD = frozenset(modules)


@contextmanager
def kept_stages(shelves: Mapping[str, Shelf]) -> Iterator[None]:
    """Keep what the stages of every analysis and tuning return."""
    from quadid_logs import identify, pipeline, tuning  # noqa: F401 - whoever calls the stages is loaded
    from quadid_logs.control import closed_loop

    def kept(kind: str, work: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(work)
        def asked(*given: Any, **named: Any) -> Any:
            if is_patched():
                return work(*given, **named)
            return shelves[kind].get(content_key(given, named), lambda: work(*given, **named))

        return asked

    work = tuning.tune_axes

    def of_one(axis: str, known: Any, given: tuple[Any, ...], named: Mapping[str, Any]) -> Any:
        key = content_key(_as_known(known), given, named)
        return shelves["tuned-axes"].get(key, lambda: work({axis: known}, *given, **named)[axis])

    @wraps(work)
    def axis_by_axis(axes: Mapping[str, Any], *given: Any, **named: Any) -> Any:
        # Filters are of all axes.
        if is_patched() or named.get("filters") is not None:
            return work(axes, *given, **named)
        return {axis: of_one(axis, known, given, named) for axis, known in axes.items()}

    # Not by pytest's patches, which say that a test changed something.
    with ExitStack() as patched:
        patched.enter_context(patch.object(tuning, "tune_axes", axis_by_axis))
        for kind, stage in (("identified", identify.identify), ("loops", closed_loop.close_loop)):
            # Tests and benchmarks hold them by name, too.
            for module in [one for name, one in sys.modules.items() if name.startswith(_CALLERS)]:
                if getattr(module, stage.__name__, None) is stage:
                    patched.enter_context(patch.object(module, stage.__name__, kept(kind, stage)))
        yield


def _as_known(axis: Any) -> tuple[Any, ...]:
    """Return all that decides the gains of an axis; not where its log lay, nor how long its analysis took."""
    case = replace(axis.case, log=replace(axis.case.log, path=""))
    result, *rest = axis.rebuild.args
    flown = result.closed_loop
    return case, axis.model, axis.off_nominal, None if flown is None else flown.controllers, rest
