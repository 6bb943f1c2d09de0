"""What a shell offers when the tab key is pressed inside an argument."""

from __future__ import annotations

from collections.abc import Iterable

Offer = list[tuple[str, str]]


def finding_codes(incomplete: str) -> Offer:
    """Return the codes of findings with their titles."""
    from quadid_logs.data.catalogue import CATALOGUE

    return _matching(((entry.code, entry.title) for entry in CATALOGUE.values()), incomplete)


def scenarios(incomplete: str) -> Offer:
    """Return the simulated flights, each with its sentence."""
    from quadid_logs.simulator import SCENARIOS

    return _matching(((one.name, one.sentence) for one in SCENARIOS.values()), incomplete)


def structures(incomplete: str) -> Offer:
    """Return the model structures."""
    from quadid_logs.data.settings import STRUCTURES

    return _matching(((name, "") for name in STRUCTURES), incomplete)


def autopilots(incomplete: str) -> Offer:
    """Return the autopilots that can be simulated and planned for."""
    from quadid_logs.writers import AUTOPILOT_OF_ENDING

    return _matching(((name, "") for name in sorted({*AUTOPILOT_OF_ENDING.values()})), incomplete)


def axes(incomplete: str) -> Offer:
    """Return roll, pitch and yaw."""
    from quadid_logs.vocabulary import AXES

    return _matching(((axis, "") for axis in AXES), incomplete)


def _matching(offers: Iterable[tuple[str, str]], incomplete: str) -> Offer:
    return [offer for offer in offers if offer[0].startswith(incomplete)]
