"""quadid-logs: a multirotor's flight log in, a rotational model with error bars out.

>>> import quadid_logs
>>> r = quadid_logs.analyze("sample_logs/sysid-quad-x.bin")
>>> r.model.B.shape
(3, 3)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from quadid_logs.version import __version__

if TYPE_CHECKING:
    from quadid_logs.api.analysis import Analysis, analyze, analyze_pooled
    from quadid_logs.api.model import FlightPrediction, IdentifiedModel
    from quadid_logs.api.verbs import check, compare, plan, predictor, repeat, tune
    from quadid_logs.bifilar import Bifilar, swing
    from quadid_logs.data.closed_loop import ClosedLoop
    from quadid_logs.data.flight import FlightData
    from quadid_logs.data.model import Model, Parameter
    from quadid_logs.data.off_nominal import Ranges
    from quadid_logs.data.result import Result
    from quadid_logs.data.settings import AlignSettings, IdentifySettings, Settings
    from quadid_logs.data.tuning import Limits
    from quadid_logs.data.vehicle import Vehicle
    from quadid_logs.errors import QuadidError
    from quadid_logs.fleets import fleet
    from quadid_logs.identify.structures import TERMS, own_structure
    from quadid_logs.identify.terms import RateTerm
    from quadid_logs.load import read_log
    from quadid_logs.notebook import matplotlib_figures, plotly_figures, show
    from quadid_logs.report import result_dict, write_report
    from quadid_logs.report.schema import result_schema
    from quadid_logs.simulator import simulate
    from quadid_logs.vehicle_file import read_vehicle

#: The module of each public name.
_HOMES = {
    "AlignSettings": "quadid_logs.data.settings",
    "Analysis": "quadid_logs.api.analysis",
    "Bifilar": "quadid_logs.bifilar",
    "ClosedLoop": "quadid_logs.data.closed_loop",
    "FlightData": "quadid_logs.data.flight",
    "FlightPrediction": "quadid_logs.api.model",
    "IdentifiedModel": "quadid_logs.api.model",
    "IdentifySettings": "quadid_logs.data.settings",
    "Limits": "quadid_logs.data.tuning",
    "Ranges": "quadid_logs.data.off_nominal",
    "Model": "quadid_logs.data.model",
    "Parameter": "quadid_logs.data.model",
    "QuadidError": "quadid_logs.errors",
    "RateTerm": "quadid_logs.identify.terms",
    "Result": "quadid_logs.data.result",
    "Settings": "quadid_logs.data.settings",
    "TERMS": "quadid_logs.identify.structures",
    "Vehicle": "quadid_logs.data.vehicle",
    "analyze": "quadid_logs.api.analysis",
    "analyze_pooled": "quadid_logs.api.analysis",
    "check": "quadid_logs.api.verbs",
    "compare": "quadid_logs.api.verbs",
    "fleet": "quadid_logs.fleets",
    "matplotlib_figures": "quadid_logs.notebook",
    "own_structure": "quadid_logs.identify.structures",
    "plan": "quadid_logs.api.verbs",
    "plotly_figures": "quadid_logs.notebook",
    "predictor": "quadid_logs.api.verbs",
    "read_log": "quadid_logs.load",
    "read_vehicle": "quadid_logs.vehicle_file",
    "repeat": "quadid_logs.api.verbs",
    "result_dict": "quadid_logs.report",
    "result_schema": "quadid_logs.report.schema",
    "show": "quadid_logs.notebook",
    "simulate": "quadid_logs.simulator",
    "swing": "quadid_logs.bifilar",
    "tune": "quadid_logs.api.verbs",
    "write_report": "quadid_logs.report",
}

__all__ = [
    "TERMS",
    "AlignSettings",
    "Analysis",
    "Bifilar",
    "ClosedLoop",
    "FlightData",
    "FlightPrediction",
    "IdentifiedModel",
    "IdentifySettings",
    "Limits",
    "Model",
    "Parameter",
    "QuadidError",
    "Ranges",
    "RateTerm",
    "Result",
    "Settings",
    "Vehicle",
    "__version__",
    "analyze",
    "analyze_pooled",
    "check",
    "compare",
    "fleet",
    "matplotlib_figures",
    "own_structure",
    "plan",
    "plotly_figures",
    "predictor",
    "read_log",
    "read_vehicle",
    "repeat",
    "result_dict",
    "result_schema",
    "show",
    "simulate",
    "swing",
    "tune",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562): importing the package stays quick."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
