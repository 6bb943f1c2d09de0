"""A page out of the Markdown that this package writes: one text for terminals and browsers."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING, Final

from quadid_logs.report.cells import Cell, Table
from quadid_logs.report.pages import environment

if TYPE_CHECKING:
    from markdown_it.token import Token

#: What our texts are written in. Links are not: a log's texts may hold any.
_RULES: Final = ("heading", "list", "table", "backticks", "emphasis", "image")


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
    from markdown_it import MarkdownIt

    def image(_renderer: object, tokens: list[Token], place: int, _options: object, _env: object) -> str:
        token = tokens[place]
        content = (images or {}).get(str(token.attrs["src"]))
        if content is None:
            return ""
        source = f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"
        name = escape(token.content)
        return f'<figure><img src="{source}" alt="{name}"><figcaption>{name}</figcaption></figure>'

    parser = MarkdownIt("zero").enable(list(_RULES))
    parser.add_render_rule("image", image)
    blocks = list(_blocks(parser.parse(text)))
    title = "quadid-logs"
    if blocks and blocks[0][0].tag == "h1":
        title = blocks.pop(0)[1].content
    sections: list[list[str | Table]] = [[]]
    for block in blocks:
        if block[0].type == "heading_open" and sections[-1]:
            sections.append([])
        if block[0].type == "table_open":
            sections[-1].append(_table(block))
            continue
        # A figure stands in no paragraph.
        is_image = [child.type for child in block[1].children or ()] == ["image"]
        shown = block[1:-1] if is_image else block
        sections[-1].append(parser.renderer.render(shown, parser.options, {}))
    page: str = environment().get_template("document.html").render(title=title, sections=sections)
    return page


def _blocks(tokens: list[Token]) -> Iterator[list[Token]]:
    """Yield the tokens of each heading, paragraph, list and table."""
    block: list[Token] = []
    for token in tokens:
        block.append(token)
        if token.level == 0 and token.nesting <= 0:
            yield block
            block = []


def _table(tokens: list[Token]) -> Table:
    """Return a table as every page lays it out."""
    rows: list[list[str]] = []
    for token in tokens:
        if token.type == "tr_open":
            rows.append([])
        elif token.type == "inline":
            rows[-1].append(token.content)
    head, *others = rows
    cells = tuple(tuple(Cell(text=text) for text in row) for row in others)
    return Table(caption="", head=tuple(head), rows=cells)
