"""The report: its contents after a kill, and the files that it refuses."""

import os
import resource
from dataclasses import replace

import pytest
from lupin_mission.report import Report, ReportError, summary_table
from lupin_readings.report_line import Observation, Outcome, Reading
from mission_helpers import observations_in

OK = Observation('7', Outcome.OK, '', 1, Reading('7', (12, 34), 43200.0, {'temperature': 21.5, 'co2': 600.0}))
FAILED = Observation('8', Outcome.TIMEOUT, 'no reply before the timeout', 3)


def lines_of(*observations) -> str:
    return ''.join(f'{each.to_line()}\n' for each in observations)


def test_a_line_that_a_kill_cut_short_is_not_there_unless_it_lacks_only_its_newline(tmp_path):
    path, line = tmp_path / 'report.jsonl', FAILED.to_line()
    for cut in range(1, len(line) + 1):
        kept = [OK, FAILED] if cut == len(line) else [OK]
        path.write_text(f'{OK.to_line()}\n{line[:cut]}', encoding='utf-8')
        assert observations_in(path) == kept
        report = Report(path)
        report.record(FAILED)
        report.close()
        assert path.read_text(encoding='utf-8') == lines_of(*kept, FAILED)


@pytest.mark.parametrize(('size', 'kept'), [(0, []), (len(OK.to_line()) + 10, [OK])])
def test_a_report_that_another_program_cuts_goes_on_without_a_gap(tmp_path, size, kept):
    path = tmp_path / 'report.jsonl'
    report = Report(path)
    for _ in range(2):
        report.record(OK)
    os.truncate(path, size)
    for _ in range(2):
        report.record(FAILED)
    report.close()
    assert path.read_text(encoding='utf-8') == lines_of(*kept, FAILED, FAILED)


@pytest.mark.parametrize(
    'content',
    ['my notes', '\n', OK.to_line() + '\nnotes', OK.to_line().replace('21.5', '-Infinity') + '\n'],
)
def test_a_file_that_is_no_report_is_refused_and_left_alone(tmp_path, content):
    path = tmp_path / 'notes.txt'
    path.write_text(content, encoding='utf-8')
    with pytest.raises(ReportError, match=r'notes\.txt.*( not an observation|has a wrong value)') as refusal:
        Report(path)
    assert path.read_text(encoding='utf-8') == content
    path.write_bytes(b'')
    Report(path).close()  # otherwise another mission would seem to write it
    del refusal


@pytest.mark.parametrize(
    ('path', 'reason'),
    [
        *((path, 'name a file that can be written') for path in ('', '.', 'nul\0')),
        ('missing/report.jsonl', "make the folder 'missing'"),
        *((path, 'is not a regular file') for path in ('/dev/zero', 'pipe')),
    ],
)
def test_a_place_where_no_report_can_be_is_refused(tmp_path, monkeypatch, path, reason):
    monkeypatch.chdir(tmp_path)
    os.mkfifo('pipe')
    with pytest.raises(ReportError, match=reason):
        Report(path)


def test_two_missions_do_not_write_one_report(tmp_path):
    first = Report(tmp_path / 'report.jsonl')
    with pytest.raises(ReportError, match='another mission is writing it'):
        Report(tmp_path / 'report.jsonl')
    first.close()
    Report(tmp_path / 'report.jsonl').close()


def test_a_full_disk_leaves_whole_lines_only(tmp_path):
    """A limit on file sizes replaces the full disk: both end a write early."""
    report = Report(tmp_path / 'report.jsonl')
    report.record(Observation('1', Outcome.TIMEOUT, '', 1))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150, limits[1]))
    try:
        with pytest.raises(ReportError, match='File too large'):
            report.record(Observation('2', Outcome.TIMEOUT, 'x' * 100, 1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        report.close()
    assert [each.tag_id for each in observations_in(report.path)] == ['1']
    assert report.path.read_bytes().endswith(b'\n')


def test_the_table_has_a_row_for_each_tag_and_counts_the_read_ones():
    unseen = Observation('8', Outcome.NOT_CONFIRMED, 'not in view', 3, seen=False)
    rows = [line.split() for line in summary_table([OK, FAILED], iter(['7', '8', '9'])).splitlines()]
    assert rows == [
        ['tag', 'sim', 'time', 'temperature', 'co2', 'outcome'],
        ['h:min', '°C', 'ppm'],
        ['7', '12:00', '21.5', '600', 'OK'],
        ['8', 'TIMEOUT', 'no', 'reply', 'before', 'the', 'timeout'],
        ['9', 'not', 'visited'],
        ['1/3', 'tags', 'read'],
    ]
    forged = replace(OK, reading=replace(OK.reading, values={'co2\n8 OK': 1.0}))
    assert len(summary_table([forged], ['7']).splitlines()) == 4
    # The last observation of a tag counts. With a camera, the table tells what it saw.
    seen = [FAILED, unseen, OK, replace(OK, seen=True, pose=2)]
    rows = [line.split() for line in summary_table(seen, ['7', '8']).splitlines()]
    assert rows[0][-2:] == ['seen', 'outcome']
    assert rows[2][-5:] == ['yes', 'OK', 'from', 'pose', '2']
    assert rows[3] == ['8', 'no', 'NOT_CONFIRMED', 'not', 'in', 'view']
    assert rows[4] == ['1/2', 'tags', 'read']
