# SPDX-License-Identifier: BSD-3-Clause
"""Runs a program and says what it took."""
import os
import subprocess
import sys
import tempfile
import time


def run_measured(command):
    """Runs a command; seconds, processor seconds and MiB at its peak."""
    start = time.monotonic()
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            log.seek(0)
            sys.stderr.write(log.read().decode(errors="replace")[-2000:])
            raise SystemExit(f"failed: {' '.join(map(str, command))}")
    return {"seconds": time.monotonic() - start,
            "processor_seconds": usage.ru_utime + usage.ru_stime,
            "peak_memory_mib": usage.ru_maxrss / 1024}
