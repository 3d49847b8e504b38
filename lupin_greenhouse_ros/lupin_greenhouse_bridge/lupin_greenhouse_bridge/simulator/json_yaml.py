# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Read JSON and YAML files, and check their values. Each StartUpError names the file and the place in it."""

import codecs
import datetime
import json
import math
import os
import re
import reprlib
import stat
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from lupin_greenhouse_bridge.errors import StartUpError, escaped, reason_of, refuse_typo

LARGEST_YAML_BYTES = 2**20  # PyYAML takes seconds for a megabyte
LARGEST_YAML_VALUES = 100_000  # after its aliases are expanded
# No product of two such numbers overflows, so a finite config cannot give an infinite reading.
LARGEST_NUMBER = 1e12
TOO_DEEP = 'is too deeply nested: use at most 4 levels'
# What people write that JSON does not have: what is before and after the place where the parser stops.
JSON_FAULTS = {
    r'\n[^/]': 'it does not begin with { or [: name a JSON file',
    r'\d,\n\d': 'a number has a decimal comma: write a point',
    r'.*\n(#|//|/\*)': 'it has a comment: remove it',
    r".*\n'": 'a name or a text has single quotes: write double quotes',
    r'.*,\n[]}]|.*\n,': 'a comma is before a closing bracket: remove it',
    r'\n$': 'it is empty: save it again, or name another',
    r'.+\n$': 'its end is missing: close every quote and bracket',
}
KINDS = {
    dict: 'an object',
    str: 'text',
    bool: 'true or false',
    int: 'a number',
    float: 'a number',
    type(None): 'null',
    datetime.datetime: 'a date',
}


def read_json(path: str | Path, where: str, largest_bytes: int) -> Any:
    """Return the value in a JSON file; raises a StartUpError that begins with `where`."""
    return _parse_json(read_text(path, where, largest_bytes), where)


def read_yaml(path: str | Path, where: str, wanted: str, *, is_typed: bool = True) -> dict[str, Any]:
    """
    Return the mapping in a YAML file, or in a JSON file whose name ends in .json; {} for an empty file.

    If not typed, the file is read as by yaml-cpp, whose callers choose the types: every scalar is text, a tab
    is a space, and the first of equal keys counts.
    Raises a StartUpError that begins with `where` if the file is unreadable, malformed or not `wanted`.
    """
    text = read_text(path, where, LARGEST_YAML_BYTES)
    if not is_typed:
        data = _parse_yaml(text.replace('\t', ' '), where, 'BaseLoader')
    elif str(path).endswith('.json'):  # 1e3 is a number in JSON, and text in YAML 1.1
        data = _parse_json(text, where)
    else:
        data = _parse_yaml(text, where)
    if data is not None and not isinstance(data, dict):
        raise StartUpError(f'{where}: holds {kind_of(data)} at its top level, not {wanted}')
    return data or {}


def number(
    mapping: Mapping[str, Any],
    key: str,
    where: str,
    unit: str,
    smallest: float = -LARGEST_NUMBER,
    largest: float = LARGEST_NUMBER,
) -> float:
    """Return the value of a key, which must be a number; raises a StartUpError that begins with `where`."""
    value = mapping.get(key)
    if isinstance(value, (int, float)) and not isinstance(value, bool) and smallest <= value <= largest:
        return value
    raise StartUpError(
        f'{where}: {key} is {shown(mapping, key)}: must be a number from {smallest:g} to {largest:g} ({unit})'
    )


def mapping_of(config: Mapping[str, Any], key: str, where: str, example: str) -> dict[str, Any]:
    """Return the value of a key, which must be a mapping; raises a StartUpError that shows the example."""
    value = config.get(key)
    if not isinstance(value, dict):
        raise StartUpError(f'{where}: {key} is {shown(config, key)}: must be a mapping, such as {example}')
    return value


def unknown_keys(mapping: Mapping[Any, Any], known: Collection[str], where: str) -> list[str]:
    """
    Return the keys that are not known, as an error message shows them.

    Raises a StartUpError that begins with `where` for a key that resembles a known one which is missing.
    """
    missing = [key for key in known if key not in mapping]
    unknown = [key for key in mapping if key not in known]
    for key in unknown:
        if isinstance(key, str):
            refuse_typo(key, missing, f'{where}:')
    return [escaped(key, 60) if isinstance(key, str) else start_of(key) for key in unknown]


def refuse_unknown_keys(mapping: Mapping[Any, Any], known: Collection[str], where: str, example: str) -> None:
    """Raise a StartUpError that begins with `where` for the first key that is not known."""
    for key in mapping:
        if key not in known:
            unknown = f"unknown key '{escaped(str(key), 64)}'"
            raise StartUpError(f'{where}: {unknown}: use {", ".join(known)}, as in {example}')


def shown(mapping: Mapping[str, Any], key: str) -> str:
    """Return the value of a key as an error message shows it: a number or a text, or its kind."""
    value = mapping.get(key)
    if key not in mapping:
        return 'missing'
    return start_of(value) if isinstance(value, (str, int, float, type(None))) else kind_of(value)


