"""How every page is made: its texts are escaped, and a name that is missing is an error."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def environment(*packages: str) -> Environment:
    """Return what renders the templates of the report, and those of other packages; each is compiled once.

    Parameters
    ----------
    *packages : str
        Packages with a folder ``templates`` of their own.
    """
    from jinja2 import ChoiceLoader, PackageLoader, StrictUndefined
    from jinja2 import Environment as Jinja

    return Jinja(
        loader=ChoiceLoader([PackageLoader(name) for name in (*packages, "quadid_logs.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
