// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace mgsfm {

// Bad input: an unusable file, image, frame, pair or option. The message is one
// line that names the item and the remedy. Commands print it, write nothing and
// exit with code 1.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

// A violated precondition or invariant: a bug in the program, not bad input.
class ContractError : public std::logic_error {
 public:
  explicit ContractError(const std::string& message)
      : std::logic_error(message) {}
};

// Thrown when Context::is_canceled returns true. Unwinds the run without
// writing any output.
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

// Checks that throw ContractError with file, line, condition and values.
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
