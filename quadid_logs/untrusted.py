"""Text that comes from a log may hold anything: make it safe to show as one line of text."""

from __future__ import annotations

import unicodedata

#: Control, format (bidirectional overrides), surrogate, private and unassigned characters,
#: and the line and paragraph separators.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


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
