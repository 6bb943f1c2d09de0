"""Structures for tests that look at no published one."""

from __future__ import annotations

from typing import Final

from quadid_logs.identify.structures import STRUCTURES

#: What is recommended is one of these; the published ones beside them cost a sixth of an identification.
ACTUATED: Final = tuple(one for one in STRUCTURES if one.actuated)
