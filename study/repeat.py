"""How well flown flights repeat, and what a single one can tell: `python study/repeat.py`.

Every set of flights of one vehicle in the corpus (`QUADID_LOG_CORPUS`): each flight by itself through
`quadid_logs.repeat`, leave one out; all of them as a pool; and for those that follow a planned trajectory the
bound on what a flight can tell (Cramer and Rao): of an effectiveness by that trajectory as instrument, lag,
delay and damping known, in the noise that the flight itself has. A second table says what the interval of
each pool is made of. Writes both as markdown.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from benchmarks.logs import corpus_folder  # noqa: E402
from quadid_logs.arrays import FloatArray  # noqa: E402
from quadid_logs.data.flight import FlightData  # noqa: E402
from quadid_logs.data.model import SpectralFit  # noqa: E402
from quadid_logs.data.result import Result  # noqa: E402
from quadid_logs.errors import QuadidError  # noqa: E402
from quadid_logs.identify.spectral import by_coordinates, few_blocks, solve_flight  # noqa: E402
from quadid_logs.maths.block_spectra import BlockSpectra, block_spectra  # noqa: E402
from quadid_logs.maths.normal import NORMAL_95  # noqa: E402
from quadid_logs.pipeline import analyze  # noqa: E402
from quadid_logs.repetition import Repeatability, repeat  # noqa: E402
from quadid_logs.report.numbers import plus_minus  # noqa: E402
from quadid_logs.vocabulary import ON_AXIS  # noqa: E402

DEFAULT_OUTPUT: Final = ROOT / "benchmarks" / "repeat.md"
#: Of the bound: where trajectories command anything, and above what the torque holds against.
LOWEST_HZ, HIGHEST_HZ, BLOCK_S = 1.0, 12.0, 3.0
TILTING: Final = ("roll", "pitch")
#: Of the noise that flights have: small enough to be nothing beside departures, large enough for rounding.
NO_NOISE: Final = 1e-6


class Bound(NamedTuple):
    """What each flight of a set can tell at best of roll and pitch: half widths over the effectiveness."""

    single: FloatArray
    pooled: FloatArray


def flown_sets(corpus: Path) -> Iterator[tuple[str, list[Path]]]:
    """Yield the name of each set of flights of one vehicle in one state, with its logs."""
    folder = corpus / "flown" / "crazyswarm2"
    classes = defaultdict(list)
    for log in sorted((folder / "logs").glob("log*")):
        classes[_class_of(folder / "info", log.name)].append(log)
    for name, logs in sorted(classes.items()):
        if len(logs) > 2:
            yield f"crazyswarm2, {name}", logs
    repeats = defaultdict(list)
    for log in sorted((corpus / "flown" / "nanobench").glob("*.parquet")):
        repeats[re.sub(r"_rep\d+$", "", log.stem)].append(log)
    for name, logs in sorted(repeats.items()):
        if len(logs) > 2:
            yield f"NanoBench, {name}", logs
    real, blackbox = corpus / "real", corpus / "blackbox"
    yield "Crazyflie Brushless, by commands", sorted(real.glob("cfbl-*-command.csv"))
    yield "Crazyflie Brushless, by rotor speeds", sorted(real.glob("cfbl-*-rotors.csv"))
    yield "tail-sitter in hover", sorted(real.glob("tailsitter-*.csv"))
    yield "quad with whole propellers, 10 Hz", sorted(real.glob("ac413-quadx-goodprop-*.bin"))
    yield "quad with cut propellers, 10 Hz", sorted(real.glob("ac413-quadx-25mmcut-*.bin"))
    yield "Betaflight 3, bf3-log", sorted(blackbox.glob("bf3-log*"))


def _class_of(folder: Path, log: str) -> str:
    """Return motors, propellers and mass as the set's own notes say them."""
    path = next(
        (each for name in (log, log.split("_")[0]) if (each := folder / f"info{name[3:]}.yaml").exists()),
        None,
    )
    if path is None:
        return "without notes"
    said = dict(line.split(": ", 1) for line in path.read_text().splitlines() if ": " in line)
    return f"{said['motors'].split()[0]} motors, {1e3 * float(said['mass']):.1f} g"


def measure(logs: Sequence[Path]) -> tuple[list[Result], Repeatability, Result | None]:
    """Analyze each flight, hold them against each other, and pool them."""
    results = [result for log in logs if (result := _one(log)) is not None]
    try:
        pooled = analyze([result.log.path for result in results])
    except QuadidError:
        pooled = None
    return results, repeat(results), pooled


def _one(log: Path) -> Result | None:
    try:
        return analyze(log)
    except QuadidError as error:
        print(f"{log.name}: {error}", file=sys.stderr)
        return None


def soundest(pools: Sequence[Result | None]) -> tuple[SpectralFit, ...]:
    """Return the fit by trajectories that knows roll best: what a vehicle of this kind answers with."""
    fits = [each.identification.spectral for each in pools if each is not None]
    sound = [each for each in fits if each and each[0].planned and each[0].is_sound]
    return min(sound, key=lambda each: each[0].half_width / each[0].gain, default=())


