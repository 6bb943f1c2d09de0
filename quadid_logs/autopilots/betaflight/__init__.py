"""Betaflight: its Blackbox fields, settings and mixer, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from quadid_logs.autopilots import LogFormat
from quadid_logs.autopilots.betaflight.family import BlackboxFamily
from quadid_logs.data.log import FlightLog
from quadid_logs.vocabulary import AXES

if TYPE_CHECKING:
    from quadid_logs.autopilots.generic.advice import Advice
    from quadid_logs.data.controller import FlownControllers, ReplayInput
    from quadid_logs.data.health import Line
    from quadid_logs.data.off_nominal import ThrustLaw
    from quadid_logs.data.tuning import FilterChoices, Tunable


class Betaflight(BlackboxFamily):
    """Betaflight of every version."""

    name = "betaflight"
    title = "Betaflight"

    def formats(self) -> tuple[LogFormat, ...]:
        """Blackbox, from the card or the flash chip."""
        from quadid_logs.autopilots.betaflight.log import read
        from quadid_logs.containers import blackbox

        suffixes = (".bbl", ".bfl")
        title = "Betaflight Blackbox"
        return (LogFormat("blackbox", title, blackbox.is_mine, read, suffixes, read_numbered=read),)

    def controllers(
        self,
        log: FlightLog,
        parameters: Mapping[str, float],
        *,
        period_s: float | None = None,  # noqa: ARG002
        axes: Sequence[str] = AXES,
    ) -> FlownControllers | None:
        """Take the header's settings, and what moves as it was on average."""
        from quadid_logs.autopilots.betaflight.controller import controllers

        return controllers(log, parameters, axes)

    def replay_inputs(
        self, log: FlightLog, controllers: FlownControllers, intervals: Sequence[tuple[float, float]]
    ) -> Mapping[str, ReplayInput]:
        """Take frames with their set-points, rates and terms."""
        from quadid_logs.autopilots.betaflight.replay import replay_inputs

        return replay_inputs(log, controllers, intervals)

    def tunable(
        self,
        parameters: Mapping[str, float],
        version: tuple[int, ...] | None = None,  # noqa: ARG002
    ) -> Tunable:
        """P, I and D by their names on the command line."""
        from quadid_logs.autopilots.betaflight.gains import tunable

        return tunable(parameters)

    def thrust_law(self, log: FlightLog, parameters: Mapping[str, float]) -> ThrustLaw:
        """``thrust_linear`` and ``vbat_sag_compensation``."""
        from quadid_logs.autopilots.betaflight.thrust_law import thrust_law

        return thrust_law(log, parameters)

    def filter_choices(
        self, log: FlightLog, parameters: Mapping[str, float], lines: Sequence[Line]
    ) -> FilterChoices:
        """gyro_lpf*, dterm_lpf*, rpm_filter_*."""
        from quadid_logs.autopilots.betaflight.filter_choices import filter_choices

        return filter_choices(log, parameters, lines)

    @property
    def advice(self) -> Advice:
        """Blackbox rate and the chirp mode."""
        from quadid_logs.autopilots.betaflight.advice import ADVICE

        return ADVICE


AUTOPILOT = Betaflight()
