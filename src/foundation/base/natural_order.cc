// SPDX-License-Identifier: BSD-3-Clause
#include "base/natural_order.h"

#include <algorithm>
#include <cctype>
#include <cstddef>

namespace mgsfm {
namespace {

bool IsDigit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

// The digits at a position, without leading zeros.
std::string NumberAt(const std::string& text, size_t* position) {
  const size_t begin = *position;
  while (*position < text.size() && IsDigit(text[*position])) ++*position;
  const std::string digits = text.substr(begin, *position - begin);
  return digits.substr(std::min(digits.find_first_not_of('0'), digits.size()));
}

// The value of digits after a common prefix: long numbers, such as times in
// nanoseconds, are not exact in double precision.
double ValueAfter(size_t prefix, const std::string& digits) {
  double value = 0.0;
  for (size_t i = prefix; i < digits.size(); ++i) {
    value = 10.0 * value + (digits[i] - '0');
  }
  return value;
}

double Difference(const std::string& number_a, const std::string& number_b) {
  size_t prefix = 0;
  while (number_a.size() == number_b.size() && prefix < number_a.size() &&
         number_a[prefix] == number_b[prefix]) {
    ++prefix;
  }
  return ValueAfter(prefix, number_b) - ValueAfter(prefix, number_a);
}

}  // namespace

bool IsNaturallyBefore(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (IsDigit(a[i]) && IsDigit(b[j])) {
      const std::string number_a = NumberAt(a, &i), number_b = NumberAt(b, &j);
      if (number_a.size() != number_b.size()) {
        return number_a.size() < number_b.size();
      }
      if (number_a != number_b) return number_a < number_b;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
    }
  }
  return a.size() - i < b.size() - j;
}

std::optional<double> NumberDifference(const std::string& a,
                                       const std::string& b) {
  std::optional<double> difference;
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (IsDigit(a[i]) && IsDigit(b[j])) {
      const std::string number_a = NumberAt(a, &i), number_b = NumberAt(b, &j);
      if (number_a == number_b) continue;
      if (difference) return std::nullopt;
      difference = Difference(number_a, number_b);
    } else {
      if (a[i] != b[j]) return std::nullopt;
      ++i, ++j;
    }
  }
  return i == a.size() && j == b.size() ? difference : std::nullopt;
}

}  // namespace mgsfm
