"""How a failure reaches the user: one clear line on stderr and an exit code."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable

from quadid_logs.errors import OutputError, QuadidError
from quadid_logs.untrusted import printable

_LONGEST = 600


class ReaderGoneError(Exception):
    """Nobody reads our output any more, as in ``quadid-log ... | head``."""


def exit_code_of(action: Callable[[], int]) -> int:
    """Run an action and return its exit code; a failure becomes one line and 2.

    With QUADID_DEBUG=1 the traceback is shown as well. Interruption and a
    closed pipe are passed on.
    """
    try:
        return action()
    except ReaderGoneError:
        raise
    except QuadidError as error:
        _report(f"error: {error}")
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        # What the system refused: a full disk, a lost network drive, an output that nobody takes.
        what = error.strerror or str(error) or type(error).__name__
        where = f" ({error.filename})" if error.filename is not None else ""
        told = f"{what}{where}. Check the disk, the temporary folder and the output folder."
        _report(f"error: {told}")
    except Exception as error:  # noqa: BLE001 - the one place that must let nothing through
        usage = getattr(error, "format_message", None)
        if usage is not None:
            context = getattr(error, "ctx", None)
            verb = "quadid-log" if context is None else context.command_path
            _report(f"error: {usage().removesuffix('.')}. See `{verb} --help`.")
        else:
            _report(
                f"error: unexpected {type(error).__name__}: {error}. This is a bug in quadid-logs: please "
                "report it with the log. Set QUADID_DEBUG=1 to see the details."
            )
    return 2


def _report(text: str) -> None:
    """Write one line, and the traceback of the present exception where debugging is on."""
    report_problem(text)
    if os.environ.get("QUADID_DEBUG") == "1":
        traceback.print_exc()


def report_problem(text: str) -> None:
    """Write one line to stderr."""
    sys.stderr.write(f"quadid-log: {printable(text, _LONGEST)}\n")


def flush() -> None:
    """Write out what `say` still holds.

    Raises
    ------
    ReaderGoneError, OutputError
        As `say`.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        raise OutputError(f"The output cannot be written: {error.strerror}.") from error


def say(line: str) -> None:
    """Write one line of a result to stdout.

    Raises
    ------
    ReaderGoneError
        If nobody reads it.
    OutputError
        If it cannot be written.
    """
    try:
        sys.stdout.write(f"{line}\n")
    except BrokenPipeError:
        raise ReaderGoneError from None
    except OSError as error:
        raise OutputError(f"The output cannot be written: {error.strerror}.") from error
    except UnicodeEncodeError:
        encoding = sys.stdout.encoding or "ascii"
        sys.stdout.write(line.encode(encoding, "replace").decode(encoding) + "\n")
