"""Predicted body rates on the nano-drone benchmark: `python -m benchmarks.nano_drone FOLDER`.

R. Busetto, E. Cereda, M. Forgione, G. Maroni, D. Piga and D. Palossi, "Nonlinear system identification for a
nano-drone benchmark," Control Engineering Practice 172, 2026. The folder is the ``data`` of a checkout of its
repository (idsia-robotics/nanodrone-sysid-benchmark) with Git LFS. The protocol: fit a model to runs 1 to 3
of square, random and chirp, and predict the melon flights from every sample, given the state there and the
motor speeds up to the end of the horizon.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.logs import corpus_folder
from quadid_logs.arrays import FloatArray
from quadid_logs.containers.table import read_cells
from quadid_logs.data.flight import FlightData, Segment
from quadid_logs.identify.horizons import HorizonPrediction, RatePredictor, fit_predictor
from quadid_logs.maths.rotations import (
    euler_from_quaternion,
    quaternion_from_euler,
    rotation_matrix,
    unwrapped,
)
from quadid_logs.output import write_together
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES, GRAVITY_M_S2

TRAINED_ON: Final = ("square", "random", "chirp")
RUNS: Final = (1, 2, 3)
PERIOD_S: Final = 0.01
PAGE: Final = "nano-drone.md"
#: Of the benchmark's own physics model: thrust and drag torque per squared speed [N s^2, N m s^2], arms [m].
THRUST, DRAG, ARM = 3.72e-8, 7.74e-12, 0.0353
MASS_KG: Final = 0.045
#: Motors front right, back right, back left, front left by roll, pitch and yaw: x forward, y left, z up.
MIXER: Final = np.array([[-1.0, -1.0, 1.0, 1.0], [-1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0]])
FORWARD_LEFT_UP: Final = np.array([1.0, -1.0, -1.0])
#: Mean length of the error of the body rate after 1, 10 and 50 steps, as published [rad/s].
PUBLISHED: Final = (
    ("constant rates, published", (0.0796, 0.3596, 0.8837)),
    ("Physics", (0.0796, 0.3596, 0.8837)),
    ("MLP", (0.1138, 0.5949, 0.9005)),
    ("Hybrid", (0.0912, 0.4880, 0.5979)),
    ("LSTM", (0.1021, 0.4292, 1.2407)),
)
COLUMNS: Final = (
    *("vx", "vy", "vz", "qx", "qy", "qz", "qw", "wx", "wy", "wz"),
    *("m1_rads", "m2_rads", "m3_rads", "m4_rads"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit, predict, print the table and write it."""
    parser = argparse.ArgumentParser(prog="benchmarks.nano_drone", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=default_folder())
    parser.add_argument("--output", type=Path, help=f"folder for {PAGE}")
    options = parser.parse_args(arguments)
    missing = missing_files(options.folder)
    if missing:
        print(f"{printable(missing[0])} is not there, or Git LFS has not fetched it.", file=sys.stderr)
        return 2
    text = scores(options.folder)
    print(text, end="")
    if options.output:
        write_together(options.output, {PAGE: text.encode()})
    return 0


def default_folder() -> Path:
    """Return where the corpus has the data, if it has."""
    return corpus_folder() / "flown" / "nano-drone"


def trained_on(folder: Path) -> list[tuple[str, Path]]:
    """Return the flights to fit to, each with the trajectory that it repeats."""
    return [(name, folder / "train" / f"{name}_20251017_run{run}.csv") for name in TRAINED_ON for run in RUNS]


def predicted(folder: Path) -> list[Path]:
    """Return the flights to predict."""
    return [folder / "test" / f"melon_20251017_run{run}.csv" for run in RUNS]


def missing_files(folder: Path) -> list[Path]:
    """Return the files that are not there, or are pointers of Git LFS."""
    wanted = [*(path for _, path in trained_on(folder)), *predicted(folder)]
    return [path for path in wanted if not path.is_file() or path.stat().st_size < 1_000]


