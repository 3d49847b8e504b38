"""
Check the documents: links, tables of parameters, and the tests that blocks of commands name.

Every link leads to a file, and its anchor to a heading. A table with a second column `default` follows

    <!-- parameters of MODULE.CLASS -->

and has only parameters of this dataclass, with their defaults. Together, the tables of a class have all
parameters. A line `<!-- tested by PATH::NAME -->` names a test that exists.
Exit code: 0 no findings, 1 findings, with one line per finding.
"""

import dataclasses
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from lupin_greenhouse_bridge.runtime.parameters import default_text

ROOT = Path(__file__).resolve().parents[1]
FENCED = re.compile(r'^```.*?^```$', re.MULTILINE | re.DOTALL)
LINK = re.compile(r'\[[^\[\]]*\]\(([^)\s]+)\)|\bsrc(?:set)?="([^"]+)"')  # src and srcset are in a <picture>
TABLE = re.compile(
    r'^(?:<!-- parameters of (\S+) -->\n)?\| \w+ \| default \|.*\n\|[-|]+\n((?:\|.*\n)+)', re.MULTILINE
)
TESTED = re.compile(r'<!-- tested by (.+?)::(\w+) -->')


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub gives to the headings of a document."""
    headings = re.findall(r'^#+ (.+)$', FENCED.sub('', text), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


def broken_links(path: Path, text: str) -> Iterator[str]:
    """Yield a finding for each link to a missing file or heading."""
    for link in map(''.join, LINK.findall(FENCED.sub('', text))):
        if re.match(r'[a-z]+:', link):
            continue
        name, _, anchor = unquote(link).partition('#')
        target = path.parent / name if name else path
        if not target.exists():
            yield f'the link {link} leads nowhere'
        elif anchor and anchor not in anchors(target.read_text(encoding='utf-8')):
            yield f'the link {link} names no heading'


def missing_tests(root: Path, text: str) -> Iterator[str]:
    """Yield a finding for each test that a document names and that does not exist."""
    for file, name in TESTED.findall(text):
        if not (root / file).is_file() or f'def {name}(' not in (root / file).read_text(encoding='utf-8'):
            yield f'the test {file}::{name} does not exist'


def parameters(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield class, name and default of each parameter; the class is '' for a table without the line."""
    for name_of_class, rows in TABLE.findall(text):
        for row in rows.splitlines():
            name, default, *_ = (cell.strip(' `') for cell in row.strip('|').split('|'))
            yield name_of_class, name, default.replace("''", '').replace('empty', '')


def wrong_parameters(texts: dict[Path, str]) -> Iterator[str]:
    """Yield a finding for each row that does not match its dataclass, and for each missing row."""
    documented: dict[str, set[str]] = {}
    for path, text in texts.items():
        for name_of_class, name, default in parameters(text):
            documented.setdefault(name_of_class, set()).add(f'{name} = {default}')
            if not name_of_class:
                yield f'{path}: the table with {name} has no line <!-- parameters of MODULE.CLASS -->'
    for name_of_class in documented.keys() - {''}:
        module, _, name = name_of_class.rpartition('.')
        fields = dataclasses.fields(getattr(importlib.import_module(module), name))
        right = {f'{field.name} = {default_text(field)}' for field in fields}
        for row in sorted(documented[name_of_class] ^ right):
            fault = 'is missing from' if row in right else 'is wrong in'
            yield f'{name_of_class}: {row} {fault} the documents'


def findings(root: Path) -> list[str]:
    """Return what is wrong in the documents of a repository, one line each."""
    listed = subprocess.run(['git', 'ls-files', '*.md'], cwd=root, capture_output=True, text=True, check=True)
    texts = {root / name: (root / name).read_text(encoding='utf-8') for name in listed.stdout.splitlines()}
    found = [
        f'{path.relative_to(root)}: {finding}'
        for path, text in texts.items()
        for finding in (*broken_links(path, text), *missing_tests(root, text))
    ]
    return found + list(wrong_parameters(texts))


if __name__ == '__main__':
    found = findings(ROOT)
    for finding in found:
        print(f'docs: {finding}')
    print(f'documents: {len(found)} findings')
    sys.exit(bool(found))
