"""The environments of both trees, commands and shells as of a user, and a copy of the checkout."""

import contextlib
import os
import subprocess
from pathlib import Path

import domain_coordinator
import pytest
from lupin_greenhouse_bridge.runtime.process import private_domains
from lupin_greenhouse_bridge.testing._helpers import PATIENCE_SECONDS

ROOT = Path(__file__).resolve().parents[2]
PASTED = '[pasted]'
ENVIRONMENTS = {
    'monorepo': Path(os.environ['VIRTUAL_ENV']),
    'lupin_greenhouse_ros': Path(os.environ.get('MIRROR_VENV') or os.environ['VIRTUAL_ENV']),
}

NEED_LAUNCH = {'test_bring_up'}  # run where launch is installed


def run(
    *command: object, cwd: Path = ROOT, env: dict | None = None, **options
) -> subprocess.CompletedProcess:
    """Run a command; the result has its exit code and its output as text."""
    words = [str(word) for word in command]
    return subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False, **options)


def start(*command: str, cwd: Path = ROOT, **variables: str) -> subprocess.Popen:
    """Start a command of a user in a session of its own, with pipes for its input and for all its output."""
    return subprocess.Popen(
        command, cwd=cwd, env=of_a_user(**variables), text=True, start_new_session=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def succeed(*command: object, **options) -> str:
    """Run a command, which must end with exit code 0; return all that it printed."""
    result = run(*command, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout + result.stderr


def of_a_user(**variables: str) -> dict[str, str]:
    """Return the variables of a shell that is not started by make, with the environment of the monorepo."""
    own = {name: value for name, value in os.environ.items() if not name.startswith('MAKE')}
    return own | {'VENV': os.environ['VIRTUAL_ENV'], 'TREE': 'monorepo'} | variables


def make(*words: object, cwd: Path = ROOT, **variables: str) -> subprocess.CompletedProcess:
    """Run make with what is built already."""
    command = ('make', '-f', ROOT / 'Makefile', '-o', 'bridge', '-o', 'build', *words)
    return run(*command, cwd=cwd, env=of_a_user(**variables))


class Shell:
    """A shell that a reader pastes commands into."""

    def __init__(self, folder: Path):
        """Open it in a folder."""
        self._bash = start('bash', '-e', cwd=folder, ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        # On a busy machine the bridge may be found late.
        self.paste(f'read_tag() {{ command read_tag --timeout {PATIENCE_SECONDS} "$@"; }}')

    def paste(self, commands: str) -> None:
        """Send commands, which the shell starts."""
        print(commands, file=self._bash.stdin, flush=True)

    def read_until(self, fragment: str) -> str:
        """Return what is printed up to a line with this fragment; fail if the shell ends before it."""
        printed = []
        for line in self._bash.stdout:
            printed.append(line)
            if fragment in line:
                return ''.join(printed)
        raise AssertionError(f'no {fragment!r} in: {"".join(printed)}')

    def run(self, commands: str) -> str:
        """Return what commands print; fail if one of them fails."""
        self.paste(f'{commands.strip()}\necho {PASTED!r}')
        return self.read_until(PASTED).replace(f'{PASTED}\n', '')

    def close(self) -> None:
        """End the shell and what it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._bash.pid, 15)
        self._bash.communicate()


@pytest.fixture
def copy(tmp_path):
    """Return a copy of the checkout, whose packages are those that are built already."""
    names = run('git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard').stdout
    folder = tmp_path / 'copy'
    folder.mkdir()
    succeed('xargs', '-0', 'cp', '--parents', '-t', folder, input=names)
    return folder


@pytest.fixture
def open_shell(copy, monkeypatch):
    """Return a function that opens a shell in a copy of the checkout, on a domain of the test."""
    with domain_coordinator.domain_id(private_domains()) as domain_id, contextlib.ExitStack() as stack:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain_id))

        def opened() -> Shell:
            shell = Shell(copy)
            stack.callback(shell.close)
            return shell

        yield opened
