"""The page about the paper's experiment: text, tables and figures."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.maths.rotations import multiply_quaternions
from quadid_logs.simulator.paper_experiment import (
    PUBLISHED_A,
    PUBLISHED_B,
    SAMPLE_S,
    WIDTH,
    Experiment,
    PaperEstimate,
    Run,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("roll", "pitch", "yaw")


def page_text(experiment: Experiment) -> str:
    """Return the whole page as Markdown; the figures lie beside it."""
    # One table of all elements, one of rank and condition number.
    middle = [_median(estimate) for estimate in experiment.estimates]
    head = "| | published eq. (12) | " + " | ".join(e.label for e in experiment.estimates) + " | truth |"
    rows = [head, "|---" * (len(middle) + 3) + "|"]
    truth = np.hstack([experiment.true_A, experiment.true_B])
    published = np.hstack([np.array(PUBLISHED_A), np.array(PUBLISHED_B)])
    for i in range(3):
        for j in range(6):
            name = f"{'A' if j < 3 else 'B'}{i + 1}{j % 3 + 1}"
            cells = " | ".join(_number(table[i, j]) for table in middle)
            rows.append(f"| {name} | {published[i, j]:.4f} | {cells} | {_number(truth[i, j])} |")
    note = "Ours are medians over all windows; every window's values are in windows.csv."
    ranks = ["| H_k of | rank of 6 | condition number (median, columns scaled) |", "|---|---|---|"]
    for estimate in experiment.estimates:
        low, high = int(estimate.rank.min()), int(estimate.rank.max())
        span = f"{low}" if low == high else f"{low} to {high}"
        condition = float(np.median(estimate.condition_number))
        shown = f"{condition:.3g}" if np.isfinite(condition) else "infinite"
        ranks.append(f"| {estimate.label} | {span} | {shown} |")
    parts = [
        "# The source paper's experiment, re-run",
        "Table I vehicle (Ixx = Iyy = 0.008, Izz = 0.01 kg m^2, no products of inertia), torque 0.01 N m at "
        "1 rad/s on one axis at a time from rest, eq. (8) integrated by a variable-order Adams "
        "predictor-corrector, sampled every 200 ms, H_k of eq. (11) solved for every window of six samples. "
        "All numbers below but the column 'published' were computed by this run.",
        "![Torque, rates and angles of the single-axis runs](fig4.png)",
        "## Eq. (12) beside ours and the truth",
        *["\n".join(rows), note, "\n".join(ranks)],
        "![Every window's diagonal of B](windows.png)",
        "## What agrees, what cannot, and why",
        *_findings(experiment),
    ]
    return "\n\n".join(parts) + "\n"


def _median(estimate: PaperEstimate) -> FloatArray:
    """Median [A B] over the windows, shape (3, 6)."""
    return np.asarray(np.median(np.concatenate([estimate.A, estimate.B], axis=2), axis=0), dtype=np.float64)


def _number(value: float) -> str:
    """Four decimals, and no sign on what is zero."""
    return f"{value + 0.0:.4f}" if abs(value) > 5e-5 else "0"


def _findings(experiment: Experiment) -> list[str]:
    """Explain in plain words, with the numbers of this run."""
    published = np.diagonal(np.array(PUBLISHED_B))
    truth, ours = np.diagonal(experiment.true_B), np.diagonal(experiment.increments.B, axis1=1, axis2=2)
    nearest = int(np.argmin(np.abs(ours[:, 0] - published[0])))
    per_sample = SAMPLE_S * truth
    full = experiment.together_exact.rank[:, 0] == WIDTH
    together = np.abs(experiment.together_exact.B - experiment.true_B)[full].max()
    condition = float(np.median(experiment.together_increments.condition_number[full]))
    return [
        f"**What agrees.** The published diagonal of B ({_list(published)}) is not J^-1 ({_list(truth)}), "
        f"but of the size of Ts J^-1 ({_list(per_sample)}): the increments x(k+1) - x(k) were used as the "
        f"derivative and not divided by Ts = {SAMPLE_S:g} s. Under that convention our B11 lies between "
        f"{ours[:, 0].min():.2f} and {ours[:, 0].max():.2f}, depending on the window; window {nearest} "
        f"gives {ours[nearest, 0]:.2f}.",
        "**Why it moves with the window.** An increment is the mean acceleration over the next 200 ms; the "
        "torque of the same row is the one at its beginning. The two are out of step by half a sample, "
        "and how much that matters depends on where in the sine the six samples lie.",
        f"**What does not agree.** Our B33 lies between {ours[:, 2].min():.2f} and {ours[:, 2].max():.2f} "
        f"under the paper's convention; the published {published[2]:.2f} would need an Izz of "
        f"{SAMPLE_S / published[2]:.4f} kg m^2 instead of Table I's.",
        f"**What cannot be identified.** With one axis excited from rest and a diagonal tensor, the other "
        f"two rates stay exactly zero: qr, pr, pq and two torques are empty columns, and H_k has rank "
        f"{int(experiment.exact.rank.max())} of 6. The pseudo-inverse then returns zero for everything but "
        f"B_nn. The published non-zero A and off-diagonal B are therefore no property of that vehicle "
        f"under that input, and the conclusion that they show strong cross-coupling does not follow.",
        f"**What makes the method exact.** With the true derivative instead of increments, one axis at a "
        f"time gives B_nn exactly. With all axes excited at once as well, {full.sum()} of {full.size} "
        f"windows have full rank (the first begins at rest), and each of these returns all of A and B: the "
        f"largest error of B is {together:.1e} of {truth.max():.0f}. Excitation alone does not help: with "
        f"increments, a condition number of {condition:.0e} turns the half sample of delay into wrong "
        f"couplings.",
    ]


def _list(values: FloatArray) -> str:
    """Numbers in a sentence."""
    return ", ".join(f"{value:.2f}" for value in values)


def windows_csv(experiment: Experiment) -> str:
    """Return every window of every estimate as CSV."""
    names = [f"{letter}{i}{j}" for letter in "AB" for i in (1, 2, 3) for j in (1, 2, 3)]
    ranks = [f"{what}_{axis}" for what in ("rank", "condition_number") for axis in _AXES]
    lines = [",".join(["estimate", "k", *names, *ranks])]
    for estimate in experiment.estimates:
        label = f'"{estimate.label}"'
        for k in range(estimate.A.shape[0]):
            numbers = [*estimate.A[k].ravel(), *estimate.B[k].ravel()]
            numbers += [*estimate.rank[k], *estimate.condition_number[k]]
            lines.append(",".join([label, str(k), *(f"{number:.10g}" for number in numbers)]))
    return "\n".join(lines) + "\n"


def figures(experiment: Experiment) -> dict[str, bytes]:
    """Return the figures as PNG by file name."""
    drawn = {
        "fig4.png": _figure_4(experiment.single),
        "windows.png": _figure_windows(experiment),
        "tables.png": _figure_tables(experiment),
    }
    found = {}
    for name, figure in drawn.items():
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=130, metadata={"Software": None})
        found[name] = buffer.getvalue()
    return found


def _figure_4(runs: tuple[Run, Run, Run]) -> Figure:
    """Draw torque, rates and angles of the three single-axis runs: the paper's Fig. 4."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7), layout="constrained")
    grid = figure.subplots(3, 3, sharex=True)
    quantities = (
        ("torque [N m]", ("L", "M", "N"), "torque_n_m"),
        ("body rate [rad/s]", ("p", "q", "r"), "rate_rad_s"),
        ("angle turned [rad]", ("roll", "pitch", "yaw"), "quaternion"),
    )
    for column, run in enumerate(runs):
        for row, (label, names, attribute) in enumerate(quantities):
            axes = grid[row][column]
            # The series to draw; of the attitude, the angle turned about each body axis.
            values: FloatArray = getattr(run, attribute)
            shown = angle_turned(values) if attribute == "quaternion" else values
            for name, style, series in zip(names, ("-", "--", ":"), shown.T, strict=True):
                axes.plot(run.time_s, series, style, marker=".", markersize=3, label=name)
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
            # An angle that only grows ends in the other corner.
            corner = "upper left" if attribute == "quaternion" else "upper right"
            axes.legend(loc=corner, fontsize="small")
        grid[0][column].set_title(f"{_AXES[column]} excited")
        grid[2][column].set_xlabel("time [s]")
    figure.suptitle("Torque, body rates and angles turned, sampled every 200 ms (the paper's Fig. 4)")
    return figure


