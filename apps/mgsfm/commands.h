// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "command.h"

namespace mgsfm {

// One per file cmd_*.cc.
Command MapperCommand();
Command ModelEvaluatorCommand();
Command ModelEvaluatorCommand();
Command SimulateCommand();

}  // namespace mgsfm
