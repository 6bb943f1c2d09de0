"""The simulator's own tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from quadid_logs.simulator import closed_loop


@pytest.fixture
def flown_each_time(kept_flights: None) -> Iterator[None]:
    """Fly what is to be flown: a kept flight is as it was the first time, whatever the seed makes of it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(closed_loop, "_fly", closed_loop._fly.__wrapped__)  # type: ignore[attr-defined]
        yield
