"""What the tests of the checkout share: commands as of a user."""

import os
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TREES = ('monorepo', 'lupin_greenhouse_ros')
BLOCK = re.compile(r'(?:^<!-- ([^\n]+?) -->\n)?^```(\S*)\n(.*?)^```$', re.MULTILINE | re.DOTALL)
# Options of make: what is built already is not built again, whatever is newer.
VENV = Path(os.environ['VIRTUAL_ENV'])
STAMPS = [*VENV.glob('.made-*'), *(VENV / f'workspace/{name}/built' for name in (*TREES, 'ci/stand_ins'))]
BUILT = [f'--assume-old={stamp}' for stamp in STAMPS]
# For a shell, whose user types `make`.
USE_WHAT_IS_BUILT = f'make() {{ command make {" ".join(BUILT)} "$@"; }}'


def run(
    *command: object, cwd: Path = ROOT, env: dict | None = None, **options
) -> subprocess.CompletedProcess:
    """Run a command; the result has its exit code and its output as text."""
    words = [str(word) for word in command]
    return subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False, **options)


def succeed(*command: object, **options) -> str:
    """Run a command, which must end with exit code 0; return all that it printed."""
    result = run(*command, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout + result.stderr


def of_a_user(**variables: str) -> dict[str, str]:
    """Return the variables of a shell that is not started by make, with the environment of the monorepo."""
    own = {name: value for name, value in os.environ.items() if not name.startswith(('MAKE', 'PYTEST'))}
    return own | {'VENV': os.environ['VIRTUAL_ENV'], 'TREE': 'monorepo'} | variables


def make(*words: object, cwd: Path = ROOT, **variables: str) -> subprocess.CompletedProcess:
    """Run make with what is built already."""
    return run('make', '-f', ROOT / 'Makefile', *BUILT, *words, cwd=cwd, env=of_a_user(**variables))


def shell_blocks_of(page: str) -> list[tuple[str, str, str]]:
    """Return those blocks of a page that a reader pastes into a shell."""
    return [block for block in blocks_of(page) if block[1] in ('bash', 'console')]


def blocks_of(page: str) -> list[tuple[str, str, str]]:
    """Return the comment above each block of code of a page, or '', its language and its text."""
    return BLOCK.findall((ROOT / page).read_text(encoding='utf-8'))
