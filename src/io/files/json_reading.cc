// SPDX-License-Identifier: BSD-3-Clause
#include "files/json_reading.h"

#include <set>
#include <vector>

#include "base/text.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

nlohmann::json ParseJson(const std::string& text, const std::string& what,
                         const std::string& remedy) {
  using Json = nlohmann::json;
  std::vector<std::set<std::string>> keys_of_open_objects;
  const auto check = [&](int, Json::parse_event_t event, const Json& value) {
    if (event == Json::parse_event_t::object_start) {
      keys_of_open_objects.emplace_back();
    } else if (event == Json::parse_event_t::object_end) {
      keys_of_open_objects.pop_back();
    } else if (event == Json::parse_event_t::key) {
      const std::string key = value.get<std::string>();
      if (!keys_of_open_objects.back().insert(key).second) {
        throw Error(what + " has the key '" + Printable(key) +
                    "' twice in one object; remove one of them");
      }
    }
    return true;
  };
  try {
    return Json::parse(text, check);
  } catch (const Json::exception& error) {
    // Strips the name of the exception, "[json.exception.parse_error.101] ".
    const std::string problem = error.what();
    const size_t bracket = problem.find("] ");
    throw Error(what + " is not valid JSON: " +
                problem.substr(bracket == std::string::npos ? 0 : bracket + 2) +
                "; " + remedy);
  }
}

}  // namespace mgsfm
