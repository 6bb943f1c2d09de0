"""What to run on a result's log: the log as it was named, with the options that chose what was read of it."""

from __future__ import annotations

import re
from typing import Final

from quadid_logs.commands import LOG, NEXT_LOG, PROGRAM, command, named, quoted
from quadid_logs.data.result import Result

#: In texts that know no log: advice of the catalogue and of the autopilots.
_OPEN: Final = re.compile(rf"`{PROGRAM} (\w+) {LOG}`")
_LIKE: Final = re.compile(rf"(?<=--like ){LOG}(?=`)")


def on_log(result: Result, verb: str, *words: object) -> str:
    """Return a command on the log of a result.

    Parameters
    ----------
    result : Result
    verb : str
        One that takes --log, --system and --vehicle.
    *words : object
        What else it is given.

    Returns
    -------
    str
    """
    number = ("--log", result.settings.log) if result.settings.log else ()
    return command(verb, named(result.log.path), *number, *_options(result), *words)


def on_next_log(result: Result, verb: str, *words: object) -> str:
    """Return a command on the log of the next flight of the same vehicle.

    Parameters
    ----------
    result : Result
    verb : str
    *words : object

    Returns
    -------
    str
    """
    return command(verb, NEXT_LOG, *_options(result), *words)


def with_next_log(result: Result) -> str:
    """Return the comparison of this flight with the next one.

    Parameters
    ----------
    result : Result

    Returns
    -------
    str
    """
    number = ("--logs", result.settings.log, 0) if result.settings.log else ()
    return command("compare", named(result.log.path), NEXT_LOG, *number, *_options(result))


def filled(text: str, result: Result) -> str:
    """Return a text with the log in the place of `LOG` in each of its commands.

    Parameters
    ----------
    text : str
    result : Result

    Returns
    -------
    str
    """
    return _OPEN.sub(lambda match: f"`{on_log(result, match[1])}`", like_log(text, result.log.path))


def like_log(text: str, path: str) -> str:
    """Return a text with the log in the place of `LOG` where a plan is to keep what is set on its vehicle.

    Parameters
    ----------
    text : str
    path : str

    Returns
    -------
    str
    """
    return _LIKE.sub(lambda _match: quoted(named(path)), text)


def _options(result: Result) -> tuple[object, ...]:
    """Return what holds for every log of the vehicle."""
    system = ("--system", result.settings.system) if result.settings.system else ()
    described = "" if result.vehicle is None else result.vehicle.path
    return (*system, *(("--vehicle", named(described)) if described else ()))
