"""Parts of the publish check; `make mirror-publish-check` runs all of it."""

import os
from pathlib import Path

import mirror_publish_check
import pytest

MIRROR = mirror_publish_check.ROOT / mirror_publish_check.MIRROR
PAGES = [(MIRROR / path).read_text() for path in mirror_publish_check.PAGES]


def test_the_first_block_runs_word_for_word():
    first = PAGES[0].partition('```bash\n')[2].partition('```')[0]
    assert 'sudo apt install' in first
    assert 'read_tag 1' in first
    alone, among_others = mirror_publish_check.scripts(PAGES, Path('/srv/other')).values()
    assert first in alone
    assert 'cp -r /srv/other src/other_team' in among_others
    assert 'source /opt/ros/jazzy/setup.bash' in among_others


@pytest.mark.parametrize(
    ('page', 'old', 'reason'),
    [
        (0, '<!-- followed by', 'README.md: no bash block is marked'),
        (0, 'git clone', 'does not make a workspace and clone into it'),
        (2, '<!-- followed by', 'doc/tests.md: no bash block is marked'),
    ],
)
def test_a_page_without_its_commands_fails(page, old, reason):
    pages = [text.replace(old, 'x') if number == page else text for number, text in enumerate(PAGES)]
    with pytest.raises(mirror_publish_check.CheckFailedError, match=reason):
        mirror_publish_check.scripts(pages, Path('/srv/other'))


def test_a_failure_ends_the_bridge_of_the_first_block(tmp_path):
    script = f'{mirror_publish_check.UBUNTU}set -m\nsleep 600 & echo $!\nfalse'
    with pytest.raises(mirror_publish_check.CheckFailedError) as failure:
        mirror_publish_check.run(script, tmp_path / 'log', {'PATH': '/usr/bin:/bin'}, tmp_path)
    mirror_publish_check.run(f'{mirror_publish_check.UBUNTU}true', tmp_path / 'log', {}, tmp_path)  # no child
    child = int(str(failure.value).partition('\n')[0])
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def test_a_command_that_fails_is_shown_with_its_output(tmp_path):
    with pytest.raises(
        mirror_publish_check.CheckFailedError, match=r'before\n\nexit code 3 of:\necho before; exit 3'
    ):
        mirror_publish_check.run('echo before; exit 3', tmp_path / 'log', {'PATH': '/usr/bin:/bin'}, tmp_path)
