// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// A program that links system_calls.cc calls the system through it: mgsfm, the
// standard library and SQLite alike. Calls on files below a folder are counted,
// and one of them can go wrong.
enum class Fault {
  kNone,
  kError,        // the call fails with FaultPlan::error, once
  kErrorAlways,  // so do all later ones of its kind: a full or broken disk
  kShort,        // a write or read takes half of the bytes
  kKill,         // the process ends instead of the call
  kPowerLoss,    // so does the machine: see PowerLoss
};

// The changes since the last fsync of a file or folder that are lost.
enum class PowerLoss {
  kAll,          // content, and names: creation, removal and renames
  kContent,      // content only: a renamed file may be empty
  kSomeContent,  // random parts of it
};

enum class CallKind { kRead, kWrite, kSync, kName, kOpen, kLock };

// The calls that count.
enum class CountedCalls {
  kChanges,
  kChangesAndReads,  // also reading, and opening for it
  kLocks             // only the locks by which SQLite excludes other programs
};

struct FaultPlan {
  std::string folder;  // without links
  long call = -1;      // the number of the call that goes wrong, from 0
  Fault fault = Fault::kNone;
  int error = 0;
  PowerLoss loss = PowerLoss::kAll;
  CountedCalls counted = CountedCalls::kChanges;
};

constexpr int kKilledExitCode = 99;

// Begins to count in this process; SQLite must not be in use. Children of the
// process, and their exit, are not affected.
void StartFaults(const FaultPlan& plan);
void StopFaults();

// Calls counted since StartFaults, in this process or, after fork, in a child.
long NumCalls();
CallKind KindOfFaultyCall();

}  // namespace mgsfm
