"""Run git in tests, like another team."""

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
