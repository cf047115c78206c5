// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

// The parts of the module pymgsfm._core. It has no classes: functions take and
// return tuples, dicts and numpy arrays, from which the Python package makes
// its objects.
namespace mgsfm::python {

void BindCommands(pybind11::module_* module);
void BindModels(pybind11::module_* module);
void BindStages(pybind11::module_* module);

}  // namespace mgsfm::python
