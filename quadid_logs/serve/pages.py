"""The pages as HTML; every text is escaped by the templates, and a log's texts reach lists as JSON only."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

from starlette.responses import HTMLResponse

from quadid_logs.report.pages import environment
from quadid_logs.version import __version__

#: One stylesheet: the report's, what a fleet's page adds, and ours.
_STYLES: Final = (
    ("quadid_logs.report", "templates/report.css"),
    ("quadid_logs.fleets", "templates/fleet.css"),
    ("quadid_logs.serve", "static/serve.css"),
)


def page(template: str, *, status: int = 200, **values: Any) -> HTMLResponse:
    """Return a page."""
    text = environment("quadid_logs.serve", "quadid_logs.fleets").get_template(template)
    return HTMLResponse(text.render(version=__version__, **values), status)


def start_page(problem: str, *, status: int = 200) -> HTMLResponse:
    """Return the page that takes the token.

    Parameters
    ----------
    problem : str
        With the one that was given.
    """
    return page("start.html", status=status, problem=problem)


def vehicle_page(history: Path, vehicle: str) -> HTMLResponse | None:
    """Return the page about a vehicle's flights: what changed when, each quantity over all of them.

    Parameters
    ----------
    history : Path
        A fleet's store.

    Returns
    -------
    HTMLResponse or None
        None where the store holds no flight of it.
    """
    from quadid_logs.fleets.history import read_fleet
    from quadid_logs.fleets.page import vehicle_values

    fleet = read_fleet(history)
    flights = (flight for each in fleet.histories for flight in each.flights)
    links = {f"{flight.sha256}-{flight.number}.html": f"/reports/{flight.sha256}" for flight in flights}
    values = vehicle_values(fleet, vehicle, links)
    return None if values is None else page("vehicle.html", **values)


@cache
def static_files() -> dict[str, tuple[str, bytes]]:
    """Return type and content of the two files that all pages share, by name."""
    style = "\n".join(resources.files(package).joinpath(name).read_text("utf-8") for package, name in _STYLES)
    script = resources.files("quadid_logs.serve").joinpath("static/serve.js").read_bytes()
    return {"serve.css": ("text/css", style.encode()), "serve.js": ("text/javascript", script)}
