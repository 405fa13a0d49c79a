"""Ctrl-C while a mocked flight lasts."""

import contextlib
import os
import signal

import pytest

from guidance.cli.fly import noted_ctrl_c


def test_a_ctrl_c_that_a_library_swallows_is_raised_again_at_the_next_cycle():
    before = signal.getsignal(signal.SIGINT)
    shown = []
    with noted_ctrl_c(shown.append) as show:
        show("one")
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            signal.sigtimedwait([], 1.0)
        with pytest.raises(KeyboardInterrupt):
            show("two")
    assert shown == ["one"]
    assert signal.getsignal(signal.SIGINT) is before
