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

#: The public names of each module.
_NAMES = {
    "api.analysis": ("Analysis", "analyze", "analyze_pooled"),
    "api.model": ("FlightPrediction", "IdentifiedModel"),
    "api.verbs": ("check", "compare", "plan", "predictor", "repeat", "tune"),
    "bifilar": ("Bifilar", "swing"),
    "data.closed_loop": ("ClosedLoop",),
    "data.flight": ("FlightData",),
    "data.model": ("Model", "Parameter"),
    "data.off_nominal": ("Ranges",),
    "data.result": ("Result",),
    "data.settings": ("AlignSettings", "IdentifySettings", "Settings"),
    "data.tuning": ("Limits",),
    "data.vehicle": ("Vehicle",),
    "errors": ("QuadidError",),
    "fleets": ("fleet",),
    "identify.structures": ("TERMS", "own_structure"),
    "identify.terms": ("RateTerm",),
    "load": ("read_log",),
    "notebook": ("matplotlib_figures", "plotly_figures", "show"),
    "report": ("result_dict", "write_report"),
    "report.schema": ("result_schema",),
    "simulator": ("simulate",),
    "vehicle_file": ("read_vehicle",),
}
_HOMES = {name: f"{__name__}.{module}" for module, names in _NAMES.items() for name in names}

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
