"""The application: its verbs, in the order of the help."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any

import typer

from quadid_logs.cli.analyze import analyze
from quadid_logs.cli.check import check
from quadid_logs.cli.compare import compare
from quadid_logs.cli.explain import explain
from quadid_logs.cli.export import export
from quadid_logs.cli.failure import say
from quadid_logs.cli.fetch import fetch
from quadid_logs.cli.fleet import fleet
from quadid_logs.cli.fleet_report import fleet_report
from quadid_logs.cli.info import info
from quadid_logs.cli.live import live
from quadid_logs.cli.mcp import mcp
from quadid_logs.cli.paper import paper
from quadid_logs.cli.plan import plan
from quadid_logs.cli.predict import predict
from quadid_logs.cli.query import query
from quadid_logs.cli.repeat import repeat
from quadid_logs.cli.serve import serve
from quadid_logs.cli.simulate import simulate
from quadid_logs.cli.swing import swing
from quadid_logs.cli.tune import tune
from quadid_logs.version import __version__


@lru_cache(maxsize=32)
def command_of(first: str = "") -> Callable[..., Any]:
    """Return the parser of `make_app`: whoever runs many commands has each built once."""
    return typer.main.get_command(make_app(first))


def make_app(first: str = "") -> typer.Typer:
    """Return the application; where the first word is a verb, with that one alone.

    Typer reads the annotations of every verb that it is given, which takes longer than many a verb does.
    Plain help without rich: it starts at once, and reads the same in a pipe.
    """
    app = typer.Typer(
        help=(
            "From a multirotor's flight log: a rotational state-space model with intervals, margins, and "
            "gains."
        ),
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        no_args_is_help=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_top)
    verbs = (
        analyze,
        tune,
        check,
        compare,
        repeat,
        predict,
        swing,
        plan,
        fetch,
        live,
        info,
        export,
        explain,
        simulate,
        paper,
        fleet,
        fleet_report,
        query,
        serve,
        mcp,
    )
    for verb in [one for one in verbs if one.__name__.replace("_", "-") == first] or verbs:
        # Given as such: what is made of the docstring is cut in mid-sentence.
        app.command(short_help=(verb.__doc__ or "").split("\n", 1)[0])(verb)
    return app


def _top(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and stop.")] = False,
) -> None:
    """Turn a multirotor's flight log into a rotational state-space model with error bars."""
    if version:
        say(f"quadid-log {__version__}")
        raise typer.Exit(0)
    if context.invoked_subcommand is None:
        say(context.get_help())
        raise typer.Exit(0)
