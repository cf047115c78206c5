// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "command.h"
#include "foundation/base/sample_options.h"
#include "fuzz/fuzz_target.h"

namespace mgsfm {
namespace {

struct FuzzedOptions {
  SampleOptions sample;
  CommonOptions common;

  template <class Visitor>
  void Describe(Visitor& visit) {
    sample.Describe(visit);
    common.Describe(visit);
  }
};

}  // namespace

// One argument per line; configuration files have a target of their own.
void FuzzOptions(const std::string& input) {
  std::vector<std::string> arguments;
  std::istringstream lines(input);
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("--config_path", 0) == 0) return;
    arguments.push_back(line);
  }
  FuzzedOptions options;
  const OptionList list = ListOptions(&options);
  const bool is_accepted = Accepts([&] {
    SetOptions(arguments, list);
    CheckOptions(list);
  });
  if (!is_accepted) return;
  FuzzedOptions again;
  const OptionList list_again = ListOptions(&again);
  std::istringstream dump(DumpOptions(list));
  LoadOptions(dump, "dump", list_again);
  FUZZ_CHECK(OptionsToJson(list_again) == OptionsToJson(list));
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(options, mgsfm::FuzzOptions)
