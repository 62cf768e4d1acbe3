"""Write the generated pages: docs/cli.md, data_specs/*.schema.json and the tables of options in docs/renderers.

With --check: say which are out of date.
"""

import re
import sys
from pathlib import Path

from ibrpipe.cli.reference import reference
from ibrpipe.cli.schema import models, schema_text
from ibrpipe.renderers.option_text import option_table
from ibrpipe.renderers.registry import BUILT_IN, find_renderer

ROOT = Path(__file__).resolve().parent.parent


def pages() -> dict[Path, str]:
    """Return every generated file and the text it should have."""
    schemas = {ROOT / f"data_specs/{name}.schema.json": schema_text(name, model) for name, model in models().items()}
    renderers = {ROOT / f"docs/renderers/{name}.md": renderer_page(name) for name in BUILT_IN}
    return {ROOT / "docs/cli.md": reference(), **schemas, **renderers}


def renderer_page(name: str) -> str:
    """Return the page of a renderer with the table of its options as it should be."""
    text = (ROOT / f"docs/renderers/{name}.md").read_text(encoding="utf-8")
    begin, end = "<!-- options: written by `make docs` -->\n", "<!-- end of options -->\n"
    table = begin + option_table(find_renderer(name).Options) + end
    found, count = re.subn(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _: table, text, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"docs/renderers/{name}.md has {count} places for the options; it needs one")
    return found


def stale() -> list[Path]:
    """Return the generated files that differ from what they should be, and stored schemas that nothing generates."""
    wanted = pages()
    wrong = [path for path, text in wanted.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    return wrong + sorted(set((ROOT / "data_specs").glob("*.schema.json")) - set(wanted))


def main() -> int:
    """Write the pages, or check them."""
    if "--check" in sys.argv[1:]:
        names = [str(path.relative_to(ROOT)) for path in stale()]
        if names:
            sys.stderr.write(f"out of date: {', '.join(names)}; type: make docs\n")
        return 1 if names else 0
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
