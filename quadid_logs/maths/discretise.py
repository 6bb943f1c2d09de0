"""From continuous to discrete time."""

from __future__ import annotations

import numpy as np

from quadid_logs.arrays import FloatArray


def zero_order_hold(A: FloatArray, B: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Discretise x_dot = A x + B u for an input held over each period.

    Parameters
    ----------
    A : ndarray, shape (n_states, n_states)
        [1/s].
    B : ndarray, shape (n_states, n_inputs)
    period_s : float
        Sample period [s].

    Returns
    -------
    A_d, B_d : ndarray
        Same shapes; x(k+1) = A_d x(k) + B_d u(k). Not finite where A grows
        beyond all numbers within one period, as that of a broken log can.

    Notes
    -----
    exp([[A, B], [0, 0]] T) holds both blocks: C. F. Van Loan, IEEE Trans.
    Autom. Control, vol. 23, pp. 395-404, 1978.

    Examples
    --------
    >>> A_d, B_d = zero_order_hold(np.array([[0.0]]), np.array([[2.0]]), 0.5)
    >>> float(A_d[0, 0]), float(B_d[0, 0])
    (1.0, 1.0)
    """
    from scipy.linalg import expm

    n_states, n_inputs = B.shape
    block = np.zeros((n_states + n_inputs, n_states + n_inputs))
    block[:n_states, :n_states] = A
    block[:n_states, n_states:] = B
    with np.errstate(over="ignore", invalid="ignore"):
        exponential = np.asarray(expm(block * period_s), dtype=np.float64)
    return exponential[:n_states, :n_states], exponential[:n_states, n_states:]
