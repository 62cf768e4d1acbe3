"""Every source that docstrings and pages cite by key is in the bibliography, and nothing else is."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "bibliography.md"
#: a name and a year, or a paper that has no year in its key
KEY = re.compile(r"\b(?:[a-z]+(?:19|20)\d\d\b|gong-yang\b|iec61966\b)")
#: what follows "Source:" up to the section
SOURCE = re.compile(r"\bSources?: ([^\s,.;:()]+)")
#: names of authors with a year, where a key belongs
PROSE = re.compile(r"\b[A-Z]\w+(?: et al\.| and [A-Z]\w+| & [A-Z]\w+),? \(?(?:19|20)\d\d\b")
ENTRY = re.compile(r"^- \*\*([\w-]+)\*\*: (.*?)(?=^- \*\*|^#|\Z)", re.MULTILINE | re.DOTALL)


def texts():
    """Path and text of all modules and pages but the bibliography itself."""
    files = [*ROOT.glob("ibrpipe/**/*.py"), *ROOT.glob("docs/**/*.md")]
    return {str(file.relative_to(ROOT)): file.read_text("utf-8") for file in sorted(files) if file != PAGE}


def entries():
    return {key: " ".join(text.split()) for key, text in ENTRY.findall(PAGE.read_text("utf-8"))}


def test_every_key_is_resolved():
    known = entries()
    missing = {f"{file}: {key}" for file, text in texts().items() for key in KEY.findall(text) if key not in known}
    assert not missing
    assert len(known) > 30


def test_what_follows_the_word_source_is_a_key():
    known, sources = entries(), [(file, key) for file, text in texts().items() for key in SOURCE.findall(text)]
    assert not [source for source in sources if source[1] not in known]
    assert len(sources) > 40


def test_no_paper_is_cited_by_its_authors_names():
    assert not {f"{file}: {words}" for file, text in texts().items() for words in PROSE.findall(text)}


def test_every_entry_is_cited_and_complete():
    cited = {key for text in texts().values() for key in KEY.findall(text)}
    known = entries()
    assert set(known) - cited <= {"max1999"}  # of the five papers; scene graphs come from it
    for key, text in known.items():
        year = re.search(r"(?:19|20)\d\d$", key)
        assert (year.group() if year else "") in text, key
        assert text.endswith((".", "10.7939/R3N87329N", "*")), key
        assert len(text) > 60, key
