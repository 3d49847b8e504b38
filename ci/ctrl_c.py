"""
Ctrl-C ends a program without a traceback, also before the program handles it.

Scripts of this folder import this first. So does the environment's Python, for tools/ and the packages'
executables too; a person's own program keeps its traceback, which shows where it was.
"""

import sys

show = sys.excepthook
own = ('/lib/lupin_', '/_local_setup_util_sh.py')  # the latter finds the packages for a shell
if any(word.startswith(('ci/', 'tools/')) or any(each in word for each in own) for word in sys.orig_argv):
    # Python itself still ends by the signal.
    sys.excepthook = lambda kind, *rest: None if kind is KeyboardInterrupt else show(kind, *rest)


def begin() -> None:
    """Let Ctrl-C just end the process while Python reads the environment's packages, where no hook helps."""
    import _signal  # the module signal imports others

    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)


def finish() -> None:
    """Let Ctrl-C raise KeyboardInterrupt again, unless the process was started to ignore it."""
    import _signal

    if _signal.getsignal(_signal.SIGINT) is _signal.SIG_DFL:
        _signal.signal(_signal.SIGINT, _signal.default_int_handler)
