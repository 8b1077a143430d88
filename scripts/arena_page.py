"""Take a finished arena into the docs: ``scripts/arena_page.py RUN`` writes arena.json, the tables and the figure."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from torquebench.arena.pages import markdown
from torquebench.arena.record import Record, read_record

DOCS = Path(__file__).resolve().parents[1] / "docs"
PICTURE = "images/arena.svg"
MARKS = re.compile(r"<!-- arena -->\n.*?<!-- /arena -->", re.DOTALL)


def page(text: str, record: Record) -> str:
    """Return the page with the tables of an arena between its marks.

    Args:
        text: The page as it is.
        record: The arena.
    """
    tables = markdown(record, PICTURE, heading="## What came out")
    return MARKS.sub(lambda _: f"<!-- arena -->\n{tables}<!-- /arena -->", text)


if __name__ == "__main__":
    run = Path(sys.argv[1])
    found = read_record(run)
    (DOCS / "arena.json").write_bytes((run / "arena.json").read_bytes())
    (DOCS / PICTURE).write_bytes((run / "figures/fronts.svg").read_bytes())
    (DOCS / "arena.md").write_text(page((DOCS / "arena.md").read_text(encoding="utf-8"), found), encoding="utf-8")