def angle_turned(quaternion: FloatArray) -> FloatArray:
    """Return the angle turned about each body axis since the first sample.

    Summed over the rotations from sample to sample, each below half a turn: exact while only
    one axis turns, over any number of turns. Euler angles would jump where the pitch passes 90 degrees.

    Parameters
    ----------
    quaternion : ndarray, shape (n_samples, 4)
        w, x, y, z.

    Returns
    -------
    ndarray, shape (n_samples, 3)
        [rad]
    """
    step = multiply_quaternions(quaternion[:-1] * np.array([1.0, -1.0, -1.0, -1.0]), quaternion[1:])
    # q and -q are one attitude: of the two, the shorter rotation.
    step *= np.where(step[:, :1] < 0.0, -1.0, 1.0)
    sine = np.linalg.norm(step[:, 1:], axis=1, keepdims=True)
    per_sine = 2.0 * np.arctan2(sine, step[:, :1]) / np.where(sine > 0.0, sine, 1.0)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(per_sine * step[:, 1:], axis=0)])


def _figure_windows(experiment: Experiment) -> Figure:
    """Draw the diagonal of B of every window beside the published and the true values."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    for axis, axes in enumerate(figure.subplots(1, 3)):
        for estimate, style in zip(experiment.estimates, ("o", "s", "x", "+"), strict=True):
            axes.plot(estimate.B[:, axis, axis], style, markersize=3, label=estimate.label)
        axes.axhline(PUBLISHED_B[axis][axis], color="black", linestyle="--", label="published")
        axes.axhline(SAMPLE_S * experiment.true_B[axis, axis], color="gray", linestyle=":", label="Ts / I")
        axes.axhline(experiment.true_B[axis, axis], color="black", linewidth=0.8, label="truth 1 / I")
        axes.set_yscale("symlog", linthresh=10.0)
        axes.set_xlabel("window k")
        axes.set_ylabel(f"B{axis + 1}{axis + 1} [rad/s^2 per N m]")
        axes.grid(alpha=0.3)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize="small")
    return figure


def _figure_tables(experiment: Experiment) -> Figure:
    """Draw [A B] published, ours and true as tables of numbers."""
    from matplotlib.figure import Figure

    published = np.hstack([np.array(PUBLISHED_A), np.array(PUBLISHED_B)])
    truth = np.hstack([experiment.true_A, experiment.true_B])
    tables = [("published eq. (12)", published)]
    tables += [(f"{estimate.label} (median)", _median(estimate)) for estimate in experiment.estimates]
    tables.append(("truth: Euler's equation", truth))
    figure = Figure(figsize=(10, 8), layout="constrained")
    names = ["qr", "pr", "pq", "L", "M", "N"]
    for axes, (label, values) in zip(figure.subplots(len(tables), 1), tables, strict=True):
        axes.axis("off")
        axes.set_title(label, fontsize="medium")
        axes.table(
            cellText=[[_number(value) for value in row] for row in values],
            colLabels=names,
            rowLabels=["p_dot", "q_dot", "r_dot"],
            loc="center",
        )
    return figure
