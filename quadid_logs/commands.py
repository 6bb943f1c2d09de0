"""Commands as a person pastes them: the one place that writes them, for pages, terminal and files."""

from __future__ import annotations

import os
import re
import shlex
from typing import Final

from quadid_logs.untrusted import printable

PROGRAM: Final = "quadid-log"
#: Stands for a log that is not known, or whose name cannot be shown as it is.
LOG: Final = "LOG"
#: Stands for the log of the next flight.
NEXT_LOG: Final = "NEXT-LOG"
#: No system allows longer paths.
_LONGEST: Final = 4096
#: Inside double quotes a shell of POSIX takes everything else as it stands.
_SPECIAL: Final = re.compile(r'["$`\\!]')
_PLAIN: Final = re.compile(r"[\w@%+=:,./-]+", re.ASCII)
_PLAIN_IN_WINDOWS: Final = re.compile(r"[\w+=:./\\-]+", re.ASCII)


def command(verb: str, *words: object) -> str:
    r"""Return a command that can be pasted.

    Parameters
    ----------
    *words : object
        Arguments and options, each as its text; no shell changes any of them.

    Examples
    --------
    >>> command("tune", "my flights/it's.bin", "--log", 2)
    'quadid-log tune "my flights/it\'s.bin" --log 2'
    """
    return " ".join((PROGRAM, verb, *(quoted(str(word)) for word in words)))


def quoted(word: str, *, windows: bool = os.name == "nt") -> str:
    """Return a word as the shells of this system read it.

    Parameters
    ----------
    windows : bool
        For cmd and PowerShell, where no name holds a double quote.

    Returns
    -------
    str
        In double quotes, which all shells know, unless it holds what they change inside of these.

    Examples
    --------
    >>> quoted("flight.bin"), quoted("flight 1.bin"), quoted("a $b.bin", windows=False)
    ('flight.bin', '"flight 1.bin"', "'a $b.bin'")
    """
    if (_PLAIN_IN_WINDOWS if windows else _PLAIN).fullmatch(word):
        return word
    return f'"{word}"' if windows or (word and not _SPECIAL.search(word)) else shlex.quote(word)


def named(path: str) -> str:
    """Return a file as an argument.

    Returns
    -------
    str
        `LOG` where it is no file of this machine, or cannot be shown as it is: hidden characters, several
        spaces in a row, or the mark with which texts set off commands.

    Examples
    --------
    >>> named("logs/-1.bin"), named("-1.bin"), named("a  b.bin")
    ('logs/-1.bin', './-1.bin', 'LOG')
    """
    if not path or printable(path, _LONGEST) != path or "`" in path or "://" in path:
        return LOG
    return f"./{path}" if path.startswith("-") else path