def bound_of(results: Sequence[Result], fits: Sequence[SpectralFit]) -> Bound | None:
    """Return what each flight can tell at best, None where no trajectory was planned."""
    told = [(result, _spectra(result.data)) for result in results]
    spectra = [found for _result, found in told if found is not None]
    lasting_s = [result.data.used_s for result, found in told if found is not None]
    if not spectra or not fits:
        return None
    single = np.full((len(spectra), 2), np.inf)
    for axis in range(2):
        commanded = [each.values[:, :, 6 + axis] for each in spectra]
        torque = [each.values[:, :, 3 + axis] for each in spectra]
        power = sum((np.abs(z) ** 2).sum(axis=0) for z in commanded)
        law = sum((z.conj() * u).sum(axis=0) for z, u in zip(commanded, torque, strict=True)) / np.maximum(
            power, 1e-300
        )
        for number, each in enumerate(spectra):
            s = 2j * np.pi * each.frequency_hz
            fit = fits[axis] if fits[axis].is_sound else fits[0]
            gain, _damping, lag_s, delay_s = fit.mean[:4]
            behind = np.exp(-s * delay_s) / (1.0 + s * lag_s)
            left = each.derivative(axis) - gain * behind * torque[number]
            noise = _smooth((np.abs(left) ** 2).mean(axis=0))
            # Blocks overlap, and leave out what is beside the last one: together they stand for the flight.
            fraction = lasting_s[number] / (len(each.run) * BLOCK_S)
            known = 2.0 * fraction * np.sum(np.abs(behind * law * commanded[number]) ** 2 / noise)
            if known > 0.0 and np.isfinite(gain):
                single[number, axis] = NORMAL_95 / np.sqrt(known) / abs(gain)
    return Bound(single, 1.0 / np.sqrt(np.sum(single**-2.0, axis=0)))


class Parts(NamedTuple):
    """Half widths of a pool's roll and pitch over the effectiveness: as they are, and without some of it.

    Each of shape (2,): without the noise of the flights; without departures from the equation, so that noise
    alone is left; and by noise alone, were lag and delay known. NaN for an axis that nothing tells.
    """

    whole: FloatArray
    without_noise: FloatArray
    by_noise: FloatArray
    lag_known: FloatArray


def parts_of(data: FlightData) -> Parts | None:
    """Return what the intervals of a pool are made of, None where no trajectory was planned."""
    solution = solve_flight(data)
    if solution is None or not solution.planned:
        return None
    axes = [axis for axis in solution.axes if axis.number < len(TILTING)]

    def widths(noise: float, *, departs: bool, n_known: int) -> FloatArray:
        n_linear = len(axes[0].spread) + 1
        information = np.zeros((2 + n_linear * len(axes),) * 2)
        information[:2, :2] = np.eye(2)
        gains = []
        for place, axis in enumerate(axes):
            gains.append(float(axis.solved(solution.actuator)[0][0]))
            before = axis.noise, axis.variance, axis.moments_hz
            axis.noise = noise * axis.noise
            axis.depart(*(before[1:] if departs else (0.0, 0.0)))
            axis.prepare()
            columns = axis.system(solution.actuator)[0]
            slopes = np.zeros((len(columns), 2))
            white = by_coordinates(axis.white_commanded, solution.actuator)[:, :2]
            slopes[: len(white)] = gains[-1] * white
            rows = np.column_stack([slopes, columns])
            own = np.r_[0:2, 2 + n_linear * place : 2 + n_linear * (place + 1)]
            information[np.ix_(own, own)] += rows.T @ rows
            axis.noise = before[0]
            axis.depart(*before[1:])
            axis.prepare()
        covariance = np.linalg.pinv(information[n_known:, n_known:], hermitian=True)
        found = np.full(len(TILTING), np.nan)
        for place, (axis, gain) in enumerate(zip(axes, gains, strict=True)):
            variance = covariance[2 - n_known + n_linear * place, 2 - n_known + n_linear * place]
            found[axis.number] = NORMAL_95 * few_blocks(axis.run.size) * np.sqrt(variance) / abs(gain)
        return found

    return Parts(
        whole=widths(1.0, departs=True, n_known=0),
        without_noise=widths(NO_NOISE, departs=True, n_known=0),
        by_noise=widths(1.0, departs=False, n_known=0),
        lag_known=widths(1.0, departs=False, n_known=2),
    )


def _spectra(data: FlightData) -> BlockSpectra | None:
    """Return the spectra of rates, torques and the trajectory of a flight, None where it has none."""
    segments = [each for each in data.segments if each.planned and each.command is not None]
    records = [np.column_stack([each.body_rate_rad_s, each.torque, each.command[:, :2]]) for each in segments]  # type: ignore[index]
    found = (
        block_spectra(
            records,
            [each.start_s for each in segments],
            data.sample_period_s,
            length_s=BLOCK_S,
            highest_hz=HIGHEST_HZ,
        )
        if records
        else None
    )
    if found is None:
        return None
    lines = found.frequency_hz >= LOWEST_HZ
    # All flights on the same lines, whatever their sample periods.
    grid = np.arange(LOWEST_HZ, HIGHEST_HZ - 1.0, 1.0 / BLOCK_S)
    place = np.abs(found.frequency_hz[lines] - grid[:, np.newaxis]).argmin(axis=1)
    return found._replace(
        frequency_hz=grid,
        values=found.values[:, lines][:, place],
        by_slope=found.by_slope[:, lines][:, place],
    )


