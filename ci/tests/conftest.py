"""A copy of the checkout, and shells that a reader pastes commands into."""

import contextlib
import os
import subprocess
from pathlib import Path

import domain_coordinator
import pytest
from checkout import USE_WHAT_IS_BUILT, of_a_user, run, succeed
from lupin_greenhouse_bridge.runtime.process import private_domains
from lupin_greenhouse_bridge.testing.helpers import PATIENCE_SECONDS

PASTED = '[pasted]'


class Shell:
    """A shell that a reader pastes commands into."""

    def __init__(self, folder: Path):
        """Open it in a folder."""
        self._bash = subprocess.Popen(
            ['bash', '-e'], cwd=folder, env=of_a_user(ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST'), text=True,
            start_new_session=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.paste(USE_WHAT_IS_BUILT)
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
