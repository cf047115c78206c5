// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "command.h"

namespace mgsfm {

// All of the below, in the order of --help.
std::vector<Command> AllCommands();

// One per file cmd_*.cc.
Command AutomaticReconstructorCommand();
Command BundleAdjusterCommand();
Command ExhaustiveMatcherCommand();
Command FeatureExtractorCommand();
Command FeatureImporterCommand();
Command GeometricVerifierCommand();
Command MapperCommand();
Command MatchesImporterCommand();
Command ModelEvaluatorCommand();
Command PointTriangulatorCommand();
Command ReportCommand();
Command RigConfiguratorCommand();
Command SequentialMatcherCommand();
Command SimulateCommand();
Command SpatialMatcherCommand();
Command VocabTreeMatcherCommand();

}  // namespace mgsfm
