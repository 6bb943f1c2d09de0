"""Text that comes from a log may hold anything: make it safe to show as one line of text."""

from __future__ import annotations

import unicodedata

#: Control, format (bidirectional overrides), surrogate, private and unassigned characters,
#: and the line and paragraph separators.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


#: What Windows takes for devices, whatever stands behind a dot, and the letters that it allows in no name.
_RESERVED = frozenset(
    ("con", "prn", "aux", "nul", *(f"{kind}{number}" for kind in ("com", "lpt") for number in range(1, 10)))
)
_FORBIDDEN = frozenset('<>:"/\\|?*')


def portable_name(text: str) -> str:
    """Return a name that a file or folder can have on Linux, macOS and Windows alike.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
        With an underscore for every letter that one of them forbids, and in front of the names of devices.

    Examples
    --------
    >>> portable_name("flight 3"), portable_name("12:30?"), portable_name("CON"), portable_name("...")
    ('flight 3', '12_30_', '_CON', 'log')
    """
    letters = (letter if letter.isprintable() and letter not in _FORBIDDEN else "_" for letter in text)
    name = "".join(letters).strip(". ") or "log"
    return f"_{name}" if name.split(".")[0].rstrip().lower() in _RESERVED else name


def printable(text: object, longest: int = 300) -> str:
    r"""Return `text` as one visible line: no control characters, no longer than `longest`.

    This is not an escape for HTML; it keeps terminal sequences, overrides of
    the writing direction and line breaks out of what people read.

    Parameters
    ----------
    text : object
        Shown as `str` shows it.
    longest : int
        Most characters of the result; what is longer ends in an ellipsis.

    Returns
    -------
    str

    Examples
    --------
    >>> printable("quad\x1b[31m X") == "quad\ufffd[31m X"
    True
    """
    line = " ".join(str(text)[: longest + 1].split())
    shown = "".join("\ufffd" if unicodedata.category(letter) in _HIDDEN else letter for letter in line)
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"
