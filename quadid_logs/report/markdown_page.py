"""A page out of the few kinds of Markdown that this package writes: one text for terminals and browsers."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.pages import environment

_IMAGE: Final = re.compile(r"!\[(.*)\]\((.*)\)")
_NUMBERED: Final = re.compile(r"\d+\. ")
_LEAD: Final = re.compile(r"\*\*(.+?)\*\* ?(.*)", re.DOTALL)


class Kind(Enum):
    """What a block of a page is."""

    HEADING = "heading"
    PARAGRAPH = "paragraph"
    BULLETS = "bullets"
    NUMBERS = "numbers"
    TABLE = "table"
    IMAGE = "image"


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """One block: ``lead`` is set bold before ``text``; ``source`` is a picture as a data address."""

    kind: Kind
    text: str = ""
    lead: str = ""
    items: tuple[str, ...] = ()
    table: Table | None = None
    source: str = ""


def markdown_page(text: str, images: Mapping[str, bytes] | None = None) -> str:
    r"""Return a page of its own, with its pictures in it; every text is escaped.

    Parameters
    ----------
    text : str
        Begins with ``# title``; of headings ``##``, paragraphs, lists, tables and pictures.
    images : mapping of str to bytes, optional
        PNG files by the names that the text shows them under; others are left out.

    Examples
    --------
    >>> page = markdown_page("# Plan\n\n- a < b")
    >>> "<h1>Plan</h1>" in page, "<li>a &lt; b</li>" in page
    (True, True)
    """
    blocks = list(_blocks(text, images or {}))
    title = blocks.pop(0).text if blocks and blocks[0].kind is Kind.HEADING else "quadid-logs"
    sections: list[list[Block]] = [[]]
    for block in blocks:
        if block.kind is Kind.HEADING and sections[-1]:
            sections.append([])
        sections[-1].append(block)
    page: str = environment().get_template("document.html").render(title=title, sections=sections, kinds=Kind)
    return page


def _blocks(text: str, images: Mapping[str, bytes]) -> Iterator[Block]:
    """Yield the blocks between empty lines."""
    for part in re.split(r"\n\s*\n", text.strip()):
        lines = part.splitlines()
        image = _IMAGE.fullmatch(part.strip())
        if image is not None:
            if image[2] in images:
                content = base64.b64encode(images[image[2]]).decode("ascii")
                yield Block(kind=Kind.IMAGE, text=image[1], source=f"data:image/png;base64,{content}")
        elif lines[0].startswith("#"):
            yield Block(kind=Kind.HEADING, text=lines[0].lstrip("# "))
        elif lines[0].startswith("|"):
            head, _rule, *rows = (
                [cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines
            )
            yield Block(
                kind=Kind.TABLE,
                table=Table(
                    caption="",
                    head=tuple(head),
                    rows=tuple(tuple(Cell(text=cell) for cell in row) for row in rows),
                ),
            )
        elif lines[0].startswith("- "):
            yield Block(kind=Kind.BULLETS, items=tuple(_items(lines, "- ")))
        elif _NUMBERED.match(lines[0]):
            yield Block(kind=Kind.NUMBERS, items=tuple(_items(lines, "")))
        else:
            lead = _LEAD.fullmatch(part)
            yield Block(
                kind=Kind.PARAGRAPH,
                lead=lead[1] if lead else "",
                text=" ".join((lead[2] if lead else part).split()),
            )


def _items(lines: list[str], mark: str) -> Iterator[str]:
    """Yield the items of a list; an indented line goes on with the one before."""
    item = ""
    for line in lines:
        if line.startswith("  ") and item:
            item += f" {line.strip()}"
            continue
        if item:
            yield item
        item = line.removeprefix(mark) if mark else _NUMBERED.sub("", line, count=1)
    yield item
