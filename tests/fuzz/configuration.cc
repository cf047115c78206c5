// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "foundation/base/sample_options.h"
#include "fuzz/fuzz_target.h"

namespace mgsfm {

// The options that a configuration file sets are written by --dump_config, and
// read back.
void FuzzConfiguration(const std::string& input) {
  SampleOptions options;
  std::istringstream text(input);
  if (!Accepts([&] { LoadOptions(text, "config", ListOptions(&options)); })) {
    return;
  }
  const std::string dump = SampleDump(options);
  SampleOptions again;
  std::istringstream dumped(dump);
  LoadOptions(dumped, "dump", ListOptions(&again));
  FUZZ_CHECK(SampleDump(again) == dump);
  FUZZ_CHECK(*again.title == *options.title);
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(configuration, mgsfm::FuzzConfiguration)
