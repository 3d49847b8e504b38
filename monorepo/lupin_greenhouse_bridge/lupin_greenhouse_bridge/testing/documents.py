# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The examples and tables of a Markdown page, for tests that compare them with the code."""

import re
from pathlib import Path


class Page:
    """A page with sections (##), whose examples are fenced blocks."""

    def __init__(self, path: Path) -> None:
        self.text = path.read_text(encoding='utf-8')
        parts = re.split('^## ', self.text, flags=re.MULTILINE)
        self.sections = {title: body for title, _, body in (part.partition('\n') for part in parts)}

    def table(self, section: str, columns: int) -> list[list[str]]:
        """Return the cells of the table of a section with so many columns, without its head."""
        lines = re.findall(r'^\|.*\|$', self.sections[section], re.MULTILINE)
        rows = [[cell.strip(' `') for cell in line.split('|')[1:-1]] for line in lines]
        return [row for row in rows if len(row) == columns][2:]

    def write_example(self, section: str, folder: Path) -> Path:
        """Write the first example of a section to a file that has the section's name; return its path."""
        path = folder / section
        _, example, _ = re.split('^```.*\n', self.sections[section], maxsplit=2, flags=re.MULTILINE)
        path.write_text(example, encoding='utf-8')
        return path

    def python_blocks(self) -> list[str]:
        """Return the blocks of Python in the page, in order."""
        return re.findall('^```python\n(.*?)^```', self.text, re.MULTILINE | re.DOTALL)
