"""How words and sentences are written within a sentence."""

from __future__ import annotations

from collections.abc import Sequence


def continued(text: str) -> str:
    """Return a sentence or a title as it stands within another: its first letter small, unless of a name.

    Examples
    --------
    >>> continued("Yaw was not moved"), continued("A gap is long"), continued("P and I change")
    ('yaw was not moved', 'a gap is long', 'P and I change')
    """
    is_word = text[1:2].islower() or text.startswith("A ")
    return f"{text[:1].lower()}{text[1:]}" if is_word else text


def listed(words: Sequence[str]) -> str:
    """Return words as a list in a sentence, "" for none.

    Examples
    --------
    >>> listed(["roll"]), listed(["roll", "pitch", "yaw"])
    ('roll', 'roll, pitch and yaw')
    """
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last


def some(words: Sequence[str], n_all: int) -> str:
    """Return the words that are named of a long list, and how many more there are.

    Parameters
    ----------
    n_all : int
        Named ones and others.

    Examples
    --------
    >>> some(["a", "b"], 2), some(["a", "b"], 4)
    ('a, b', 'a, b and 2 more')
    """
    rest = n_all - len(words)
    return ", ".join(words) + (f" and {rest} more" if rest > 0 else "")
