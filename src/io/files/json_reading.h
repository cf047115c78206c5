// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace mgsfm {

// Throws Error, "`what` is not valid JSON: ...; `remedy`", also for duplicate
// keys of an object, of which libraries keep the last.
nlohmann::json ParseJson(const std::string& text, const std::string& what,
                         const std::string& remedy = "correct it");

}  // namespace mgsfm
