"""
Check ARGS of `make run` before anything is built: each word sets a parameter of the bridge, by name:=value.

    python ci/check_run.py WORD...

The bridge itself only warns of a name that it does not know, because nodes may share a parameter file.
Exit code 2: a word sets none. Needs no environment.
"""

import sys
from dataclasses import fields
from pathlib import Path

BRIDGE = Path(__file__).resolve().parents[1] / 'monorepo/lupin_greenhouse_bridge'
OF_LAUNCH = ('namespace', 'log_level', 'params_file', 'respawn')


def fault_of(word: str) -> str:
    """Return what is wrong with a word, or ''. An option, such as --help, is not checked."""
    from lupin_greenhouse_bridge.errors import escaped, meant_name
    from lupin_greenhouse_bridge.runtime.parameters import OF_EVERY_NODE
    from lupin_greenhouse_bridge.settings import Settings

    own = [each.name for each in fields(Settings)]
    name, separator, _ = word.partition(':=')
    if word.startswith('-'):
        return ''
    if not (name and separator):
        return f"ARGS has '{escaped(word, 64)}', which sets no parameter: write name:=value"
    if not name.isidentifier() or name in (*own, *OF_EVERY_NODE, *OF_LAUNCH):
        return ''
    meant = meant_name(name, own)
    advice = f'did you mean {meant}?' if meant else f'the parameters are {", ".join(own)}'
    return f'parameter {escaped(name, 64)} is unknown: {advice}'


if __name__ == '__main__':
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(BRIDGE))
    for fault in filter(None, map(fault_of, sys.argv[1:])):
        print(f'run: {fault}', file=sys.stderr)
        sys.exit(2)