def start_of(value: object) -> str:
    """Return the start of a value. The whole of it could be gigabytes, after aliases are expanded."""
    try:
        return escaped(reprlib.repr(value), 60)
    except ValueError:  # Python refuses to print thousands of digits
        return kind_of(value)


def kind_of(value: object) -> str:
    """Return what kind of value a JSON or YAML file has, such as `a list`."""
    return KINDS.get(type(value), f'a {type(value).__name__}')


def read_text(path: str | Path, where: str, largest_bytes: int) -> str:
    """Return the text of a file; raises a StartUpError that begins with `where` if it cannot be read."""
    try:
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):
            kind = 'a folder' if stat.S_ISDIR(mode) else 'not a regular file'
            raise StartUpError(f'{where}: is {kind}: set the path of a file')
        with open(path, 'rb') as file:
            content = file.read(largest_bytes + 1)
    except (OSError, ValueError) as error:  # the latter: a NUL in the path
        hint = 'name a file that you can read'
        if not os.path.isabs(path):
            hint = f"looked for '{os.path.abspath(path)}' (~ is not expanded)"
        raise StartUpError(f'{where}: cannot be read ({reason_of(error)}): {hint}') from error
    if len(content) > largest_bytes:
        raise StartUpError(f'{where}: is larger than {largest_bytes // 2**20} MiB: use a smaller file')
    if b'\0' in content and not content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        kind = 'an SQLite file, not' if content.startswith(b'SQLite format 3') else 'not'
        raise StartUpError(f'{where}: is {kind} a text file: name another')
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise StartUpError(f'{where}: is not UTF-8 text ({error}): save it as UTF-8') from error


def _parse_json(text: str, where: str) -> Any:
    if text.startswith('\ufeff'):
        raise StartUpError(f'{where}: starts with a UTF-8 byte order mark: save it as UTF-8 without BOM')

    def without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        _refuse_duplicates([key for key, _ in pairs], 'one object', where)
        return dict(pairs)

    try:
        return json.loads(text, object_pairs_hook=without_duplicates)
    except RecursionError as error:
        raise StartUpError(f'{where}: {TOO_DEEP}') from error
    except json.JSONDecodeError as error:
        around = f'{text[: error.pos].rstrip()[-2:]}\n{text[error.pos :].lstrip()[:2]}'
        causes = (cause for pattern, cause in JSON_FAULTS.items() if re.match(pattern, around))
        place = f'line {error.lineno}, column {error.colno}'
        raise StartUpError(f'{where}: is not JSON: {next(causes, error.msg)} ({place})') from error
    except ValueError as error:
        raise StartUpError(f'{where}: is not JSON: {error}') from error


def _parse_yaml(text: str, where: str, loader_name: str = 'SafeLoader') -> Any:
    import yaml  # mdp-greenhouse brings it; start-up reports a missing mdp-greenhouse first

    try:
        loader = getattr(yaml, loader_name)(text)
        document = loader.get_single_node()
        if document is None:
            return None
        if loader_name == 'BaseLoader' and document.id == 'mapping':
            document.value = list(
                {key.value: (key, value) for key, value in reversed(document.value)}.values()
            )
        if _count_values(document, {}, where) > LARGEST_YAML_VALUES:
            raise StartUpError(
                f'{where}: holds more than {LARGEST_YAML_VALUES} values after its aliases are expanded:'
                ' use fewer aliases, and none inside its own anchor'
            )
        return loader.construct_document(document)
    except StartUpError:
        raise
    except RecursionError as error:
        raise StartUpError(f'{where}: {TOO_DEEP}') from error
    except Exception as error:  # PyYAML's constructors leak KeyError, IndexError and others on bad scalars
        mark: Any = getattr(error, 'problem_mark', None)
        is_tab = mark and text[mark.index : mark.index + 1] == '\t'
        reason = f'line {mark.line + 1} has a tab: write spaces' if is_tab else error
        raise StartUpError(f'{where}: is not YAML: {type(error).__name__}: {reason}') from error


def _count_values(node: Any, counts: dict[int, float], where: str) -> float:
    """
    Return how many values a node has with its aliases expanded: infinite if it holds itself.

    `counts` has the nodes that are counted already, by id. Raises StartUpError for a key that appears twice.
    """
    if id(node) not in counts:
        counts[id(node)] = math.inf
        children = node.value if isinstance(node.value, list) else []  # a scalar holds a string
        if node.id == 'mapping':
            keys = [key.value for key, _ in children if key.id == 'scalar' and key.value != '<<']
            _refuse_duplicates(keys, f'the mapping of line {node.start_mark.line + 1}', where)
            children = [part for pair in children for part in pair]
        counts[id(node)] = 1 + sum(_count_values(child, counts, where) for child in children)
    return counts[id(node)]


def _refuse_duplicates(keys: list[str], place: str, where: str) -> None:
    if len(set(keys)) < len(keys):
        twice, _ = Counter(keys).most_common(1)[0]
        raise StartUpError(f'{where}: {start_of(twice)} appears twice in {place}: keep one of them')
