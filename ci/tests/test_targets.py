"""Targets of make: what they take from a person, and what they leave."""

import json
import os
import re
import sys

import pytest
from conftest import ROOT, make, of_a_user, run

REPORT = {
    'tag_id': '7', 'outcome': 'OK', 'detail': '', 'attempts': 1, 'stamp': {'sec': 1795190000, 'nanosec': 0},
    'sim_time_of_day_seconds': 43200.0, 'readings': {'co2': 400.0},
}  # fmt: skip
# A busy machine may not see a tag within a second.
PATIENCE = 'max_attempts:=1000 scan_timeout_s:=20 visual_confirmation_timeout_s:=20 retry_delay_seconds:=0.1'


def test_clean_leaves_what_a_person_may_want_to_keep(tmp_path):
    kept = ['.mission/report.jsonl', '.tags/tags.pdf', '.world/greenhouse.sdf', '.venv/bin/python']
    for each in [*kept, '.venv/workspace/monorepo/build.log', '.hypothesis/examples']:
        (tmp_path / each).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / each).touch()
    result = make('clean', 'VENV=.venv', cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert {str(each.relative_to(tmp_path)) for each in tmp_path.rglob('*') if each.is_file()} == set(kept)


@pytest.fixture
def reports(tmp_path):
    """Return a folder with two reports. The newer one has a route and a greenhouse of its own."""
    for each in ('ci', 'tools', 'monorepo', 'lupin_greenhouse_ros'):
        (tmp_path / each).symlink_to(ROOT / each)
    folder = tmp_path / '.mission'
    folder.mkdir()
    for number, name in enumerate(('2026-11-21-120000-simulation', '2026-11-20-130000-simulation')):
        report = folder / f'{name}.jsonl'
        report.write_text(json.dumps(REPORT) + '\n', encoding='utf-8')
        os.utime(report, (number, number))
    (folder / '2026-11-22-080000-simulation.jsonl').touch()  # of a run that ended at its start
    tags = {'tags': {'7': {'x': 1.25, 'y': 3.5, 'sensors': ['co2']}}, 'tables': {}}
    report.with_name(f'{name}-tag_locations.json').write_text(json.dumps(tags), encoding='utf-8')
    report.with_name(f'{name}-route.csv').write_text('x,y\n0.625,0.375\n1.375,3.125\n', encoding='utf-8')
    return tmp_path


def test_a_page_shows_the_newest_report_with_the_route_and_the_greenhouse_beside_it(reports):
    result = make('page', cwd=reports)
    assert result.returncode == 0, result.stderr
    newest = '.mission/2026-11-20-130000-simulation'
    assert result.stdout == f'page: of the newest report, {newest}.jsonl\npage: {newest}.html\n'
    page = (reports / f'{newest}.html').read_text(encoding='utf-8')
    assert re.search(r'"route":\[\[0.625,0.375\],\[1.375,3.125\]\]', page)
    assert '"x":1.25,"y":3.5' in page


def test_without_a_report_make_page_names_the_command_that_makes_one(tmp_path):
    result = make('page', cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith('page: .mission holds no report: make mission, or make page FILE=')


MISTAKES = [
    (['mission', 'RECORD=a.txt'], "mission: RECORD='a.txt' ends in none of .sqlite, .db, .csv: write "),
    (['mission', 'RECORD=no/a.csv'], "mission: RECORD='no/a.csv': there is no folder 'no': make it"),
    (['run', 'ARGS=use_sim_time:=true seed=42'], "run: ARGS has 'seed=42', which sets no parameter: "),
    (['run', 'ARGS=-p debug_sed:=42'], 'run: parameter debug_sed is unknown: did you mean debug_seed?'),
    (['run', 'ARGS=rate:=1'], 'run: parameter rate is unknown: the parameters are tag_file, '),
    (['tags', "SIDE=it's 4;cm"], "tags: SIDE='it's 4;cm' is no number of millimetres between"),
    (['tags', 'SIDE=7.9'], "tags: SIDE='7.9' is no number of millimetres between 8 and 152: write SIDE=40"),
    (['tags', 'SIDE=152.5'], "tags: SIDE='152.5' is no number of millimetres between 8 and 152: write"),
    (['mission', 'CAMERA=maybe'], 'CAMERA=maybe: write CAMERA=1 or CAMERA=0, CAMERA=comp'),
    (['mission', 'DRIVE=image'], 'DRIVE=image: write DRIVE=1 or DRIVE=0'),
    (['Red', 'tag=7'], 'there is no target Red: did you mean read?'),
    (['x\'$(HOME)"'], """there is no target x'$(HOME)": the targets are help run smoke read """),
    (['mirror-import', 'N.patch'], 'there is no target N.patch: write PATCH="N.patch"'),
    (['tags', '40'], 'there is no target 40: write SIDE="40"'),
    (['mission', 'DRIVE=', '1'], 'there is no target 1: write a value without a space, such as DRIVE=1'),
    (['read', 'TAG=1', '5'], 'there is no target 5: write TAG="1 5"'),
    (['mission', 'DRIVE'], 'there is no target DRIVE: write DRIVE=1'),
    (['mission', 'DRIVE', 'CAMERA'], 'there is no target DRIVE CAMERA: write DRIVE=1 CAMERA=1.'),
    (['read', 'TAG', '1'], 'there is no target TAG 1: write TAG=1.'),
    (['read', 'TAG', '1', '5'], 'there is no target TAG 1 5: write TAG="1 5".'),
    (['mission', 'mission.db'], 'there is no target mission.db: write RECORD="mission.db".'),
    (['mirror-import', 'PATCH'], 'there is no target PATCH: write PATCH=VALUE.'),
    (['page', 'FILE=a.csv', 'README.md'], 'there is no target README.md: write FILE="a.csv README.md"'),
    (['read', 'tag=7'], 'make read takes no tag: it takes ARGS NAMESPACE TAG TREE DISTRO PYTHON VENV CC '),
    (['page', 'RECORD=x'], ' TREE DISTRO PYTHON VENV CC CXX; RECORD is of make mission.'),
    (['run', 'seed:=3'], '; set a parameter with ARGS="name:=value".'),
    (['TAG=7'], 'make help takes no TAG: '),
    (['read', 'ROS_DOMAIN_ID=5'], '; write ROS_DOMAIN_ID=... before make.'),
    (['run', 'NAMESPACE=a b'], "NAMESPACE='a b' is none: write letters, digits and _, such as "),
    (['read', 'NAMESPACE=1team'], "NAMESPACE='/1team' is none: write letters, digits and _, such as "),
    (['mission', 'TREE=lupin_greenhouse_ros'], 'it is in the monorepo only: make mission TREE=monorepo'),
    (['env', 'VENV=Makefile'], '/Makefile was not made by this project and is left alone: move it away'),
    (['env', 'VENV=/proc/x'], '/proc/x: No such file or directory: name another folder with make VENV=...'),
    (['run', 'ARGS="a:=1'], 'ARGS has a quote without its pair: '),
    (['mission', 'CAMERA=image 1'], 'CAMERA=image 1: write CAMERA=1 or CAMERA=0'),
    (['TREE=nowhere'], 'TREE=nowhere is not a tree'),
    (['DISTRO=humble'], 'DISTRO=humble has no wheels'),
    (['env', 'PYTHON=false'], 'false is not Python 3.10 or newer: sudo apt install'),
    (['run', "VENV=/My 'green' house"], 'move the clone to a folder whose path has letters'),
]


@pytest.mark.parametrize(('words', 'said'), MISTAKES)
def test_a_mistake_is_named_in_one_line_before_anything_is_built(words, said):
    result = run('make', 'VENV=/nowhere', *words, env=of_a_user())
    first, *rest = result.stderr.splitlines()
    assert result.returncode == 2
    assert said in first
    assert all(line.startswith('make: *** ') for line in rest)


UNBUILT = 'TREE=lupin_greenhouse_ros is not built: make build TREE=lupin_greenhouse_ros'


def test_a_shell_that_enters_another_tree_leaves_the_first_and_is_told_how_to_build_it(tmp_path):
    (tmp_path / 'workspace/monorepo/install').mkdir(parents=True)
    enter = 'source ci/ros_env.bash; echo "$PATH:$PYTHONPATH:$LD_LIBRARY_PATH:$AMENT_PREFIX_PATH"'
    script = f'{enter}; export VENV={tmp_path} TREE=lupin_greenhouse_ros; {enter}'
    ended = run('bash', '-c', script, env=of_a_user())
    assert ended.stderr == f'{UNBUILT}, or export TREE=monorepo, which is built\n'
    first, second = ended.stdout.splitlines()
    assert 'workspace/monorepo/' in first
    assert 'workspace/monorepo/' not in second


IN_ENVIRONMENT = [
    ({}, 'read_tags', 127, "there is no command 'read_tags'"),
    ({'TREE': 'mono'}, 'true', 1, 'TREE=mono is not a tree: set TREE=monorepo or TREE=lupin_greenhouse'),
    ({'TREE': 'lupin_greenhouse_ros', 'VENV': ''}, 'read_tag', 127, UNBUILT),
]


@pytest.mark.parametrize(('variables', 'command', 'exit_code', 'said'), IN_ENVIRONMENT)
def test_a_command_in_the_environment_that_cannot_run_is_one_line(
    tmp_path, variables, command, exit_code, said
):
    (tmp_path / '.lupin-environment').touch()
    environment = of_a_user(**{name: value or str(tmp_path) for name, value in variables.items()})
    ended = run(sys.executable, 'ci/within.py', command, env=environment)
    (line,) = ended.stderr.splitlines()
    assert (ended.returncode, said in line) == (exit_code, True)


def test_a_command_in_the_environment_runs_where_the_person_stands(tmp_path):
    assert run(sys.executable, ROOT / 'ci/within.py', 'pwd', cwd=tmp_path).stdout == f'{tmp_path}\n'


MATRIX = [
    ({'PYTHONS': '3.9'}, 'matrix: PYTHONS=3.9: write versions such as 3.12, 3.10 or newer\n'),
    ({'PYTHONS': '3.99'}, 'matrix: no Python 3.99 here\n'),
    ({'DISTROS': 'humble'}, 'matrix: DISTROS=humble: write kilted or jazzy\n'),
    ({'SIMULATORS': '2.0'}, 'matrix: SIMULATORS=2.0: write 1.0.7 or 1.0.8\n'),
]


@pytest.mark.parametrize(('variables', 'said'), MATRIX)
def test_the_matrix_refuses_what_it_cannot_run(variables, said):
    ended = run(sys.executable, 'ci/run_tests.py', 'matrix', env=of_a_user(**variables))
    assert (ended.returncode, ended.stderr) == (1, said)


def test_a_page_is_made_of_one_file_whose_name_may_have_a_space(reports):
    report = '.mission/2026-11-20-130000-simulation.jsonl'
    (reports / 'the last.jsonl').write_bytes((reports / report).read_bytes())
    result = make('page', 'FILE=the last.jsonl', 'ARGS=--output page.html', cwd=reports)
    assert (result.returncode, result.stdout) == (0, 'page: page.html\n'), result.stderr
    # With what lies beside that file: nothing.
    assert '"route":[]' in (reports / 'page.html').read_text(encoding='utf-8')


def test_a_switch_is_off_with_0_and_on_with_1():
    for off in ('DRIVE=0 CAMERA=no', 'DRIVE=False CAMERA='):
        shown = make('mission', '--dry-run', *off.split()).stdout
        assert '/inspection' in shown  # it is not refused
        assert not re.search('--(drive|camera)', shown)
    for on in ('DRIVE=On CAMERA=yes', 'DRIVE=TRUE CAMERA=1'):
        assert '--camera image --drive' in make('mission', '--dry-run', *on.split()).stdout


@pytest.mark.parametrize('target', ['mission'])
def test_the_arguments_are_checked_before_what_the_target_needs_is_made(target):
    shown = make(target, '--dry-run', *(['DRIVE=1'] if target == 'mission' else [])).stdout
    assert shown.index('--check') < shown.index('ci/within.py')


def test_smoke_does_not_wait_for_the_discovery_server_of_a_robot_that_is_off():
    result = make('smoke', ROS_DISCOVERY_SERVER='127.0.0.1:11811')
    assert result.returncode == 0, result.stderr
    assert '29/29 tags read' in result.stdout
    assert 'smoke: starting a bridge' in result.stderr


def test_a_target_of_the_monorepo_runs_whatever_tree_a_shell_has_set(tmp_path):
    shell = tmp_path / 'shell'
    shell.write_text('#!/bin/sh\necho $TREE\n')  # instead of the commands of a target
    shell.chmod(0o755)
    targets = ['bench', 'docs-check', 'figure', 'soak', 'tags', 'world']
    result = make('--eval', f'override SHELL := {shell}', *targets, TREE='lupin_greenhouse_ros')
    assert (set(result.stdout.split()), result.stderr) == ({'monorepo'}, '')


@pytest.fixture
def shown(tmp_path):
    """Return a function that runs a target, whose program only prints its arguments, one a line."""
    (tmp_path / 'ci').mkdir()
    (tmp_path / 'ci/check_run.py').touch()
    (tmp_path / 'ci/ros_env.bash').write_text('LUPIN_EXECUTABLES=ci; python() { printf \'%s\\n\' "$@"; }\n')
    for name in ('serve', 'read_tag'):
        (tmp_path / 'ci' / name).write_text('#!/bin/sh\nprintf \'%s\\n\' "$@"\n')
        (tmp_path / 'ci' / name).chmod(0o755)
    return lambda *words: make('-o', 'env', *words, cwd=tmp_path).stdout.splitlines()


SERVICE = '/team7/greenhouse_bridge/get_tag_reading'
RUN = '$(touch x) `touch x` $HOME $(shell touch x) a;touch x'  # if a shell or make took it as its own


@pytest.mark.parametrize(
    ('words', 'arguments'),
    [
        (['read'], ['1']),
        (['read', 'TAG=1,5', 'NAMESPACE=/'], ['1', '5']),
        (['read', 'TAG=all', 'NAMESPACE=team7'], ['--all', '--service', SERVICE]),
        (['read', f"TAG=it's {RUN}"], ["it's", *RUN.split()]),
        (['run', 'NAMESPACE=team7/', 'ARGS=debug_seed:=3'], ['namespace:=/team7', 'debug_seed:=3']),
        (['tags', 'SIDE=40.5'], ['tools/draw/tag_sheet.py', '--side', '40.5']),
        (['figure', f'ARGS="b  c" "it\'s" {RUN}'], ['tools/draw/figure.py', 'b  c', "it's", *RUN.split()]),
        (['figure', 'ARGS=a=~ ~'], ['tools/draw/figure.py', 'a=~', os.path.expanduser('~')]),
        (
            ['mirror-publish', f"REMOTE=it's {RUN}", 'RELEASE=1;2'],
            ['tools/mirror_publish.py', f"it's {RUN}", '--release', '1;2'],
        ),
        (['mirror-import', f'PATCH=a b.patch {RUN}'], ['tools/mirror_import.py', f'a b.patch {RUN}']),
    ],
)
def test_a_program_gets_the_words_that_a_person_wrote_and_nothing_in_them_is_run(
    shown, tmp_path, words, arguments
):
    assert shown(*words) == arguments
    assert not (tmp_path / 'x').exists()


def test_a_bridge_in_a_namespace_is_read_there(open_shell):
    open_shell().paste('ci/serve namespace:=team7/ -p debug_time_of_day:=12')
    read = 'make read TAG=1 NAMESPACE=/team7 ARGS="--json --timeout 60" 2>/dev/null'
    assert json.loads(open_shell().run(read))['sim_time_of_day_seconds'] == 43200.0


@pytest.mark.heavy
@pytest.mark.parametrize(
    'options',
    ['CAMERA=compressed', 'CAMERA=detections'],
)
def test_the_mission_reads_the_tags_that_its_camera_sees(tmp_path, options):
    arguments = f'ARGS=--output {tmp_path} tag_sequence:="1 13 30" {PATIENCE}'
    result = make('mission', *options.split(), arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    (report,) = tmp_path.glob('*.jsonl')
    visits = [json.loads(line) for line in report.read_text(encoding='utf-8').splitlines()]
    assert {each['tag_id']: each['outcome'] for each in visits} == dict.fromkeys(('1', '13', '30'), 'OK')
    assert report.with_suffix('.html').exists()
