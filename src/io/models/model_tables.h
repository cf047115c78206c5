// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/io/database/database.h"
#include "mgsfm/io/models/model_io.h"

namespace mgsfm {

// The tables of rigs and frames of a model. Frames lose images that the model
// lacks.
void AddModelTables(const PoseModel& poses, DatabaseContents* contents);

}  // namespace mgsfm
