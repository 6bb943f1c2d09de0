"""The source paper's experiment: Table I, one axis at a time, eq. (10)-(12).

"Assessing The Method of State Space Determination from the Quadrotor Flight
Simulation" (Muliadi, Kusumoputro and co-authors). Nothing here depends on the
published numbers; they are quoted for comparison only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from quadid_logs.arrays import FloatArray, IntArray
from quadid_logs.maths.rotational_dynamics import angular_acceleration, gyroscopic_matrix, integrate_adams
from quadid_logs.maths.sliding_windows import solve_windows, stack_windows

INERTIA_KG_M2: Final = ((0.008, 0.0, 0.0), (0.0, 0.008, 0.0), (0.0, 0.0, 0.01))
AMPLITUDE_N_M: Final = 0.01
FREQUENCY_RAD_S: Final = 1.0
SAMPLE_S: Final = 0.2
DURATION_S: Final = 20.0
#: For excitation of all axes at once: the paper's frequency on roll, incommensurable ones beside it.
FREQUENCIES_RAD_S: Final = (1.0, 1.7, 2.3)
WIDTH: Final = 6

#: Eq. (12) as printed: for comparison, never for computation.
PUBLISHED_A: Final = ((-0.1809, -0.2026, -0.1542), (-1.5702, -1.9921, -1.9514), (-0.2165, -0.3004, -0.2418))
PUBLISHED_B: Final = ((25.0543, -0.2605, -0.3733), (-0.8473, 26.1247, -0.8268), (-0.2418, -0.0799, 24.1748))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One simulated flight, sampled every `SAMPLE_S`.

    ``torque_n_m``, ``rate_rad_s`` and ``acceleration_rad_s2`` (exact, from
    eq. (8)) have shape (n_samples, 3), ``quaternion`` (n_samples, 4).
    """

    time_s: FloatArray
    torque_n_m: FloatArray
    rate_rad_s: FloatArray
    quaternion: FloatArray
    acceleration_rad_s2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaperEstimate:
    """[A B] of every window.

    ``A`` and ``B`` (n_windows, 3, 3); ``rank`` and ``condition_number``
    (n_windows, 3), of the H_k from which each row was solved.
    """

    label: str
    A: FloatArray
    B: FloatArray
    rank: IntArray
    condition_number: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment:
    """Runs, estimates and truth.

    ``single`` are the three runs with one axis excited each, ``together`` the
    run with all axes excited. ``increments`` is the paper's convention on the
    single-axis runs: x(k+1) - x(k) stands for the derivative.
    """

    single: tuple[Run, Run, Run]
    together: Run
    increments: PaperEstimate
    exact: PaperEstimate
    together_increments: PaperEstimate
    together_exact: PaperEstimate
    true_A: FloatArray  # noqa: N815 - A and B are the textbook's names
    true_B: FloatArray  # noqa: N815

    @property
    def estimates(self) -> tuple[PaperEstimate, ...]:
        """All four, the paper's convention first."""
        return (self.increments, self.exact, self.together_increments, self.together_exact)


def run_experiment() -> Experiment:
    """Fly the paper's flights and solve every window of eq. (10)-(11)."""
    roll, pitch, yaw = (_fly(tuple(row)) for row in (FREQUENCY_RAD_S * np.eye(3)).tolist())
    together = _fly(FREQUENCIES_RAD_S)
    single, all_axes = (roll, pitch, yaw), (together, together, together)
    J = np.array(INERTIA_KG_M2)
    return Experiment(
        single=single,
        together=together,
        increments=_estimate("one axis at a time, increments per sample (the paper)", single, exact=False),
        exact=_estimate("one axis at a time, exact derivative", single, exact=True),
        together_increments=_estimate("all axes at once, increments per sample", all_axes, exact=False),
        together_exact=_estimate("all axes at once, exact derivative", all_axes, exact=True),
        true_A=gyroscopic_matrix(J)[:, 3:],
        true_B=np.asarray(np.linalg.inv(J), dtype=np.float64),
    )


def _fly(frequencies_rad_s: tuple[float, ...]) -> Run:
    """Integrate from rest under sinusoidal torques; a frequency of 0 is no torque."""
    frequencies = np.array(frequencies_rad_s)

    def torque(time_s: float) -> FloatArray:
        return np.asarray(AMPLITUDE_N_M * np.sin(frequencies * time_s), dtype=np.float64)

    J, time_s = np.array(INERTIA_KG_M2), np.arange(0.0, DURATION_S + 0.5 * SAMPLE_S, SAMPLE_S)
    rate, quaternion = integrate_adams(J, torque, time_s, rate_rad_s=np.zeros(3))
    inputs = np.array([torque(time) for time in time_s.tolist()])
    return Run(
        time_s=time_s,
        torque_n_m=inputs,
        rate_rad_s=rate,
        quaternion=quaternion,
        acceleration_rad_s2=angular_acceleration(rate, inputs, J),
    )


def _estimate(label: str, runs: tuple[Run, Run, Run], *, exact: bool) -> PaperEstimate:
    """Solve row n of [A B] from run n by eq. (10), for every window of six samples."""
    solutions = []
    for axis, run in enumerate(runs):
        p, q, r = run.rate_rad_s.T
        regressors = np.column_stack([q * r, p * r, p * q, run.torque_n_m])[:-1]
        targets = run.acceleration_rad_s2[:-1] if exact else np.diff(run.rate_rad_s, axis=0)
        solutions.append(
            solve_windows(
                stack_windows(regressors, width=WIDTH, stride=1),
                stack_windows(targets[:, axis : axis + 1], width=WIDTH, stride=1),
            )
        )
    coefficients = np.stack([one.coefficients[:, 0] for one in solutions], axis=1)
    return PaperEstimate(
        label=label,
        A=coefficients[:, :, :3],
        B=coefficients[:, :, 3:],
        rank=np.stack([one.rank for one in solutions], axis=1),
        condition_number=np.stack([one.condition_number for one in solutions], axis=1),
    )
