"""Change files and commit in tests, like another team."""

import os
import subprocess

NOBODY = {
    f'GIT_{who}_{what}': value
    for who in ('AUTHOR', 'COMMITTER')
    for what, value in (('NAME', 'Another Team'), ('EMAIL', 'another@example.org'))
}


def git(folder, *arguments):
    environment = {**os.environ, **NOBODY, 'GIT_CONFIG_GLOBAL': os.devnull}
    command = ['git', '-c', 'commit.gpgsign=false', *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True
    ).stdout


def edit(path, old, new):
    """Replace a text once; without an old text, add the new one at the end."""
    text = path.read_text() if path.exists() else ''
    assert old in text
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.replace(old, new, 1) if old else text + new)


def commit(folder, message='Change it'):
    git(folder, 'add', '--all')
    git(folder, 'commit', '--quiet', '--message', message)
