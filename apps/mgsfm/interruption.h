// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mgsfm {

// Makes SIGINT, SIGTERM and SIGHUP requests to stop in good order, as
// Context::is_canceled reports them. Signals that the caller has set to be
// ignored stay so (nohup, background jobs). A signal that comes two seconds
// after the first or later ends the process at once.
void CatchInterruptions();

// The first signal that was caught, or 0.
int InterruptionSignal();

// Ends the process by that signal, as if it had not been caught: only then do
// shells and make stop, too. If the signal cannot end the process (PID 1 of a
// container), returns the exit code that a shell would show.
int EndByInterruption();

}  // namespace mgsfm
