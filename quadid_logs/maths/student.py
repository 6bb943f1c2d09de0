"""What few samples tell of a mean, and whether they are of one mean at all."""

from __future__ import annotations


def student_95(degrees: int) -> float:
    """Return half of the two-sided 95 % interval of Student's t, in standard deviations.

    Parameters
    ----------
    degrees : int
        Of freedom, at least 1.

    Returns
    -------
    float

    Examples
    --------
    >>> round(student_95(4), 3)
    2.776
    """
    from scipy.special import stdtrit

    return float(stdtrit(max(degrees, 1), 0.975))


def student_tail(value: float, degrees: int) -> float:
    """Return the probability that Student's t is above a value.

    Parameters
    ----------
    value : float
        In standard errors.
    degrees : int
        Of freedom, at least 1.

    Returns
    -------
    float

    Examples
    --------
    >>> round(student_tail(2.776, 4), 3)
    0.025
    """
    from scipy.special import stdtr

    return float(stdtr(max(degrees, 1), -value))


def chi_square_tail(value: float, degrees: int) -> float:
    """Return the probability that chance makes a sum of squares of at least this.

    Parameters
    ----------
    value : float
        In variances.
    degrees : int
        Of freedom, at least 1.

    Returns
    -------
    float

    Examples
    --------
    >>> round(chi_square_tail(9.488, 4), 3)
    0.05
    """
    from scipy.special import chdtrc

    return float(chdtrc(max(degrees, 1), max(value, 0.0)))
