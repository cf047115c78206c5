// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/options_io.h"

namespace mgsfm {

// Throws Error, naming the file and both options, if the outputs of a command
// would replace one of its inputs: a database, model, list, calibration or
// configuration file. An input_path that the command may adjust in place is
// none of them. Likewise if a file that is written would replace an image or a
// database, input or not. To be called before the command runs.
void CheckOutputsAreNoInputs(const std::string& command,
                             const OptionList& options,
                             const std::string& config_path);

}  // namespace mgsfm
