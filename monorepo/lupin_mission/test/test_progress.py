"""The progress line at a terminal."""

import contextlib
import io
import os
import pty

from lupin_mission.progress import ProgressLine


def test_in_a_pipe_nothing_is_shown():
    stream = io.StringIO()
    line = ProgressLine(stream)
    line.show('1/29  tag 13  SCANNING')
    line.clear()
    assert stream.getvalue() == ''


def test_on_a_terminal_each_text_takes_the_position_of_the_last():
    screen, terminal = pty.openpty()
    with os.fdopen(terminal, 'w') as stream:
        line = ProgressLine(stream)
        for text in ('1/29  tag 13  SCANNING', '1/29  tag 13  SCANNING', 'x' * 200):
            line.show(text)
        line.clear()
        line.clear()
    shown = b''
    with contextlib.suppress(OSError):  # the end of a terminal that is closed
        while part := os.read(screen, 4096):
            shown += part
    os.close(screen)
    assert shown.decode() == f'\r\x1b[K1/29  tag 13  SCANNING\r\x1b[K{"x" * 79}\r\x1b[K'
