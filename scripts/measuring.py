# SPDX-License-Identifier: BSD-3-Clause
"""Runs programs and measures them; reads what the mapper reports of itself."""
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time

SECONDS_TO_END = 20.0  # between SIGTERM and SIGKILL


def run_logged(command, log_path, time_limit=None):
    """Runs a command, whatever comes of it, with its output in a file.

    Gives seconds, processor seconds, MiB at its peak, the exit code, and
    whether it was stopped at the time limit (seconds).
    """
    start = time.monotonic()
    with open(log_path, "wb") as log:
        process = subprocess.Popen(list(map(str, command)), stdout=log,
                                   stderr=log, start_new_session=True)
    # At the limit it may still remove what it has begun to write.
    timers = [threading.Timer(seconds, os.killpg, (process.pid, number))
              for seconds, number in (
                  (time_limit, signal.SIGTERM),
                  (time_limit + SECONDS_TO_END, signal.SIGKILL))
              ] if time_limit else []
    for timer in timers:
        timer.start()
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        os.killpg(process.pid, signal.SIGTERM)
        raise
    finally:
        for timer in timers:
            timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.monotonic() - start
    return {"seconds": seconds,
            "processor_seconds": usage.ru_utime + usage.ru_stime,
            "peak_memory_mib": usage.ru_maxrss / 1024,
            "exit_code": process.returncode,
            "is_stopped": bool(time_limit) and seconds >= time_limit}


def was_killed(measured):
    """By a signal from outside, such as for want of memory; not by itself, nor
    at the time limit."""
    from_outside = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM,
                    signal.SIGKILL)
    return not measured["is_stopped"] and -measured["exit_code"] in from_outside


def run_measured(command):
    """Runs a command that must succeed; what run_logged gives of costs."""
    with tempfile.TemporaryDirectory() as folder:
        log_path = pathlib.Path(folder) / "log"
        measured = run_logged(command, log_path)
        if measured["exit_code"] != 0:
            log = log_path.read_bytes().decode(errors="replace")
            sys.stderr.write(log[-2000:])
            raise SystemExit(f"failed: {' '.join(map(str, command))}")
    return {name: measured[name] for name in
            ("seconds", "processor_seconds", "peak_memory_mib")}


def stages_of(report):
    """Of the run and its models together, in the order of the report."""
    stages = {}
    for part in [report, *report["models"]]:
        for name in part["seconds"]:
            stage = stages.setdefault(
                name, {"seconds": 0.0, "processor_seconds": 0.0,
                       "peak_memory_mib_after": 0.0})
            stage["seconds"] += part["seconds"][name]
            stage["processor_seconds"] += part["processor_seconds"][name]
            stage["peak_memory_mib_after"] = max(
                stage["peak_memory_mib_after"],
                part["peak_memory_mib_after"][name])
    return stages
