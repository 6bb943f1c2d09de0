"""A server without sockets and workers, for what needs neither."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.serve.asgi import Site, site


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Site]:
    """Give a server that does no work, with an empty store."""
    with site(tmp_path / "store") as made:
        yield made