def _smooth(power: FloatArray) -> FloatArray:
    """Return a spectrum averaged over seven lines: that of a short flight is known from few blocks."""
    window = np.ones(min(7, power.size))
    return np.asarray(np.convolve(power, window, "same") / np.convolve(np.ones_like(power), window, "same"))


def row(
    name: str, results: list[Result], found: Repeatability, pooled: Result | None, bound: Bound | None
) -> str:
    """Return a row of the table."""
    told = [sum(axis not in why for why in found.reasons) for axis in TILTING]
    own = {each.axis: each for each in found.quantities if each.kind == "effectiveness"}
    held = [one.held for each in own.values() for one in each.estimates if one.held is not None]
    cells = [
        name,
        str(len(results)),
        " / ".join(map(str, told)),
        " / ".join(_mean(own, axis) for axis in TILTING),
        {"agree": "none", "differ": "yes", "not comparable": "none"}[found.verdict] if own else "–",
        f"{sum(held)} of {len(held)}" if held else "–",
        " / ".join(_pooled(pooled, axis) for axis in TILTING),
    ]
    if bound is None:
        cells += ["–", "–"]
    else:
        singles = (np.median(bound.single[:, axis]) for axis in range(2))
        cells += [" / ".join(map(_percent, each)) for each in (singles, bound.pooled)]
    return f"| {' | '.join(cells)} |"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.0f} %" if fraction < 3.0 else "–"


def _mean(own: dict, axis: str) -> str:  # type: ignore[type-arg]
    return plus_minus(own[axis].mean.value, own[axis].mean.half_width) if axis in own else "–"


def _pooled(pooled: Result | None, axis: str) -> str:
    """Return the pool's effectiveness where it is not refused."""
    model = None if pooled is None else pooled.identification.recommended
    if pooled is None or model is None or pooled.verdict[axis] == "refused":
        return "–"
    gain = model.entries[ON_AXIS[axis]]
    return plus_minus(gain.value, 0.5 * (gain.ci95[1] - gain.ci95[0]))


HEAD: Final = (
    "| set | flights | tell roll / pitch | mean of single flights | differences | left out, held |"
    " pooled | at best, single | at best, pooled |\n|---|---|---|---|---|---|---|---|---|\n"
)


PARTS_HEAD: Final = (
    "| pool | half width | without noise | by noise alone | by noise alone, lag and delay known |\n"
    "|---|---|---|---|---|\n"
)


def parts_row(name: str, parts: Parts) -> str:
    """Return a row of the table of what intervals are made of."""
    cells = [" / ".join(map(_percent, each)) for each in parts]
    return f"| {' | '.join([name, *cells])} |"


def _below(known: FloatArray, fraction: float) -> str:
    return f"{np.sum(known < fraction)} below {100 * fraction:.0f} %"


def main() -> int:
    """Measure every set and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=DEFAULT_OUTPUT)
    options = parser.parse_args()
    corpus = corpus_folder()
    measured = {name: measure(logs) for name, logs in flown_sets(corpus) if len(logs) > 1}
    fits = soundest([pooled for _results, _found, pooled in measured.values()])
    lines, held, n, singles = [], 0, 0, []
    for name, (results, found, pooled) in measured.items():
        bound = bound_of(results, fits)
        lines.append(row(name, results, found, pooled, bound))
        own = [one.held for each in found.quantities for one in each.estimates if one.held is not None]
        held, n = held + sum(own), n + len(own)
        singles += [] if bound is None else [bound.single]
    text = HEAD + "\n".join(lines) + "\n"
    text += f"\nLeave one out: {held} of {n} values (effectiveness, damping, lag, delay) lie where the others"
    text += " predict them.\n"
    told = {name: parts_of(pooled.data) for name, (_r, _f, pooled) in measured.items() if pooled is not None}
    text += "\nOf roll / pitch of pools with a trajectory, whether their axes are refused or not:\n\n"
    text += PARTS_HEAD
    text += "".join(f"{parts_row(name, parts)}\n" for name, parts in told.items() if parts is not None)
    if singles:
        every = np.concatenate(singles)
        words = [
            f"{axis}: {', '.join(_below(known, each) for each in (0.1, 0.2, 0.3))} of {known.size} flights, "
            f"best {100 * known.min():.0f} %, median {100 * np.median(known):.0f} %"
            for axis, column in zip(TILTING, every.T, strict=True)
            if (known := column[np.isfinite(column)]).size
        ]
        text += f"\nAt best, single flights with a planned trajectory: {'; '.join(words)}.\n"
    options.output.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
