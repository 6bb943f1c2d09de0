"""What forbids to recommend gains for an axis: each reason by a code of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from quadid_logs.control.torque_noise import Spectrum
from quadid_logs.data.catalogue import CATALOGUE, CAVEATS, MOST_SATURATED
from quadid_logs.data.closed_loop import AxisLoop, Plant
from quadid_logs.data.controller import AxisController, FlownControllers, RemarkKind, ReplayReason
from quadid_logs.data.diagnosis import Diagnosis, Finding, Verdict
from quadid_logs.data.flight import FlightData
from quadid_logs.data.log import FlightLog
from quadid_logs.data.tuning import GainNames
from quadid_logs.diagnose.advice import advice_for, next_steps, to_a_usable_axis
from quadid_logs.diagnose.findings import finding, rounded
from quadid_logs.sentences import continued
from quadid_logs.vocabulary import AXES

#: With P and D scaled down in more of the rows, the gains of the parameters are not those that flew.
_RARELY: Final = 0.05
#: With more of the samples at the mixer's limits, higher gains would only reach them sooner.
_NEAR_LIMITS: Final = 0.05
_VERDICTS: Final[Mapping[Verdict, str]] = MappingProxyType(
    {
        "refused": "No model can be used",
        "caution": "Use the model with caution",
        "usable": "The model is usable",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """All that is known of one axis.

    Attributes
    ----------
    axis : str
    log : FlightLog
    data : FlightData
    diagnosis : Diagnosis
    controllers : FlownControllers or None
    found : AxisLoop or None
        What closing the loop has found.
    plants : Plant or None
        The estimate, then vehicles drawn around it.
    names : GainNames
    parameters : mapping of str to float
        That flew.
    n_pooled : int
        Logs behind the one model, 0 for one.
    differ : tuple of str
        Names of earlier logs whose model of the axis this flight contradicts.
    rows : Spectrum or None
        Of the command, in rows of the log that are faster than the data; None where nobody looked, or there
        are none.
    """

    axis: str
    log: FlightLog
    data: FlightData
    diagnosis: Diagnosis
    controllers: FlownControllers | None
    found: AxisLoop | None
    plants: Plant | None
    names: GainNames
    parameters: Mapping[str, float]
    n_pooled: int = 0
    differ: tuple[str, ...] = ()
    rows: Spectrum | None = None

    @property
    def log_hz(self) -> float:
        """Rate of the rows that show the command's noise."""
        return (
            1.0 / self.data.sample_period_s if self.rows is None else 2.0 * float(self.rows.frequency_hz[-1])
        )

    @property
    def limited_fraction(self) -> float:
        """Of the flight, in which this axis got less than was commanded."""
        described = self.data.input
        return 0.0 if described is None else described.limited_fraction[AXES.index(self.axis)]

    @property
    def at_limits(self) -> str:
        """The code for a flight that was at the mixer's limits too much to raise gains; "" for no other."""
        if self.limited_fraction > MOST_SATURATED:
            return "QL617"
        return "QL635" if self.limited_fraction > _NEAR_LIMITS else ""

    @property
    def hides_a_notch(self) -> bool:
        """Whether a notch follows what neither the parameters nor the log hold."""
        remarks = () if self.controllers is None else self.controllers.remarks
        return any(one.kind is RemarkKind.NOTCH_UNKNOWN for one in remarks)

    @property
    def controller(self) -> AxisController | None:
        """Of this axis, where the parameters tell it."""
        return None if self.controllers is None else self.controllers.axes.get(self.axis)


def obstacles(case: Case) -> Iterator[Finding]:
    """Yield all that forbids to recommend gains, the most fundamental first."""
    before = list(_before_the_loop(case))
    yield from before
    yield from _loop(case, said=bool(before))


def _before_the_loop(case: Case) -> Iterator[Finding]:
    """Yield what forbids it whatever the loop is."""
    if case.n_pooled:
        yield _refusal("QL623", case, {"logs": case.n_pooled})
    if case.differ:
        yield _refusal("QL626", case, {"logs": list(case.differ)})
    verdict = case.diagnosis.axes.get(case.axis)
    by_earlier = case.found is not None and case.found.by_earlier
    if verdict is None or not (verdict.verdict == "usable" or has_only_caveats(case) or by_earlier):
        told: dict[str, object] = {}
        title = ""
        if verdict is not None:
            told = {"verdict": verdict.verdict, "codes": list(verdict.reasons)}
            codes = " ".join(verdict.reasons)
            title = f"{_VERDICTS[verdict.verdict]}: {continued(verdict.sentence.rstrip('.'))} [{codes}]"
        steps = next_steps((case.log, one) for one in to_a_usable_axis(case.diagnosis, case.axis))
        yield _refusal("QL615", case, told, title, advice=" ".join(steps))
    yield from _controller(case)
    if case.controllers is not None and case.controllers.version_read == "unknown":
        yield _refusal("QL621", case, {"law_of_version": case.controllers.version_note})
    # The vehicle holds other gains than those that flew.
    shaping = () if case.controller is None else (*case.controller.gains, *case.names.scaled)
    at_end = case.log.parameters
    other = [name for name in dict.fromkeys(shaping) if at_end.get(name) != case.parameters.get(name)]
    if other:
        yield _refusal("QL622", case, {"parameters": other})
    yield from _replay(case)
    # A flexible mode in what the model leaves of any axis: the frame is one.
    mode = next((one for one in case.diagnosis.findings if one.code == "QL525"), None)
    if mode is not None:
        yield _refusal("QL619", case, {"axes": list(mode.axes), **mode.evidence})


