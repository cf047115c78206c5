// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "command.h"

namespace mgsfm {

// One per file cmd_*.cc.
Command AutomaticReconstructorCommand();
Command BundleAdjusterCommand();
Command ExhaustiveMatcherCommand();
Command FeatureExtractorCommand();
Command ImageSplitterCommand();
Command ImageUndistorterCommand();
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
