// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/pybind11.h>

#include <exception>
#include <filesystem>
#include <system_error>

#include "bindings.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/version.h"
#include "mgsfm_commit.h"

namespace py = pybind11;

namespace {

void SetOSError(const std::filesystem::filesystem_error& error) {
  const py::tuple arguments = py::make_tuple(
      error.code().value(), error.code().message(), error.path1().string());
  PyErr_SetObject(PyExc_OSError, arguments.ptr());
}

// The library's own errors are registered below.
void TranslateSystemErrors(std::exception_ptr exception) {
  try {
    if (exception) std::rethrow_exception(exception);
  } catch (const std::filesystem::filesystem_error& error) {
    SetOSError(error);
  } catch (const std::system_error& error) {
    PyErr_SetString(PyExc_OSError, error.what());
  }
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  module.doc() = "The compiled part of pymgsfm.";
  module.attr("version") = mgsfm::Version();
  module.attr("commit") = MGSFM_COMMIT;
  py::register_exception<mgsfm::Error>(module, "InputError", PyExc_ValueError)
      .doc() =
      "Bad input: an unusable file, image or option. The message names it and "
      "the remedy. Nothing was written.";
  py::register_exception<mgsfm::ContractError>(module, "InternalError",
                                               PyExc_RuntimeError)
      .doc() = "A defect of mgsfm.";
  py::register_exception_translator(TranslateSystemErrors);
  mgsfm::python::BindCameras(&module);
  mgsfm::python::BindCommands(&module);
  mgsfm::python::BindDatabase(&module);
  mgsfm::python::BindEstimators(&module);
  mgsfm::python::BindModels(&module);
  mgsfm::python::BindStages(&module);
}
