"""The README's first commands print what it shows, and the check of the documents can fail."""

import ast
import re
from pathlib import Path

import docs_check
import pytest
from conftest import ROOT, make, succeed


def without_numbers(text: str) -> list[str]:
    """Return the lines of a text with all numbers replaced: times and noise differ from run to run."""
    return [re.sub(r'\s+', ' ', re.sub(r'\d+(\.\d+)*', 'N', line)) for line in text.splitlines()]


def test_the_two_commands_of_the_readme(open_shell):
    """Each `$ command` of its console block prints what is shown below it, and its client reads tag 1."""
    blocks = docs_check.Document(ROOT, Path('README.md')).blocks
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
        return shell.run(f"python - <<'END' || echo exit code $?\n{client.replace(old, new)}\nEND")

    values = ast.literal_eval(run_client('', ''))
    assert values['temperature'] == pytest.approx(22.7, abs=0.05)
    assert values.keys() == {'temperature', 'co2'}
    assert "Tag '99' is not in" in run_client("tag_id='1'", "tag_id='99'")
    server.close()
    told = 'no bridge is found: start it (make run), with the same ROS_DOMAIN_ID\nexit code 1\n'
    assert run_client('timeout_sec=5.0', 'timeout_sec=0.1') == told


def test_the_mirror_shows_the_table_of_the_readme():
    readme, mirror = (
        re.findall(r'^tag +sim time.*\n(?:1 .*\n)+', (ROOT / tree / 'README.md').read_text(), re.MULTILINE)
        for tree in ('.', 'lupin_greenhouse_ros')
    )
    assert len(readme) == 1
    assert mirror == readme


def test_the_documents_are_true():
    """Whatever TREE a reader works with."""
    result = make('docs-check', TREE='lupin_greenhouse_ros')
    assert result.returncode == 0, result.stdout + result.stderr
    assert re.search(r'^\d+ documents, \d+ shell blocks: 0 findings$', result.stdout)


@pytest.fixture(scope='module')
def facts():
    """Return what documents must say of the bridge."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')  # no other node of the same name
        patch.setattr(docs_check, 'NODES', {'greenhouse_bridge': docs_check.NODES['greenhouse_bridge']})
        found = docs_check.facts_in_code()
    assert OF_BRIDGE.replace('.settings.', '.reading.read_on_sight.') in found
    return {mark: found[mark] for mark in (OF_BRIDGE, docs_check.GRAPHS)}


@pytest.fixture
def findings(tmp_path, facts):
    """Return a function that makes a repository of one document, and returns the findings."""
    succeed('git', 'init', '--quiet', tmp_path)

    def findings_in(text: str) -> str:
        (tmp_path / 'README.md').write_text(text, encoding='utf-8')
        (tmp_path / 'test_it.py').write_text('def test_this():\n    pass\n', encoding='utf-8')
        succeed('git', 'add', '.', cwd=tmp_path)
        return '\n'.join(docs_check.findings_of([docs_check.Document(tmp_path, Path('README.md'))], facts))

    return findings_in


OF_BRIDGE = 'parameters of lupin_greenhouse_bridge.settings.Settings'
GOOD = """# A title: with `code`

[here](#a-title-with-code) [there](test_it.py) [away](https://example.org)
<img alt="a round" src="test_it.py">

<!-- needs a robot -->
```bash
drive
```

<!-- tested by test_it.py::test_this -->
```console
$ anything
```

Shown by `test_it.py`.

<!-- parameters of lupin_greenhouse_bridge.settings.Settings -->
| name | default | effect |
|---|---|---|
| `tag_file` | `''` | a file |
| `sim_config_file` | empty | a file |
| `debug_time_of_day` | `-1.0` | hours |

<!-- parameters of lupin_greenhouse_bridge.settings.Settings -->
| name | default | effect |
|---|---|---|
| `speedup_factor` | `0.0` | simulated seconds per second |
| `debug_seed` | `-1` | a seed |

```mermaid
flowchart LR
    node([your node]) -.-> x["/greenhouse_bridge/<br>get_tag_reading<br>GetTagReading"] -.-> greenhouse_bridge
    node --> stop["/stop<br>Bool"] --> robot([a robot]) & lamp
```
"""


def test_a_good_document_has_no_findings(findings):
    assert findings(GOOD) == ''


@pytest.mark.parametrize(
    ('old', 'new', 'finding'),
    [
        ('(test_it.py)', '(test_them.py)', 'the link test_them.py leads nowhere'),
        ('src="test_it.py"', 'srcset="it.png"', 'the link it.png leads nowhere'),
        ('(#a-title-with-code)', '(#another)', 'the link #another names no heading'),
        ('::test_this', '::test_that', 'there is no test test_it.py::test_that'),
        ('`test_it.py`', '`test_them.py`', 'there is no test test_them.py'),
        ('<!-- needs a robot -->\n', '', 'mark this block with tested by, needs or followed by: drive'),
        ('`0.0`', '`1.0`', f'no document has this in the {OF_BRIDGE}: | speedup_factor | 0.0 |'),
        ('`0.0`', '`1.0`', f'wrong in the {OF_BRIDGE}: | speedup_factor | 1.0 |'),
        ('<!-- parameters of ', '<!-- of ', 'mark this table with `parameters of'),
        ('<br>GetTagReading', '<br>GetReading', 'graphs: /greenhouse_bridge/get_tag_reading GetReading -'),
        ('node([your', '    node([your', 'write this line of a graph as `source --> id["/name<br>'),
        ('-.-> greenhouse', '--> greenhouse', 'this in the ROS graphs: /greenhouse_bridge/get_tag_reading'),
        ('[here]', '    make run\n\n[here]', 'fence this block and set its language: make run'),
    ],
)
def test_each_fault_of_a_document_is_found(findings, old, new, finding):
    assert finding in findings(GOOD.replace(old, new))
