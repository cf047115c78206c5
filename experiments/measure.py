# SPDX-License-Identifier: BSD-3-Clause
"""Runs programs, measures their cost, and reads the mapper's own report."""
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time

SECONDS_TO_END = 20.0  # between SIGTERM and SIGKILL


class StepFailed(Exception):
    """A step failed for a reason outside the compared method: wrong options or
    input, a full disk, a signal, a defect. It leaves no record.

    An external method that failed has a `record`, so that tables show it, but
    it runs again.
    """

    def __init__(self, message, record=None):
        super().__init__(message)
        self.record = record


def run_logged(command, log_path, time_limit=None, environment=None):
    """Runs a command, successful or not, and writes its output to a file.

    Returns a dictionary: wall `seconds`, `processor_seconds`,
    `peak_memory_mib`, the `exit_code` (negative: a signal), and `is_stopped`,
    true if it reached `time_limit` (seconds).
    """
    start = time.monotonic()
    with open(log_path, "wb") as log:
        process = subprocess.Popen(list(map(str, command)), stdout=log,
                                   stderr=log, env=environment,
                                   start_new_session=True)
    timers = start_timers(process.pid, time_limit)
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


def start_timers(process_group, time_limit):
    """SIGTERM at the limit, so that the process can clean up; later SIGKILL."""
    if not time_limit:
        return []
    timers = [threading.Timer(seconds, os.killpg, (process_group, number))
              for seconds, number in (
                  (time_limit, signal.SIGTERM),
                  (time_limit + SECONDS_TO_END, signal.SIGKILL))]
    for timer in timers:
        timer.start()
    return timers


def was_killed(measured):
    """True if a signal from outside ended the run, e.g. for lack of memory.

    False for a crash and for a run that reached its time limit.
    """
    from_outside = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM,
                    signal.SIGKILL)
    return not measured["is_stopped"] and -measured["exit_code"] in from_outside


def last_line(log_path):
    """The last line of a log that is not blank."""
    lines = log_path.read_text(errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()),
                f"see {log_path}")


def run_step(command, log_path):
    """Calls run_logged(); throws StepFailed unless the exit code is 0."""
    measured = run_logged(command, log_path)
    if measured["exit_code"] != 0:
        raise StepFailed(f"{last_line(log_path)} ({log_path})")
    return measured


def run_measured(command, environment=None):
    """Runs a command that must succeed; returns the costs of run_logged()."""
    with tempfile.TemporaryDirectory() as folder:
        log_path = pathlib.Path(folder) / "log"
        measured = run_logged(command, log_path, environment=environment)
        if measured["exit_code"] != 0:
            log = log_path.read_bytes().decode(errors="replace")
            sys.stderr.write(log[-2000:])
            raise SystemExit(f"failed: {' '.join(map(str, command))}")
    return {name: measured[name] for name in
            ("seconds", "processor_seconds", "peak_memory_mib")}


def stages_of(report):
    """{stage: costs} from report.json, over the run and all of its models.

    Seconds are summed; `peak_memory_mib_after` is the largest. Stages keep the
    order of the report.
    """
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
