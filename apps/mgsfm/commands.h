// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "command.h"

namespace mgsfm {

// All commands below, in the order of --help.
std::vector<Command> AllCommands();

// Defined in cmd_*.cc.
Command AutomaticReconstructorCommand();
Command BundleAdjusterCommand();
std::vector<Command> DatabaseCommands();
std::vector<Command> ImageCommands();
Command ImageUndistorterCommand();
Command MapperCommand();
std::vector<Command> MatchingCommands();
Command ModelAlignerCommand();
Command ModelAnalyzerCommand();
Command ModelConverterCommand();
std::vector<Command> ModelEditCommands();
Command ModelEvaluatorCommand();
Command ModelMergerCommand();
Command PointTriangulatorCommand();
Command ReportCommand();
Command SimulateCommand();

}  // namespace mgsfm
