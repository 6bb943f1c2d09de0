"""How words and sentences are written within a sentence."""

from __future__ import annotations

from collections.abc import Sequence


def continued(text: str) -> str:
    """Return a sentence or a title as it stands within another: its first letter small, unless of a name.

    Parameters
    ----------
    text : str

    Returns
    -------
    str

    Examples
    --------
    >>> continued("Yaw was not moved"), continued("A gap is long"), continued("P and I change")
    ('yaw was not moved', 'a gap is long', 'P and I change')
    """
    is_word = text[1:2].islower() or text.startswith("A ")
    return f"{text[:1].lower()}{text[1:]}" if is_word else text


def listed(words: Sequence[str]) -> str:
    """Return words as a list in a sentence, "" for none.

    Parameters
    ----------
    words : sequence of str

    Returns
    -------
    str

    Examples
    --------
    >>> listed(["roll"]), listed(["roll", "pitch", "yaw"])
    ('roll', 'roll, pitch and yaw')
    """
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last
