// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace mgsfm {

// Bad input: a file, image, frame, pair or option that cannot be used. The
// message is one line that names it and says what the user can do. Commands
// print it and exit with code 1; nothing is written.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

// A broken contract between two parts of the program: a defect, not bad input.
class ContractError : public std::logic_error {
 public:
  explicit ContractError(const std::string& message)
      : std::logic_error(message) {}
};

// The run was asked to stop (Context::is_cancelled). Like any exception it
// unwinds what was begun: nothing is written.
class Interrupted : public std::runtime_error {
 public:
  Interrupted() : std::runtime_error("interrupted") {}
};

namespace internal {

[[noreturn]] void ThrowContractError(const char* file, int line,
                                     const char* condition,
                                     const std::string& values);

template <class A, class B>
std::string FormatOperands(const A& a, const B& b) {
  std::ostringstream os;
  os << a << " vs. " << b;
  return os.str();
}

}  // namespace internal
}  // namespace mgsfm

// Contract checks: throw ContractError with file, line, condition and values.
#define MGSFM_CHECK_MSG(condition, message)                                 \
  do {                                                                      \
    if (!(condition)) {                                                     \
      ::mgsfm::internal::ThrowContractError(__FILE__, __LINE__, #condition, \
                                            (message));                     \
    }                                                                       \
  } while (false)
#define MGSFM_CHECK(condition) MGSFM_CHECK_MSG(condition, std::string())
#define MGSFM_CHECK_OP(a, op, b) \
  MGSFM_CHECK_MSG((a)op(b), ::mgsfm::internal::FormatOperands((a), (b)))
#define MGSFM_CHECK_EQ(a, b) MGSFM_CHECK_OP(a, ==, b)
#define MGSFM_CHECK_NE(a, b) MGSFM_CHECK_OP(a, !=, b)
#define MGSFM_CHECK_LT(a, b) MGSFM_CHECK_OP(a, <, b)
#define MGSFM_CHECK_LE(a, b) MGSFM_CHECK_OP(a, <=, b)
#define MGSFM_CHECK_GT(a, b) MGSFM_CHECK_OP(a, >, b)
#define MGSFM_CHECK_GE(a, b) MGSFM_CHECK_OP(a, >=, b)
