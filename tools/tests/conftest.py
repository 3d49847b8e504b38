"""Make the tools importable."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


def pytest_terminal_summary(terminalreporter):
    """Print the score of the drift checker's mutants."""
    results = {outcome: terminalreporter.stats.get(outcome, []) for outcome in ('passed', 'failed')}
    for test, text in (
        ('test_mutant', 'mutants of the trees reported'),
        ('test_harmless', 'harmless changes let pass'),
    ):
        good, bad = (sum(f'::{test}[' in each.nodeid for each in results[outcome]) for outcome in results)
        if good + bad:
            terminalreporter.write_line(f'check_drift: {good} of {good + bad} {text}')
