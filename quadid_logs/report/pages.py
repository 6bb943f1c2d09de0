"""How every page is made: its texts are escaped, and a name that is missing is an error."""

from __future__ import annotations

import re
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

    made = Jinja(
        loader=ChoiceLoader([PackageLoader(name) for name in (*packages, "quadid_logs.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["by_sentence"] = by_sentence
    return made


def by_sentence(text: str) -> list[tuple[str, bool]]:
    """Return the sentences of a text, and whether each holds a command between backticks.

    A page that is printed to be shown to others leaves those out: its readers do not have the log.

    Examples
    --------
    >>> by_sentence("Keep the gains. `quadid-log tune a. B.bin` writes files. Land.")
    [('Keep the gains.', False), ('`quadid-log tune a. B.bin` writes files.', True), ('Land.', False)]
    """
    sentences = re.findall(r"(?:`[^`]*`|.)+?(?:(?<=[.!?])(?=\s+[A-Z`])|$)", text, re.DOTALL)
    return [(sentence.strip(), "`quadid-log " in sentence) for sentence in sentences if sentence.strip()]
