"""Sleeping until an absolute time, and real-time priority, by Linux system calls."""

from __future__ import annotations

import ctypes
import errno
import os

from feedopt_core.units import NS_PER_S

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1
_LIBC = ctypes.CDLL(None, use_errno=True)


class _Timespec(ctypes.Structure):
    _fields_ = [("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long)]


def sleep_until(deadline_ns: int) -> None:
    """Sleep until a time of the monotonic clock, ns; returns at once if that time has passed.

    The deadline is absolute, so the lateness of one tick does not delay the next. The interpreter lock is released
    during the sleep.
    """
    deadline = _Timespec(*divmod(deadline_ns, NS_PER_S))
    while True:
        code = _LIBC.clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(deadline), None)
        if code == 0:
            return
        if code != errno.EINTR:
            raise OSError(code, f"clock_nanosleep: {os.strerror(code)}")


def request_real_time_priority(priority: int) -> str:
    """Schedule the calling thread with SCHED_FIFO.

    Returns:
        Empty if granted; else the cause of the refusal. Other processes can then delay the ticks.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"no real-time priority ({error.strerror}); allow it with an rtprio line in /etc/security/limits.conf"
    return ""
