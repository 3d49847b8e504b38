"""The benchmark cannot flatter: who is slower has the larger ratio, whichever side it is put on."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
FLOOR = f'{sys.executable} {ROOT / "tools/measure/bench_floor.py"} floor'


def ratios(output: Path, subject: str, floor: str) -> dict[str, float]:
    script = 'source ci/ros_env.bash && exec "$0" tools/measure/bench.py "$@"'
    sides = ['--subject', subject, '--floor', floor, '--output', str(output)]
    result = subprocess.run(
        ['bash', '-c', script, sys.executable, '--short', '--only', 'latency', *sides],
        cwd=ROOT,
        env={**os.environ, 'TREE': 'monorepo'},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    rows = json.loads((output / 'bench.json').read_text())['figures']
    missed = [row['figure'] for row in rows if row.get('is_met') is False]
    assert (f'missed: {", ".join(missed)}. ' in result.stdout) == bool(missed)
    return {row['figure']: row['ratio'] for row in rows}


def test_swapping_the_sides_inverts_the_ratios(tmp_path):
    """One side sleeps 2 ms in each call, so that the order does not hang on the noise of the machine."""
    slow = f'{FLOOR} 0.002'
    as_subject, as_floor = ratios(tmp_path, slow, FLOOR), ratios(tmp_path, FLOOR, slow)
    assert as_subject['round trip p50'] > 2.0
    assert as_floor['round trip p50'] < 0.5
