"""Names and prose use the terms that a control engineer would search for: no private metaphors."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: What was said before, and what it is called in the field.
REPLACED = {
    r"swift": "high-passed",
    r"telling": "informative",
    r"hardly moved": "poorly excited",
    r"rows? apart": "equation-by-equation",
    r"own[ _]gains?": "on-axis control effectiveness",
    r"cross[ _]gains?": "off-axis control effectiveness",
    r"one[ _]body": "single rigid body",
    r"uneven(ness|ly)?": "spin-up/spin-down asymmetry",
    r"(gyro|torque|damping|timing|lag|sensor)[ _]floors?": "systematic uncertainty",
    r"usual": "prior mean, or typical",
    r"asked[ _]for": "commanded",
    r"realised": "achieved",
    r"as[ _]seen": "as measured",
    r"wild": "outlier, corrupted",
    r"doubt(s|ed|ful)?": "caveat",
    r"lives": "vehicle history",
    r"stand(s|ing)?[ _]out": "outlier test",
    r"analysts?": "worker",
    r"analys(e[dr]?|able|ing)": "analyze and its forms, as the command is spelled",
    r"suspects?": "retry list",
    r"log ?books?": "logger model",
    r"stretch(es)?": "segment",
    r"pieces?": "chunk",
    r"(a|the|its|their|same|this|that|largest|smallest) shares?|shares? of": "fraction",
}
SEARCHED = sorted(
    path
    for pattern in (
        "quadid_logs/**/*",
        "docs/**/*.md",
        "docs/*.py",
        "study/*.py",
        "benchmarks/*.py",
        "fuzz/*.py",
        "*.md",
    )
    for path in ROOT.glob(pattern)
    if path.suffix in (".py", ".md", ".html", ".js", ".css")
)


#: To be looked for in a whole file at once: of its lines one by one, the search takes six times as long.
PATTERNS = {
    term: re.compile(rf"(?<![a-z])(?:{pattern.replace('[ _]', ' ')})(?![a-z])")
    for pattern, term in REPLACED.items()
}
#: Most files hold none of them, which one search tells.
ANY = re.compile(rf"(?<![a-z])(?:{'|'.join(REPLACED).replace('[ _]', ' ')})(?![a-z])")


def _words(text: str) -> str:
    """Separate the words of identifiers: both `FreshWater` and `fresh_water` become two."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", text)


def private_words(path: Path) -> list[str]:
    """Return each line with the term to use instead."""
    text = _words(path.read_text()).lower()
    if not ANY.search(text):
        return []
    return [
        f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, match.start()) + 1}: {match.group()!r} -> {term}"
        for term, pattern in PATTERNS.items()
        for match in pattern.finditer(text)
    ]


def test_no_private_word_stands_for_a_term_of_the_field() -> None:
    """One test for all files: pytest takes longer for each than the search."""
    found = [line for path in SEARCHED for line in private_words(path)]
    assert not found, "\n".join(found)
