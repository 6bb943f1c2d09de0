"""Numbers of things, in words."""

from __future__ import annotations


def counted(n: int, what: str, many: str = "") -> str:
    """Return a number of things, of which one has no plural.

    Parameters
    ----------
    many : str
        Several of them; `what` with an s by default.

    Examples
    --------
    >>> counted(1, "clock reset"), counted(0, "clock reset")
    ('1 clock reset', '0 clock resets')
    """
    return f"{n} {what if n == 1 else many or f'{what}s'}"
