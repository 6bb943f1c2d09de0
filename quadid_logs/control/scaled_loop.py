"""Loops whose P, I and D are multiplied by one factor: all that a search for it needs, computed once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from quadid_logs.arrays import FloatArray
from quadid_logs.control.loop import Paths, integrators
from quadid_logs.control.margins import (
    LoopFigures,
    figures_and_worse,
    figures_of,
    fine_grid_hz,
    grid_hz,
    margins_of,
)
from quadid_logs.data.closed_loop import Estimated, LoopMargins, Margins, Plant
from quadid_logs.data.controller import AxisController
from quadid_logs.data.tuning import Limits
from quadid_logs.maths.band import ComplexArray

#: Of each loop: gain up, gain down, phase, disk.
N_LIMITS: Final = 4
#: A limit of nothing is always kept.
_NOTHING: Final = 1e-9


class ScaledLoops(NamedTuple):
    """Open loops of one axis around several vehicles, in parts: what scales with the gains, what does not.

    ``rate`` is the rate loop, ``angle`` what the angle loop adds to it through P, I and D, None where no
    angle loop is known, ``fixed`` what it adds through the feed-forward, None where there is none; each
    (n_plants, n_frequencies). ``body`` is the vehicles' own answer.
    """

    controller: AxisController
    plants: Plant
    known_hz: float
    frequency_hz: FloatArray
    body: ComplexArray
    rate: ComplexArray
    angle: ComplexArray | None
    fixed: ComplexArray | None

    def margins(self, factor: float = 1.0) -> LoopMargins:
        """Return the margins with P, I and D times a factor."""
        rate, whole = self.rate, self.whole(factor)
        full = None if whole is None else self._margins(whole, 1)
        return LoopMargins(rate=self._margins(rate if factor == 1.0 else factor * rate, 0), full=full)

    def keep(self, limits: Limits, least: float, factor: float = 1.0) -> bool:
        """Tell whether the worst vehicles keep so much of the limits, with P, I and D times a factor.

        Parameters
        ----------
        limits : Limits
        least : float
            As of `spare`.
        factor : float
        """
        whole = self.whole(factor)
        if whole is not None and np.min(_spare(self._margins(whole, 1), limits)) < least:
            return False
        rate = self.rate if factor == 1.0 else factor * self.rate
        return bool(np.min(_spare(self._margins(rate, 0), limits)) >= least)

    def whole(self, factor: float = 1.0) -> ComplexArray | None:
        """Return the loops with all that closes them, with P, I and D times a factor.

        Returns
        -------
        ndarray of complex, shape (n_plants, n_frequencies), or None
            None where no angle loop is known.
        """
        if self.angle is None:
            return None
        scaled = self.rate + self.angle
        if factor != 1.0:
            scaled *= factor
        return scaled if self.fixed is None else scaled + self.fixed

    def _margins(self, loop: ComplexArray, more_integrators: int) -> Margins:
        n, runs_away = integrators(self.controller) + more_integrators, self.plants.damping > 0.0
        return margins_of(self.frequency_hz, loop, n, runs_away, self.known_hz)

    def spare_alone(self, factors: FloatArray, limits: Limits) -> FloatArray:
        """Return how much of the limits the estimate alone keeps, with P, I and D times some factors.

        Parameters
        ----------
        factors : ndarray, shape (n_factors,)
        limits : Limits

        Returns
        -------
        ndarray, shape (n_factors,)
            As of `spare`.
        """
        n, column = integrators(self.controller), factors[:, np.newaxis]
        loops = [(column * self.rate[0], n)]
        if self.angle is not None:
            fixed = 0.0 if self.fixed is None else self.fixed[0]
            loops.append((column * (self.rate[0] + self.angle[0]) + fixed, n + 1))
        runs_away = np.repeat(self.plants.damping[:1] > 0.0, factors.size)
        figures = [
            each
            for loop, n_poles in loops
            for each in figures_and_worse(self.frequency_hz, loop, n_poles, runs_away, self.known_hz)
        ]
        told = np.concatenate([spare_of(one, limits) for one in figures], axis=1)
        return np.asarray(np.maximum(np.min(told, axis=1), 0.0))

    def first(self, n_plants: int) -> ScaledLoops:
        """Return the loops around the first of the vehicles."""
        return self.at(slice(0, n_plants))

    def at(self, numbers: slice) -> ScaledLoops:
        """Return the loops around some of the vehicles."""
        angle, fixed = (None if part is None else part[numbers] for part in (self.angle, self.fixed))
        plants, body = self.plants.at(numbers), self.body[numbers]
        return self._replace(plants=plants, body=body, rate=self.rate[numbers], angle=angle, fixed=fixed)

    def around(self, several: Iterable[Plant]) -> Iterator[ScaledLoops]:
        """Yield the loops of the same controller around other vehicles, one by one as they are wanted.

        Parameters
        ----------
        several : iterable of Plant
            Each with the delays and the modes of these.
        """
        own = self.plants.undelayed(self.frequency_hz)
        for plants in several:
            ratio = plants.undelayed(self.frequency_hz)
            ratio /= own
            angle, fixed = (None if part is None else part * ratio for part in (self.angle, self.fixed))
            rate, body = self.rate * ratio, self.body * ratio
            yield self._replace(plants=plants, body=body, rate=rate, angle=angle, fixed=fixed)

    def of(self, controller: AxisController) -> ScaledLoops:
        """Return the loops of another controller around the same vehicles."""
        return next(_each_of((self,), controller))


def scaled_loops(controller: AxisController, plants: Plant, known_hz: float) -> ScaledLoops:
    """Close the loops of a controller around vehicles, apart by what scales with its gains.

    Parameters
    ----------
    controller : AxisController
    plants : Plant
        The estimate, then vehicles drawn around it.
    known_hz : float
        Up to where measurement supports the model.
    """
    frequency_hz = (grid_hz if plants.modes is None else fine_grid_hz)(controller.period_s)
    body = plants.response(frequency_hz, controller.period_s)
    return _around(body, plants, known_hz, _answers(controller, frequency_hz))


class _Answers(NamedTuple):
    """What a controller makes of the rate: the parts of `ScaledLoops` without the vehicle."""

    controller: AxisController
    frequency_hz: FloatArray
    rate: ComplexArray
    angle: ComplexArray | None
    fixed: ComplexArray | None


def _answers(controller: AxisController, frequency_hz: FloatArray) -> _Answers:
    paths = Paths(controller, frequency_hz)
    if controller.angle_gain_per_s is None:
        return _Answers(controller, frequency_hz, paths.on_rate, None, None)
    # The feed-forward is on the path of the set-point alone, and no gain scales it.
    scaling = paths.on_angle_by_error
    fixed = None if controller.feed_forward is None else paths.on_angle - scaling
    return _Answers(controller, frequency_hz, paths.on_rate, scaling, fixed)


def _each_of(several: Iterable[ScaledLoops], controller: AxisController) -> Iterator[ScaledLoops]:
    """Yield the loops of another controller around the same vehicles, one by one as they are wanted.

    Its answers are computed once: all loops are over the same frequencies.
    """
    answers = None
    for one in several:
        if controller.period_s != one.controller.period_s:
            yield scaled_loops(controller, one.plants, one.known_hz)
            continue
        answers = answers or _answers(controller, one.frequency_hz)
        yield _around(one.body, one.plants, one.known_hz, answers)


def _around(body: ComplexArray, plants: Plant, known_hz: float, answers: _Answers) -> ScaledLoops:
    """Close the loops of a controller around the answers of vehicles."""
    controller, frequency_hz, rate, *others = answers
    angle, fixed = (None if part is None else body * part for part in others)
    return ScaledLoops(controller, plants, known_hz, frequency_hz, body, body * rate, angle, fixed)


class AloneFigures(NamedTuple):
    """Figures of loops around one vehicle each, as it is told; both (n_loops,).

    ``full`` is None where no angle loop is known.
    """

    rate: LoopFigures
    full: LoopFigures | None

    @property
    def outer(self) -> LoopFigures:
        """With all that closes it."""
        return self.rate if self.full is None else self.full


def figures_alone(loops: Sequence[ScaledLoops]) -> AloneFigures:
    """Return the figures of many loops at once, each around the first of its vehicles.

    Parameters
    ----------
    loops : sequence of ScaledLoops
        At least one, all of one axis and over the same frequencies.
    """
    first = loops[0]
    poles = np.array([integrators(one.controller) for one in loops])
    runs_away = np.array([one.plants.damping[0] > 0.0 for one in loops])
    rate = np.stack([one.rate[0] for one in loops])
    whole = [known for one in loops if (known := one.first(1).whole()) is not None]
    full = None
    if len(whole) == len(loops):
        full = figures_of(first.frequency_hz, np.concatenate(whole), poles + 1, runs_away)
    return AloneFigures(figures_of(first.frequency_hz, rate, poles, runs_away), full)


def spare(margins: LoopMargins, limits: Limits) -> float:
    """Return how much of the limits the worst vehicles keep, in the worst of figures and loops.

    Returns
    -------
    float
        1 where the lower end of an interval is just at its limit, 0 where a loop may be unstable.
    """
    return float(np.min(each_spare(margins, limits)))


def each_spare(margins: LoopMargins, limits: Limits) -> FloatArray:
    """Return how much of each limit the worst vehicles keep.

    Returns
    -------
    ndarray, shape (4,) or (8,)
        Gain up, gain down, phase, disk of the rate loop and, where it is known, of the whole one; zero where
        a loop is unstable, infinite where it does not have the figure.
    """
    loops = [one for one in (margins.rate, margins.full) if one is not None]
    return np.concatenate([_spare(one, limits) for one in loops])


def _spare(margins: Margins, limits: Limits) -> FloatArray:
    if not margins.stable:
        return np.zeros(4)
    return np.array(
        [
            _ratio(margins.gain_margin_db, limits.gain_db),
            _ratio(margins.gain_margin_down_db, limits.gain_db),
            _ratio(margins.phase_margin_deg, limits.phase_deg),
            _ratio(margins.disk_margin, limits.disk),
        ]
    )


def _ratio(figure: Estimated | None, limit: float) -> float:
    """Return the lower end over the limit; a figure that the loop does not have is no limit to it."""
    if figure is None or limit <= 0.0:
        return np.inf
    return max(figure.ci95[0], 0.0) / limit


class Kept(NamedTuple):
    """Part of the limits that loops keep: of the vehicles as they fly, and in the worst other condition."""

    as_flown: float
    otherwise: float

    @property
    def enough(self) -> Kept:
        """What other gains must keep: the limits, or as much of them as these do."""
        return Kept(min(1.0, self.as_flown), min(1.0, self.otherwise))


class HeldLoops(NamedTuple):
    """Loops that keep the limits: of the vehicles that the next flight allows, and as these may be otherwise.

    ``part`` of the limits is required in the other conditions: all of them, or what flew. ``drawn`` is that
    of the drawn vehicles as they fly; the estimate keeps all.
    """

    loops: ScaledLoops
    otherwise: tuple[ScaledLoops, ...] = ()
    part: float = 1.0
    drawn: float = 1.0

    def kept(self, limits: Limits, factor: float = 1.0) -> Kept:
        """Return how much of what is required is kept, with P, I and D times a factor."""
        otherwise = (spare(one.margins(factor), limits) / self.part for one in self.otherwise)
        as_flown = spare(self.loops.margins(factor), limits) / self.drawn
        if self.drawn < 1.0:
            as_flown = min(as_flown, spare(self._estimate().margins(factor), limits))
        return Kept(as_flown, min(otherwise, default=np.inf))

    def _estimate(self) -> ScaledLoops:
        """Return the loop around the estimate alone, without what nobody measured."""
        return self.loops.first(1)._replace(known_hz=np.inf)

    def keep(self, limits: Limits, enough: Kept, factor: float = 1.0) -> bool:
        """Tell whether enough is kept, with P, I and D times a factor."""
        several, leasts = self._required(enough)
        return all(one.keep(limits, least, factor) for one, least in zip(several, leasts, strict=True))

    def keep_with(
        self, controller: AxisController, limits: Limits, enough: Kept, promised: LoopMargins | None = None
    ) -> bool:
        """Tell whether enough is kept with another controller.

        Parameters
        ----------
        controller : AxisController
        limits : Limits
        enough : Kept
        promised : LoopMargins, optional
            Of the vehicles as they fly with it, where they are known.
        """
        several, leasts = self._required(enough)
        if promised is not None:
            if spare(promised, limits) < leasts[0]:
                return False
            several, leasts = several[1:], leasts[1:]
        # One after the other: other conditions count only where the vehicles as they fly keep enough.
        loops = _each_of(several, controller)
        return all(one.keep(limits, least) for one, least in zip(loops, leasts, strict=True))

    def _required(self, enough: Kept) -> tuple[list[ScaledLoops], list[float]]:
        """Return all loops, and how much of the limits is enough for each."""
        as_flown, otherwise = enough.enough
        told = {} if self.drawn == 1.0 else {as_flown: self._estimate()}
        several = [self.loops, *told.values(), *self.otherwise]
        return several, [self.drawn * as_flown, *told, *(self.part * otherwise for _ in self.otherwise)]

    def first(self, n_plants: int) -> HeldLoops:
        """Return the loops around the first of the vehicles."""
        return self._replace(
            loops=self.loops.first(n_plants), otherwise=tuple(one.first(n_plants) for one in self.otherwise)
        )

    def no_less_than_flown(self, limits: Limits) -> HeldLoops:
        """Return the loops of which no more is required in the other conditions than they kept as flown."""
        part = min(self._replace(part=1.0).kept(limits).otherwise, 1.0)
        return self._replace(part=part) if part > 0.0 else self._replace(otherwise=())

    def as_told(self, limits: Limits, least: float) -> HeldLoops:
        """Return the loops of which the estimate keeps the limits, and the drawn ones what they flew with.

        These keep at least a part of the limits in any case.
        """
        drawn = min(max(self._replace(drawn=1.0).kept(limits).as_flown, least), 1.0)
        return self.no_less_than_flown(limits)._replace(drawn=drawn)

    def nearer(self, told: HeldLoops, part: float) -> HeldLoops:
        """Return the loops of which a part more is required than of others of the same vehicles, up to all.

        Parameters
        ----------
        told : HeldLoops
            Of which less is required.
        part : float
            Of the way from there.
        """
        least = told.part if told.otherwise else 0.0
        required = least + part * (self.part - least)
        drawn = told.drawn + part * (self.drawn - told.drawn)
        return self._replace(otherwise=self.otherwise if required > 0.0 else (), part=required, drawn=drawn)


def spare_of(figures: LoopFigures, limits: Limits) -> FloatArray:
    """Return how much of each limit loops keep, one by one: `spare` without an interval.

    Returns
    -------
    ndarray, shape (n_loops, 4)
        Gain up, gain down, phase, disk; infinite where the loop does not have the figure, below zero by how
        much an unstable one is beyond minus one.
    """
    told = np.stack(
        [
            20.0 * np.log10(figures.gain_margin) / max(limits.gain_db, _NOTHING),
            20.0 * np.log10(figures.gain_margin_down) / max(limits.gain_db, _NOTHING),
            np.degrees(figures.phase_margin_rad) / max(limits.phase_deg, _NOTHING),
            figures.disk_margin / max(limits.disk, _NOTHING),
        ],
        axis=1,
    )
    told = np.where(np.isnan(told), np.inf, told)
    return np.where(figures.stable[:, np.newaxis], told, np.minimum(told, 0.0))