def scores(folder: Path) -> str:
    """Fit to the flights of a folder, predict the others, and return the table.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    str
        Markdown.
    """
    began = time.process_time()
    # The protocol gives the state where a horizon begins, and nothing before.
    ahead = fit_predictor(
        [read(path) for _, path in trained_on(folder)],
        sets=[name for name, _ in trained_on(folder)],
        memory_s=0.0,
    )
    fitted_s = time.process_time() - began
    return table(ahead, [ahead.predict(read(path)) for path in predicted(folder)], fitted_s)


def read(path: Path) -> FlightData:
    """Read one flight, turned to forward, right, down and NED.

    Parameters
    ----------
    path : Path

    Returns
    -------
    FlightData
        One segment: torques in N m by the benchmark's own constants, throttle as thrust over weight.
    """
    columns = read_cells(path, lambda _names: list(COLUMNS)).columns
    velocity, quaternion, rate, speed = (
        np.column_stack([columns[name] for name in COLUMNS[part]])
        for part in (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 14))
    )
    # Half a turn about x takes forward-left-up to forward-right-down, and the Earth's axes alike.
    attitude = euler_from_quaternion(quaternion[:, [3, 0, 1, 2]] * np.array([1.0, 1.0, -1.0, -1.0]))
    to_earth = rotation_matrix(quaternion_from_euler(attitude))
    square = speed**2
    return _flight(
        rate=rate * FORWARD_LEFT_UP,
        torque=(square @ MIXER.T) * np.array([THRUST * ARM, THRUST * ARM, DRAG]) * FORWARD_LEFT_UP,
        attitude=unwrapped(attitude),
        throttle=THRUST * square.sum(axis=1) / (MASS_KG * GRAVITY_M_S2),
        velocity=np.einsum("kij,ki->kj", to_earth, velocity * FORWARD_LEFT_UP),
    )


def _flight(
    *, rate: FloatArray, torque: FloatArray, attitude: FloatArray, throttle: FloatArray, velocity: FloatArray
) -> FlightData:
    """Return a flight of one segment: the data are on one clock, and no sample may be left out."""
    n_samples = len(rate)
    segment = Segment(
        time_s=PERIOD_S * np.arange(n_samples),
        body_rate_rad_s=rate,
        torque=torque,
        attitude_rad=attitude,
        throttle=throttle,
        saturated=np.zeros(n_samples, dtype=np.bool_),
        velocity_m_s=velocity,
    )
    return FlightData(
        sample_period_s=PERIOD_S,
        segments=(segment,),
        flights=((segment.start_s, segment.end_s),),
        sources={},
        input=None,
        start_s=0.0,
        duration_s=segment.end_s,
    )


def table(ahead: RatePredictor, found: Sequence[Sequence[HorizonPrediction]], fitted_s: float) -> str:
    """Return the scores as Markdown.

    Parameters
    ----------
    ahead : RatePredictor
    found : sequence of sequence of HorizonPrediction
        By flight, then by horizon.
    fitted_s : float
        Processor time of reading and fitting.

    Returns
    -------
    str
    """
    by_horizon = [*zip(*found, strict=True)]
    errors = [np.mean([each.error_rad_s for each in flights]) for flights in by_horizon]
    kept = [np.mean([each.kept_error_rad_s for each in flights]) for flights in by_horizon]
    held = [np.mean([each.coverage for each in flights], axis=0) for flights in by_horizon]
    rows = [
        ("**quadid-logs**", *(f"**{error:.4f}**" for error in errors)),
        ("constant rates, on these files", *(f"{error:.4f}" for error in kept)),
        *((name, *(f"{error:.4f}" for error in published)) for name, published in PUBLISHED),
        ("coverage of our 95 % intervals", *(f"{100.0 * share.mean():.1f} %" for share in held)),
        *(
            (f"coverage, {axis}", *(f"{100.0 * share[number]:.1f} %" for share in held))
            for number, axis in enumerate(AXES)
        ),
    ]
    head = ("", *(f"{each.n_steps} × 10 ms" for each in ahead.horizons))
    lines = [head, ("---", *("---" for _ in errors)), *rows]
    n_starts = sum(len(each.start_s) for each in by_horizon[0])
    return "\n".join(
        [
            *(f"| {' | '.join(line)} |" for line in lines),
            "",
            f"Mean length of the error of the body rate [rad/s] over {n_starts} starts in {len(found)} "
            f"flights; read and fitted in {fitted_s:.1f} s of processor time.",
            "",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
