"""The command line: one module per verb; `main` is the only place that catches.

Exit codes: 0 usable, 1 at least one axis must not be trusted, 2 unreadable
input or wrong usage, 130 interrupted, 141 the reader of the output went away, 143 terminated.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from types import FrameType

from quadid_logs.cli.failure import ReaderGoneError, exit_code_of, flush, report_problem
from quadid_logs.commands import PROGRAM, quoted

__all__ = ["main", "run"]

_INTERRUPTED, _TERMINATED = 130, 143


class TerminatedError(BaseException):
    """The system or a batch queue ends us; not an Exception, so that nothing on the way swallows it."""


def run() -> None:
    """Run the command line and leave with its exit code: the console entry.

    All our matrices are tall and thin: on these OpenBLAS spends longer waking
    its threads than computing (measured: 0.66 s instead of 0.01 s for 41 QR
    factorisations). It reads its setting once, before numpy is imported.

    What we import and compute is hardly ever cyclic garbage: to look for some as often as Python does took a
    twelfth of an analysis (measured: 2.21 s, and 2.03 s with this; the memory of one of 38 MB is the same).
    """
    gc.set_threshold(50_000)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, _terminate)
    sys.exit(main())


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    raise TerminatedError


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv : list of str, optional
        Arguments without the program's name; `sys.argv` by default.

    Returns
    -------
    int
        The exit code.
    """
    arguments = sys.argv[1:] if argv is None else list(argv)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115 - for as long as we run
    if sys.stdout is None:
        report_problem("error: standard output is closed. Send the output to a file, or to /dev/null.")
        return 2
    try:
        code = exit_code_of(lambda: _dispatch(arguments))
        return code or exit_code_of(_flushed)
    except KeyboardInterrupt:
        report_problem("interrupted: no file was left half-written.")
        return _INTERRUPTED
    except TerminatedError:
        report_problem("ended from outside: no file was left half-written.")
        return _TERMINATED
    except ReaderGoneError:
        return 141
    finally:
        # Drop what could not be written: it would raise again when Python closes stdout.
        try:
            sys.stdout.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _flushed() -> int:
    flush()
    return 0


def _dispatch(arguments: list[str]) -> int:
    """Parse the arguments and run their verb."""
    from quadid_logs.cli.app import command_of

    given = " ".join((PROGRAM, *map(quoted, arguments)))
    code = command_of(*arguments[:1])(args=arguments, prog_name=PROGRAM, standalone_mode=False, obj=given)
    if code == _INTERRUPTED:
        # Typer turns Ctrl-C into this code without a word.
        raise KeyboardInterrupt
    return int(code or 0)
