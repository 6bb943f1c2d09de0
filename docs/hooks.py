"""What MkDocs does beside building: a page per verb, and a navigation that forgets no page."""

from __future__ import annotations

from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

#: A typical call of each verb, and the page that explains it.
EXAMPLES = {
    "analyze": ("quadid-log analyze flight.bin", "tutorials/ardupilot.md"),
    "compare": ("quadid-log compare before.bin after.bin", "tutorials/ardupilot.md"),
    "repeat": ("quadid-log repeat one.bin two.bin three.bin -o repeat", "repeat.md"),
    "swing": ("quadid-log swing swing.bin --mass 1.6 --length 0.9 --distance 0.4", "swing.md"),
    "predict": ("quadid-log predict one.bin two.bin --on three.bin", "predict.md"),
    "plan": ("quadid-log plan --autopilot ardupilot -o plan", "plan.md"),
    "fetch": ("quadid-log fetch /dev/ttyACM0 --analyze", "fetch.md"),
    "live": ("quadid-log live udp:14550", "live.md"),
    "mcp": ("quadid-log mcp --allow logs/", "agents.md"),
    "tune": ("quadid-log tune flight.bin -o tune", "tune.md"),
    "check": ("quadid-log check next.bin --promise tune/flight", "tune.md"),
    "serve": ("quadid-log serve --open", "serve.md"),
    "info": ("quadid-log info flight.bin", "gallery.md"),
    "export": ("quadid-log export flight.bin -o series.csv", "tutorials/ardupilot.md"),
    "explain": ("quadid-log explain QL403", "findings.md"),
    "simulate": ("quadid-log simulate sysid-quad-x -o flight.bin", "writers.md"),
    "paper": ("quadid-log paper -o paper", "paper/paper.md"),
    "fleet": ("quadid-log fleet flights/ -o store", "fleet.md"),
    "fleet-report": ("quadid-log fleet-report store", "fleet.md"),
    "query": ('quadid-log query store "SELECT vehicle, count(*) FROM fleet GROUP BY vehicle"', "fleet.md"),
}


def verbs() -> dict[str, Any]:
    """Return the commands of the command line by name, in the order of its help."""
    import typer.main

    from quadid_logs.cli.app import make_app

    return dict(typer.main.get_command(make_app()).commands)  # type: ignore[attr-defined]


def verb_page(name: str, command: Any) -> str:
    """Return the page of a verb: what it does, how it is called, every argument and option."""
    example, more = EXAMPLES.get(name, ("", ""))
    parts = [f"# quadid-log {name}", (command.help or "").strip()]
    if example:
        parts.append(f"```console\n$ {example}\n```")
    rows = [
        f"| `{_written(each)}` | {(getattr(each, 'help', None) or '').replace('|', '&#124;')} |"
        for each in command.params
    ]
    parts.append("\n".join(["| argument or option | |", "|---|---|", *rows]))
    parts.append(
        "If no exit codes are named above, these hold. 0: done (`analyze`: usable). 1: finished, but at "
        "least one axis must not be trusted. 2: the input cannot be read, or the options are wrong. "
        "Existing files are not overwritten without `--force`."
    )
    if more:
        parts.append(f"More: [{more.removesuffix('.md')}](../{more}).")
    return "\n\n".join(parts) + "\n"


def _written(parameter: Any) -> str:
    """Return an argument or option as it is typed."""
    if parameter.param_type_name == "argument":
        return parameter.metavar or parameter.name.upper()
    value = "" if parameter.is_flag else f" {parameter.metavar or parameter.name.upper()}"
    return ", ".join(parameter.opts) + value


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the verbs, and put every page that the navigation does not name at its end."""
    pages = []
    for name, command in verbs().items():
        path = f"verbs/{name}.md"
        files.append(File.generated(config, path, content=verb_page(name, command)))
        pages.append({f"quadid-log {name}": path})
    navigation = [{**one} if isinstance(one, dict) else one for one in config.nav or []]
    for one in navigation:
        if isinstance(one, dict) and "Command line" in one:
            one["Command line"] = pages
    named = set(_paths(navigation))
    others = [page.src_uri for page in files.documentation_pages() if page.src_uri not in named]
    config.nav = [*navigation, *([{"More": others}] if others else [])]
    return files


def _paths(entry: Any) -> list[str]:
    """Return every path that a navigation holds."""
    if isinstance(entry, str):
        return [entry]
    parts = entry.values() if isinstance(entry, dict) else entry
    return [path for part in parts for path in _paths(part)]


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:  # noqa: ARG001
    """Take what lets the search work from disk from beside the page, not from another host."""
    above = "../" * page.url.count("/")
    return output.replace("https://unpkg.com/iframe-worker/shim", f"{above}javascripts/iframe-worker.js")
