"""Many tests of one thing: which of them say something."""

from __future__ import annotations

from collections.abc import Sequence


def holm(p_values: Sequence[float], level: float) -> tuple[bool, ...]:
    """Return which hypotheses are rejected so that none is by chance, but with this probability.

    Parameters
    ----------
    p_values : sequence of float
        Of tests that may depend on each other in any way.
    level : float
        Probability of at least one false rejection.

    Returns
    -------
    tuple of bool

    References
    ----------
    .. [1] S. Holm, "A simple sequentially rejective multiple test procedure," Scand. J. Statist., vol. 6,
       pp. 65-70, 1979.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.02], 0.05)
    (True, True, True)
    >>> holm([0.01, 0.04, 0.03], 0.05)
    (True, False, False)
    """
    rejected = [False] * len(p_values)
    for n_before, place in enumerate(sorted(range(len(p_values)), key=lambda one: p_values[one])):
        if p_values[place] > level / (len(p_values) - n_before):
            break
        rejected[place] = True
    return tuple(rejected)
