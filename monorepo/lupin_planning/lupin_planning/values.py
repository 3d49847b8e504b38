"""Check the values of a YAML file. Each StartUpError names the file and the place in it."""

from collections.abc import Collection, Mapping
from typing import Any

from lupin_greenhouse_bridge.errors import StartUpError, escaped

LARGEST_NUMBER = 1e12


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
        return float(value)
    raise StartUpError(
        f'{where}: {key} is {_shown(mapping, key)}:'
        f' must be a number from {smallest:g} to {largest:g} ({unit})'
    )


def mapping_of(config: Mapping[str, Any], key: str, where: str, example: str) -> dict[str, Any]:
    """Return the value of a key, which must be a mapping; raises a StartUpError that shows the example."""
    value = config.get(key)
    if not isinstance(value, dict):
        raise StartUpError(f'{where}: {key} is {_shown(config, key)}: must be a mapping, such as {example}')
    return value


def refuse_unknown_keys(mapping: Mapping[Any, Any], known: Collection[str], where: str, example: str) -> None:
    """Raise a StartUpError that begins with `where` for the first key that is not known."""
    for key in mapping:
        if key not in known:
            unknown = f"unknown key '{escaped(str(key), 64)}'"
            raise StartUpError(f'{where}: {unknown}: use {", ".join(known)}, as in {example}')


def _shown(mapping: Mapping[str, Any], key: str) -> str:
    return escaped(repr(mapping[key]), 60) if key in mapping else 'missing'
