"""quadid-logs: a multirotor's flight log in, a rotational model with error bars out.

>>> from quadid_logs import analyze
>>> result = analyze("sample_logs/sysid-quad-x.bin")
>>> result.identification.recommended.B.shape
(3, 3)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from quadid_logs.version import __version__

if TYPE_CHECKING:
    from quadid_logs.data.result import Result
    from quadid_logs.data.settings import Settings
    from quadid_logs.data.vehicle import Vehicle
    from quadid_logs.errors import QuadidError
    from quadid_logs.load import read_log
    from quadid_logs.notebook import matplotlib_figures, plotly_figures, show
    from quadid_logs.pipeline import analyze, analyze_pooled
    from quadid_logs.report import result_dict, write_report
    from quadid_logs.vehicle_file import read_vehicle

__all__ = [
    "QuadidError",
    "Result",
    "Settings",
    "Vehicle",
    "__version__",
    "analyze",
    "analyze_pooled",
    "matplotlib_figures",
    "plotly_figures",
    "read_log",
    "read_vehicle",
    "result_dict",
    "show",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562): importing the package stays quick."""
    homes = {
        "analyze": "quadid_logs.pipeline",
        "analyze_pooled": "quadid_logs.pipeline",
        "matplotlib_figures": "quadid_logs.notebook",
        "plotly_figures": "quadid_logs.notebook",
        "show": "quadid_logs.notebook",
        "read_log": "quadid_logs.load",
        "read_vehicle": "quadid_logs.vehicle_file",
        "result_dict": "quadid_logs.report",
        "write_report": "quadid_logs.report",
        "QuadidError": "quadid_logs.errors",
        "Result": "quadid_logs.data.result",
        "Settings": "quadid_logs.data.settings",
        "Vehicle": "quadid_logs.data.vehicle",
    }
    if name not in homes:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(homes[name]), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
