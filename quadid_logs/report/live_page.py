"""live.html: what a flight shows while it is flown, for a browser; a page that renews itself each second."""

from __future__ import annotations

from collections.abc import Sequence

from quadid_logs.live import LiveFigures, axis_words, notes
from quadid_logs.numerals import number
from quadid_logs.report.pages import environment
from quadid_logs.untrusted import printable


def live_page(
    figures: LiveFigures, *, log: str, clock: str, sentences: Sequence[str] = (), flying: bool = True
) -> str:
    """Return the page; every text is escaped by the template.

    Parameters
    ----------
    log : str
        What is recorded, in a sentence.
    clock : str
        When the page was made.
    sentences : sequence of str
        What happened to the recording.
    flying : bool
        Whether the page is to renew itself.

    Returns
    -------
    str
        A complete HTML document that asks no host for anything.
    """
    page: str = (
        environment()
        .get_template("live.html")
        .render(
            hint=printable(figures.hint, 400),
            axes=[
                {
                    "axis": axis.axis,
                    "words": axis_words(axis).removeprefix(f"{axis.axis} "),
                    # How far its interval is from the one that is wanted.
                    "fraction": axis.fraction(figures.target),
                    "is_enough": axis.more_s == 0.0,
                }
                for axis in figures.axes
            ],
            target=number(100.0 * figures.target, 2),
            notes=[printable(note, 400) for note in notes(figures)],
            flown=f"{figures.flown_s:.0f}",
            log=printable(log, 400),
            clock=clock,
            sentences=[printable(sentence, 400) for sentence in sentences],
            flying=flying,
        )
    )
    return page