def _refusal(
    code: str, case: Case, evidence: Mapping[str, object], title: str = "", advice: str = ""
) -> Finding:
    return finding(code, "warning", evidence, axes=(case.axis,), title=title, advice=advice)


def has_only_caveats(case: Case) -> bool:
    """Tell whether an axis is to be used with caution for caveats alone that its loop's intervals hold.

    Returns
    -------
    bool
        What decides about gains is the response around the crossover: that is known there, and nothing
        contradicts it.
    """
    verdict, found = case.diagnosis.axes.get(case.axis), case.found
    if verdict is None or found is None or found.margins is None or found.contradicted:
        return False
    return verdict.verdict == "caution" and crosses_where_known(found) and set(verdict.reasons) <= CAVEATS


def crosses_where_known(loop: AxisLoop) -> bool:
    """Tell whether measurement supports the model of an axis up to the crossover of its rate loop."""
    crossover_hz = None if loop.margins is None else loop.margins.rate.crossover_hz
    return crossover_hz is not None and crossover_hz.value <= loop.known_hz


def tells_too_little(diagnosis: Diagnosis, axis: str) -> bool:
    """Tell whether all that speaks against the model of an axis is how little the flight tells of it.

    Returns
    -------
    bool
        Nothing contradicts another model then, of a flight that tells more.
    """
    against = {
        one.code
        for one in diagnosis.findings
        if (not one.axes or axis in one.axes) and one.level != "info" and CATALOGUE[one.code].scope == "model"
    }
    return against <= CAVEATS


def _controller(case: Case) -> Iterator[Finding]:
    """Yield that the controller is not known as a whole."""
    remarks = () if case.controllers is None else case.controllers.remarks
    mine = [one for one in remarks if one.axis in ("", case.axis)]
    if case.controller is None:
        missing = [name for one in mine for name in one.values if one.axis]
        log, advice = case.log, advice_for(case.log.autopilot)
        todo = advice.controller_note(log.version)
        if not todo and log.format == "tlog" and not any(one in log.parameters for one in case.names.scaled):
            # The ground station was not sent them: the log on the card holds them all.
            todo = advice.logging(log.format, log.parameters, log.version)
        yield _refusal("QL611", case, {"parameters": missing[:8]}, advice=todo)
    passed = case.data.gyro_filter
    for one in mine:
        # Rates that passed the loop's filters were delayed by a notch that nobody knows, too.
        behind_filters = passed.low_pass_hz > 0.0 or passed.notches or passed.tracked
        if one.kind is RemarkKind.NOTCH_UNKNOWN and not behind_filters:
            yield _refusal("QL620", case, dict(one.values))
        if one.kind is RemarkKind.ANGLE_LOOP_UNKNOWN:
            yield _refusal("QL643", case, dict(one.values))
        logged = (term for term in case.log.controller_terms if term.axis == case.axis)
        if one.kind is RemarkKind.SLEW_LIMIT and not any("scale" in term.values for term in logged):
            yield _refusal("QL616", case, dict(one.values))
    # Missing, infinite, or no number, which is not larger than zero either.
    unknown = [name for name in case.names.scaled if not 0.0 <= case.parameters.get(name, -1.0) < np.inf]
    if case.controller is not None and unknown:
        yield _refusal("QL611", case, {"parameters": unknown})


def _replay(case: Case) -> Iterator[Finding]:
    """Yield that the controller of the parameters was not seen to fly; without a model nobody looked."""
    if case.controller is None or case.found is None:
        return
    replay = case.found.replay
    if replay is None or replay.reason is ReplayReason.NO_ROWS:
        log = case.log
        logging = advice_for(log.autopilot).logging(log.format, log.parameters, log.version)
        yield _refusal("QL613", case, {}, advice=logging)
    elif replay.reason is ReplayReason.ROUNDED:
        yield _refusal("QL644", case, {})
    elif replay.reason is ReplayReason.SLEW_LIMITED and replay.numbers.get("fraction", 1.0) > _RARELY:
        yield _refusal("QL616", case, {name: rounded(one) for name, one in replay.numbers.items()})
    elif not replay.agrees:
        reason = "" if replay.reason is None else replay.reason.value
        yield _refusal("QL612", case, {"reason": reason, "parameter": replay.parameter})


def _loop(case: Case, *, said: bool) -> Iterator[Finding]:
    """Yield that the loop is contradicted by what was measured, or does not hold together.

    Parameters
    ----------
    case : Case
    said : bool
        Whether something else forbids gains already.
    """
    if case.found is None or case.controller is None:
        return
    if case.found.contradicted:
        yield _refusal("QL614", case, {"known_to_hz": rounded(case.found.known_hz)})
    margins = case.found.margins
    if margins is None or case.plants is None:
        # Nobody closed one around a model that is not to be used, or with a controller that was not seen to
        # fly: the finding about that names its remedy, and this one would make up another cause.
        if not (said or case.found.contradicted):
            yield _refusal("QL625", case, {})
    elif not all(one.stable for one in (margins.rate, margins.full) if one is not None):
        yield _refusal("QL625", case, {"stable": False})
