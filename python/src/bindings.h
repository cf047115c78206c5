// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

// The parts of the module pymgsfm._core. Functions take and return tuples,
// dicts and numpy arrays, from which the Python package makes its objects. The
// only class is that of an open database.
namespace mgsfm::python {

void BindCameras(pybind11::module_* module);
void BindCommands(pybind11::module_* module);
void BindDatabase(pybind11::module_* module);
void BindEstimators(pybind11::module_* module);
void BindModels(pybind11::module_* module);
void BindStages(pybind11::module_* module);

}  // namespace mgsfm::python
