"""What to run on a result's log: the log as it was named, with the options of the analysis.

A command without them gives another answer than the page that prints it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from quadid_logs.commands import LOG, NEXT_LOG, PROGRAM, command, named, quoted
from quadid_logs.data.result import Result

_LIKE: Final = re.compile(rf"(?<=--like ){LOG}(?=`)")
_PART: Final = ("--start-s", "--end-s")
_OF_ANY_LOG: Final = ("--system", "--vehicle")
_FIT: Final = (*_OF_ANY_LOG, "--band")
#: The options of an analysis that each verb takes.
_TAKES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "analyze": ("--log", *_FIT, *_PART, "--sample-rate-hz", "--structure", "--window", "--stride"),
        "check": ("--log", *_FIT, *_PART),
        # Its --start-s and --end-s cut both logs, and the next flight has another clock.
        "compare": _FIT,
        "export": ("--log", *_FIT, *_PART, "--sample-rate-hz"),
        "info": ("--log", *_OF_ANY_LOG, *_PART),
        "tune": ("--log", *_FIT, *_PART),
    }
)
#: In texts that know no log: advice of the catalogue and of the autopilots.
_OPEN: Final = re.compile(rf"`{PROGRAM} ({'|'.join(_TAKES)}) {LOG}`")
#: They choose from one log, and mean nothing on the clock of the next one.
_OF_THIS_LOG: Final = frozenset({"--log", *_PART})


def on_log(result: Result, verb: str, *words: object) -> str:
    """Return a command on the log of a result.

    Parameters
    ----------
    verb : str
        One of `_TAKES`.
    *words : object
        What else it is given.
    """
    return command(verb, named(result.log.path), *_options(result, _TAKES[verb]), *words)


def on_next_log(result: Result, verb: str, *words: object) -> str:
    """Return a command on the log of the next flight of the same vehicle."""
    takes = tuple(name for name in _TAKES[verb] if name not in _OF_THIS_LOG)
    return command(verb, NEXT_LOG, *_options(result, takes), *words)


def with_next_log(result: Result) -> str:
    """Return the comparison of this flight with the next one."""
    number = ("--logs", result.settings.log, 0) if result.settings.log else ()
    options = _options(result, _TAKES["compare"])
    return command("compare", named(result.log.path), NEXT_LOG, *number, *options)


def filled(text: str, result: Result) -> str:
    """Return a text with the log in the place of `LOG` in each of its commands."""
    options = tuple(_options(result, ("--log", *_FIT, *_PART)))
    return _OPEN.sub(lambda match: f"`{on_log(result, match[1])}`", like_log(text, result.log.path, options))


def like_log(text: str, path: str, options: Sequence[object] = ()) -> str:
    """Return a text with the log in the place of `LOG` where a plan is to keep what is set on its vehicle.

    Parameters
    ----------
    options : sequence of object
        Of the log, each with its values.
    """
    words = (named(path), *map(str, options))
    return _LIKE.sub(lambda _match: " ".join(map(quoted, words)), text)


def _options(result: Result, takes: tuple[str, ...]) -> Iterator[object]:
    """Yield those of some options that the analysis was made with, each with its values, in that order."""
    values = _chosen(result)
    for name in takes:
        if name in values:
            yield name
            yield from values[name]


def _chosen(result: Result) -> dict[str, tuple[object, ...]]:
    """Return the options that the analysis was made with, by name, with their values."""
    settings = result.settings
    part, fit = settings.align, settings.identify
    described = "" if result.vehicle is None else result.vehicle.path
    numbers = {
        "--log": settings.log,
        "--system": settings.system,
        "--sample-rate-hz": _written(part.sample_rate_hz),
        "--window": fit.window,
        "--stride": fit.stride,
    }
    chosen: dict[str, tuple[object, ...]] = {name: (value,) for name, value in numbers.items() if value}
    for name, time_s in zip(_PART, (part.start_s, part.end_s), strict=True):
        if math.isfinite(time_s):
            chosen[name] = (_written(time_s),)
    if fit.smoothing_hz:
        chosen["--band"] = (_written(fit.high_pass_hz), _written(fit.smoothing_hz))
    if fit.structure:
        chosen["--structure"] = (fit.structure,)
    if described:
        chosen["--vehicle"] = (named(described),)
    return chosen


def _written(value: float) -> float | int:
    """Return a number whose text gives the same number back, without ".0"."""
    return int(value) if float(value).is_integer() else float(value)
