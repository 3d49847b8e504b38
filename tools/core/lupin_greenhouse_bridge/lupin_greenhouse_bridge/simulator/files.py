"""Read JSON and YAML files, and validate them. Each StartUpError names the file and the place in it."""

import json
import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jsonschema
from jsonschema.exceptions import best_match

from lupin_greenhouse_bridge.errors import StartUpError, escaped, reason_of

SCHEMAS = Path(__file__).resolve().parents[1] / 'schema'
TYPE_CHECKER = jsonschema.Draft7Validator.TYPE_CHECKER


def _is_finite_number(_checker: Any, value: Any) -> bool:
    """Return whether a value is a finite number. JSON Schema accepts NaN as a number."""
    return TYPE_CHECKER.is_type(value, 'number') and (isinstance(value, int) or math.isfinite(value))


_Validator = jsonschema.validators.extend(
    jsonschema.Draft7Validator, type_checker=TYPE_CHECKER.redefine('number', _is_finite_number)
)


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON schema of a file."""
    schema: dict[str, Any] = json.loads((SCHEMAS / f'{name}.schema.json').read_text(encoding='utf-8'))
    return schema


def validate(document: Any, schema: Mapping[str, Any], where: str) -> None:
    """Raise a StartUpError that begins with `where` for the most relevant fault of a document."""
    try:
        fault = best_match(_Validator(schema).iter_errors(document))
    except Exception as error:  # Python refuses to print numbers of thousands of digits
        raise StartUpError(f'{where}: cannot be validated: {error}') from error
    if fault:
        place = '.'.join(map(str, fault.absolute_path))
        raise StartUpError(f'{where}: {place and escaped(place, 100) + ": "}{escaped(fault.message, 500)}')


def unread_keys(value: Any, schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Iterator[str]:
    """Yield the places of the keys in a valid document that its schema does not name: nothing reads them."""
    if '$ref' in schema:
        schema = definitions[schema['$ref'].rpartition('/')[2]]
    if isinstance(value, list):
        for index, item in enumerate(value):
            unread = unread_keys(item, schema.get('items', {}), definitions)
            yield from (f'{index}.{place}' for place in unread)
    elif isinstance(value, dict) and ('properties' in schema or 'additionalProperties' in schema):
        for key, item in value.items():
            inner = schema.get('properties', {}).get(key, schema.get('additionalProperties'))
            if inner is None:
                yield escaped(str(key), 60)
            elif inner is not True:
                unread = unread_keys(item, inner, definitions)
                yield from (f'{escaped(str(key), 60)}.{place}' for place in unread)


def read_text(path: str | Path, where: str) -> str:
    """Return the text of a file; raises a StartUpError that begins with `where` if it cannot be read."""
    try:
        return Path(path).read_text(encoding='utf-8')
    except (OSError, ValueError) as error:  # the latter: bytes that are not UTF-8, or a NUL in the path
        looked_for = escaped(os.path.abspath(path), 500)
        raise StartUpError(
            f"{where}: cannot be read ({reason_of(error)}): looked for '{looked_for}'"
        ) from error


def read_json(path: str | Path, where: str) -> Any:
    """Return the value in a JSON file; raises a StartUpError that begins with `where`."""

    def without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        for key, count in Counter(key for key, _ in pairs).items():
            if count > 1:
                raise ValueError(f"'{key}' appears twice in one object")
        return dict(pairs)

    text = read_text(path, where)
    try:
        return json.loads(text, object_pairs_hook=without_duplicates)
    except Exception as error:
        raise StartUpError(f'{where}: is not JSON: {error}') from error


def read_yaml(path: str | Path, where: str, wanted: str) -> dict[str, Any]:
    """
    Return the mapping in a YAML file, or in a JSON file whose name ends in .json; {} for an empty file.

    Raises a StartUpError that begins with `where` if the file is unreadable, malformed or not `wanted`.
    """
    import yaml  # mdp-greenhouse brings it; start-up reports a missing mdp-greenhouse first

    if str(path).endswith('.json'):  # 1e3 is a number in JSON, and text in YAML 1.1
        data = read_json(path, where)
    else:
        text = read_text(path, where)
        try:
            data = yaml.safe_load(text)
        except Exception as error:  # PyYAML's constructors leak KeyError, IndexError and others
            raise StartUpError(f'{where}: is not YAML: {type(error).__name__}: {error}') from error
    if data is not None and not isinstance(data, dict):
        raise StartUpError(f'{where}: must be {wanted}')
    return data or {}
