"""
Translate a patch of the open-source mirror into one for the core, with the table that made the mirror.

    python3 tools/mirror_patch.py N.patch | git am --3way     (or: make mirror-import PATCH=N.patch)

Exit code: 0 the translated patch is on standard output, 1 a file of the patch has no place here.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import generate
from check_drift import MIRROR_ALONE
from mirror_publish import PLACEHOLDER

PATH_LINE = re.compile(
    r'^(diff --git a/|--- a/|\+\+\+ b/|rename (?:from|to) |copy (?:from|to) )(.+)$', re.MULTILINE
)


def translate(patch: str, table: dict) -> str:
    """Return the patch with the core's paths and names; raises GenerationError for an unknown path."""
    head, *diffs = re.split(r'^(?=diff --git )', patch, flags=re.MULTILINE)
    return head + ''.join(_translate_diff(diff, table) for diff in diffs)


def _translate_diff(diff: str, table: dict) -> str:
    """Translate the diff of one file, generated from the core or kept by hand."""
    mirror = table['trees']['mirror']
    renamed = {new: old for old, new in mirror['folders'].items()}

    def place(path: str) -> str:
        package, slash, rest = path.partition('/')
        core_path = renamed.get(package, package) + slash + rest
        if core_path in MIRROR_ALONE:
            return f'{mirror["root"]}/{path}'
        if package in table['owned'] or (generate.ROOT / generate.CORE / core_path).is_file():
            return f'{generate.CORE}/{core_path}'
        raise generate.GenerationError(f'{path}: is not a file of the mirror in tools/twins.toml')

    def place_line(match: re.Match) -> str:
        return match[1] + ' b/'.join(place(path) for path in match[2].split(' b/'))

    header, at, hunks = diff.partition('\n@@')
    header = PATH_LINE.sub(place_line, header)
    if f' b/{mirror["root"]}/README.md' in header:
        readme = generate.ROOT / mirror['root'] / 'README.md'
        hunks = without_address(hunks, readme.read_text(encoding='utf-8'))
    if generated := re.match(rf'diff --git a/{generate.CORE}/(.+) b/', header):
        hunks = without_header(at + hunks, generate.header_of(generated[1]).decode()).removeprefix(at)
    for find, replace, path in _substitutions_in(header, mirror):
        is_line = replace.endswith('\n')
        if is_line and hunks.count(f'\n-{replace}') != hunks.count(f'\n+{replace}'):
            raise generate.GenerationError(
                f'{path}: {replace.strip()!r} differs from the monorepo on purpose: leave this line as it is'
            )
        hunks = hunks.replace(replace, find)
    return header + at + hunks


def without_header(hunks: str, comment: str) -> str:
    """Return the hunks for the file without the comment, which the generator has put at its top."""
    lines = re.compile(''.join(f'^([ +-]){re.escape(line)}\n' for line in comment.splitlines()), re.MULTILINE)
    found = lines.search(hunks) if comment else None
    if not found:
        return hunks

    def with_counts(match: re.Match) -> str:
        old, new = (
            int(count or 1) - sum(sign in (' ', side) for sign in found.groups())
            for count, side in zip((match[2], match[4]), '-+', strict=True)
        )
        return f'{match[1]},{old}{match[3]},{new}'

    # The comment is in the first hunk, if it is in one.
    hunks = re.sub(r'(@@ -\d+)(?:,(\d+))?( \+\d+)(?:,(\d+))?', with_counts, hunks, count=1)
    return lines.sub('', hunks, count=1)


def _substitutions_in(header: str, tree: dict) -> Iterator[tuple[str, str, str]]:
    """Yield what the table replaces, and by what, in the file of a diff, and its path."""
    for substitution in tree['substitutions']:
        for path in substitution['matches']:
            if f' a/{generate.CORE}/{path} ' in header:
                yield substitution['find'], substitution['replace'], path


def without_address(hunks: str, readme: str) -> str:
    """Return the hunks with the placeholder in place of the address, where the README here has it."""
    for line in readme.splitlines():
        if PLACEHOLDER in line:
            before, _, after = map(re.escape, line.partition(PLACEHOLDER))
            found = re.search(rf'^[ -]{before}(\S+){after}$', hunks, re.MULTILINE)
            if found:
                return hunks.replace(found[1], PLACEHOLDER)
    return hunks


def main() -> int:
    """Translate the patch on the command line."""
    if len(sys.argv) != 2:
        print('usage: mirror_patch.py FILE', file=sys.stderr)
        return 2
    try:
        patch = Path(sys.argv[1]).read_text(encoding='utf-8')
        sys.stdout.write(translate(patch, generate.load_table(generate.ROOT / 'tools/twins.toml')))
    except (generate.GenerationError, OSError, UnicodeDecodeError) as error:
        print(f'mirror_patch: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
