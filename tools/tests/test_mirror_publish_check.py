"""Parts of the publish check; `make mirror-publish-check` runs all of it."""

import re
from pathlib import Path

import mirror_publish_check
import pytest

README = (mirror_publish_check.ROOT / mirror_publish_check.MIRROR / 'README.md').read_text()
PLACES = Path('/srv/mirror.git'), Path('/srv/setup.bash')


def test_address_and_ros_are_filled_into_the_commands():
    commands = ''.join(mirror_publish_check.readme_commands(README, *PLACES))
    assert 'git clone /srv/mirror.git src/lupin_greenhouse_ros && rm src' in commands
    assert 'python3 -m colcon build' in commands
    assert 'source /srv/setup.bash' in commands
    assert 'URL_OF_THIS_REPOSITORY' not in commands
    assert '/opt/ros' not in commands


def test_only_marked_blocks_are_left_out():
    marked = re.findall(r'<!-- needs [^>]*-->\n```bash', README)
    assert README.count('```bash') == len(mirror_publish_check.readme_commands(README, *PLACES)) + len(marked)
    assert 'apt install' not in ''.join(mirror_publish_check.readme_commands(README, *PLACES))


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        (' && rm src/lupin_greenhouse_ros/COLCON_IGNORE', '', 'does not deal with COLCON_IGNORE'),
        ('git clone', 'git fetch', 'no command that clones'),
        ('colcon test --', 'colcon build --', 'or none that tests'),
    ],
)
def test_a_readme_without_a_needed_command_fails(old, new, reason):
    assert old in README
    with pytest.raises(mirror_publish_check.CheckFailedError, match=reason):
        mirror_publish_check.readme_commands(README.replace(old, new), *PLACES)


def test_a_command_that_fails_is_shown_with_its_output(tmp_path):
    with pytest.raises(
        mirror_publish_check.CheckFailedError, match=r'before\n\nexit code 3 of:\necho before; exit 3'
    ):
        mirror_publish_check.run('echo before; exit 3', tmp_path / 'log', {'PATH': '/usr/bin:/bin'}, tmp_path)
