"""What a build adds: the report's chart library, and a README whose links hold outside of the repository.

plotly.min.js is all that the report needs of the plotly package, a tenth of its size: the wheel carries it,
with its licence, and the source does not. A checkout (editable) takes it from the installed package.
"""

from __future__ import annotations

import re
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface


class ChartLibrary(BuildHookInterface):  # type: ignore[type-arg]
    """Put plotly.min.js and its licence into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name the files of the installed plotly package, unless this is an editable install or an sdist."""
        if self.target_name != "wheel" or version == "editable":
            return
        plotly = distribution("plotly")
        files = {str(file).replace("\\", "/"): file for file in plotly.files or ()}
        licence = next(name for name in files if name.endswith("/LICENSE.txt") and ".dist-info/" in name)
        wanted = {"plotly/package_data/plotly.min.js": "plotly.min.js", licence: "plotly.LICENSE.txt"}
        for name, target in wanted.items():
            source = Path(str(plotly.locate_file(files[name])))
            build_data["force_include"][str(source)] = f"quadid_logs/report/vendored/{target}"


class Readme(MetadataHookInterface):
    """Make the README's relative links absolute."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Write the README for an index page, where there is no repository beside it."""
        base = f"{metadata['urls']['Source']}/blob/main/"
        raw = base.replace("https://github.com/", "https://raw.githubusercontent.com/").replace("/blob/", "/")
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = re.sub(r"!\[([^\]]*)\]\((?!https?:)([^)]+)\)", rf"![\1]({raw}\2)", text)
        text = re.sub(r"(?<!!)\[([^\]]*)\]\((?!https?:|#)([^)]+)\)", rf"[\1]({base}\2)", text)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
