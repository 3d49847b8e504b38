"""The README's first commands print what it shows, and the check of the documents can fail."""

import ast
import json
import re

import docs_check
import pytest
from checkout import ROOT, blocks_of, succeed


def without_numbers(text: str) -> list[str]:
    """Return the lines of a text with all numbers replaced: times and noise differ from run to run."""
    return [re.sub(r'\s+', ' ', re.sub(r'\d+(\.\d+)*', 'N', line)) for line in text.splitlines()]


def test_the_two_commands_of_the_readme(open_shell):
    """Each `$ command` of its console block prints what is shown below it, and its client reads tag 1."""
    blocks = blocks_of('README.md')
    (client,) = [text for _, language, text in blocks if language == 'python']
    shown = next(text for _, language, text in blocks if language == 'console')
    serving, *asking = [each.partition('\n') for each in shown.removeprefix('$ ').split('\n$ ')]
    assert [each[0] for each in asking] == ['make read TAG=1', 'make read TAG=99']
    server, shell = open_shell(), open_shell()
    server.paste(serving[0])
    assert without_numbers(server.read_until('ready:'))[-1:] == without_numbers(serving[2].strip())
    for command, _, printed in asking:
        # On a slow machine it waits, and make has a line of its own at the end.
        said = re.sub(r'read_tag: waiting for .*\n|\nmake: \*\*\* .*', '', shell.run(f'{command} || true'))
        assert without_numbers(said) == without_numbers(printed.strip())

    def run_client(old, new):
        code = client.replace(old, new)
        return shell.run(f"source ci/ros_env.bash; python - <<'END' || echo exit code $?\n{code}\nEND")

    values = ast.literal_eval(run_client('', ''))
    assert values['temperature'] == pytest.approx(22.7, abs=0.05)
    assert values.keys() == {'temperature', 'co2'}
    assert "Tag '99' is not in" in run_client("tag_id='1'", "tag_id='99'")
    server.close()
    assert 'exit code 1' in run_client('timeout_sec=5.0', 'timeout_sec=0.1')


def test_a_bridge_in_a_namespace_is_read_there(open_shell):
    open_shell().paste('make run ARGS="namespace:=team7 debug_time_of_day:=12"')
    service = '/team7/greenhouse_bridge/get_tag_reading'
    printed = open_shell().run(f'make read ARGS="--json --timeout 60 --service {service}" 2>/dev/null')
    assert json.loads(printed)['sim_time_of_day_seconds'] == 43200.0


def test_the_mirror_shows_the_table_of_the_readme():
    readme, mirror = (
        re.findall(r'^tag +sim time.*\n(?:1 .*\n)+', (ROOT / tree / 'README.md').read_text(), re.MULTILINE)
        for tree in ('.', 'lupin_greenhouse_ros')
    )
    assert len(readme) == 1
    assert mirror == readme


OF_BRIDGE = 'lupin_greenhouse_bridge.settings.Settings'
GOOD = f"""# A title: with `code`

[here](#a-title-with-code) [there](test_it.py) [away](https://example.org)
<img alt="a round" src="test_it.py">

<!-- tested by test_it.py::test_this -->
```console
$ anything
```

<!-- parameters of {OF_BRIDGE} -->
| name | default | effect |
|---|---|---|
| `tag_file` | `''` | a file |
| `sim_config_file` | empty | a file |
| `debug_time_of_day` | `-1.0` | hours |

<!-- parameters of {OF_BRIDGE} -->
| name | default | effect |
|---|---|---|
| `speedup_factor` | `0.0` | simulated seconds per second |
| `debug_seed` | `-1` | a seed |
"""


@pytest.fixture
def findings(tmp_path):
    """Return a function that makes a repository of one document, and returns the findings."""
    succeed('git', 'init', '--quiet', tmp_path)

    def findings_in(text: str) -> str:
        (tmp_path / 'README.md').write_text(text, encoding='utf-8')
        (tmp_path / 'test_it.py').write_text('def test_this():\n    pass\n', encoding='utf-8')
        succeed('git', 'add', '.', cwd=tmp_path)
        return '\n'.join(docs_check.findings(tmp_path))

    return findings_in


def test_a_good_document_has_no_findings(findings):
    assert findings(GOOD) == ''


@pytest.mark.parametrize(
    ('old', 'new', 'finding'),
    [
        ('(test_it.py)', '(test_them.py)', 'test_them.py'),
        ('src="test_it.py"', 'srcset="it.png"', 'it.png'),
        ('(#a-title-with-code)', '(#another)', '#another'),
        ('::test_this', '::test_that', 'test_it.py::test_that'),
        ('`0.0`', '`1.0`', 'speedup_factor = 1.0'),
        ('| `debug_seed` | `-1` | a seed |\n', '', 'debug_seed = -1'),
        ('<!-- parameters of ', '<!-- of ', 'tag_file'),
    ],
)
def test_each_fault_of_a_document_is_found(findings, old, new, finding):
    assert finding in findings(GOOD.replace(old, new))
