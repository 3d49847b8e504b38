# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Write a report of a mission, as lupin_mission does."""

import json
from pathlib import Path

START_S = 1795190000


def visit(tag_id, outcome='OK', detail='', second=0, **values):
    """Return one visit of a tag."""
    is_read = outcome == 'OK'
    return {
        'tag_id': tag_id,
        'outcome': outcome,
        'detail': detail,
        'attempts': 1 if is_read else 3,
        'stamp': {'sec': START_S + second, 'nanosec': 0} if is_read else None,
        'sim_time_of_day_seconds': 43200.0 if is_read else None,
        'readings': values if is_read else None,
    }


def write_report(path: Path, *visits: dict) -> Path:
    """Write the visits to a file, and return its path."""
    path.write_text(''.join(f'{json.dumps(each)}\n' for each in visits), encoding='utf-8')
    return path
