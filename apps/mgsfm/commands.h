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
Command DatabaseCleanerCommand();
Command DatabaseMergerCommand();
Command ExhaustiveMatcherCommand();
Command FeatureExtractorCommand();
Command FeatureImporterCommand();
Command GeometricVerifierCommand();
Command ImageDeleterCommand();
Command ImageSplitterCommand();
Command ImageUndistorterCommand();
Command MapperCommand();
Command MatchesImporterCommand();
Command ModelAlignerCommand();
Command ModelAnalyzerCommand();
Command ModelConverterCommand();
Command ModelCropperCommand();
Command ModelEvaluatorCommand();
Command ModelMergerCommand();
Command ModelSplitterCommand();
Command PointTriangulatorCommand();
Command RecordingImporterCommand();
Command ReportCommand();
Command RigConfiguratorCommand();
Command SequentialMatcherCommand();
Command SimulateCommand();
Command SpatialMatcherCommand();
Command VideoSamplerCommand();
Command VocabTreeBuilderCommand();
Command VocabTreeMatcherCommand();

}  // namespace mgsfm
