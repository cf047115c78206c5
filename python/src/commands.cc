// SPDX-License-Identifier: BSD-3-Clause
#include "commands.h"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <string>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "bindings.h"
#include "caller.h"
#include "mgsfm/base/error.h"

namespace mgsfm::python {
namespace {

namespace py = pybind11;

using NamedText = std::pair<std::string, std::string>;

Command FindCommand(const std::string& name) {
  std::vector<std::string> names;
  for (Command& command : AllCommands()) {
    if (command.name == name) return std::move(command);
    names.push_back(command.name);
  }
  throw Error("unknown command '" + name + "'" + SuggestName(name, names));
}

// Returns (exit code, JSON or "", text or "", last error message or "").
py::tuple RunCommand(const std::string& name,
                     const std::vector<NamedText>& values,
                     const py::object& log, const py::object& progress) {
  const Command command = FindCommand(name);
  Caller caller(log, progress);
  const CommandResult result = caller.Run([&](const Context& context) {
    return command.call(
        [&](const OptionList& options) { SetNamedOptions(options, values); },
        context);
  });
  return py::make_tuple(result.exit_code, result.json, result.text,
                        caller.last_error());
}

py::object ToPython(const OptionValue& value) {
  return std::visit([](const auto& v) { return py::object(py::cast(v)); },
                    value);
}

py::dict ToPython(const OptionEntry& entry) {
  py::dict dict;
  dict["name"] = entry.name;
  dict["default"] = ToPython(entry.default_value);
  dict["unit"] = entry.unit;
  dict["range"] = entry.range.ToString();
  dict["choices"] = entry.choices;
  dict["help"] = entry.help;
  return dict;
}

void ForOptions(const std::string& command,
                const std::function<void(const OptionList&)>& use) {
  FindCommand(command).list(use);
  CommonOptions common;
  use(ListOptions(&common));
}

py::list ListCommandOptions(const std::string& command) {
  py::list entries;
  ForOptions(command, [&](const OptionList& options) {
    for (const OptionEntry& entry : options) entries.append(ToPython(entry));
  });
  return entries;
}

// The value that an option of a command would get from a text.
py::object ParseCommandOption(const std::string& command,
                              const std::string& name,
                              const std::string& text) {
  std::vector<std::string> names;
  py::object value;
  ForOptions(command, [&](const OptionList& options) {
    for (const OptionEntry& entry : options) {
      names.push_back(entry.name);
      if (entry.name == name) value = ToPython(ParseOptionValue(entry, text));
    }
  });
  if (!value) {
    throw Error("unknown option '" + name + "'" + SuggestName(name, names));
  }
  return value;
}

std::vector<std::string> CommandNames() {
  return Transformed(AllCommands(), &Command::name);
}

}  // namespace

void BindCommands(py::module_* module) {
  module->def("run_command", &RunCommand, py::arg("name"), py::arg("values"),
              py::arg("log"), py::arg("progress"));
  module->def("list_options", &ListCommandOptions, py::arg("command"));
  module->def("parse_option", &ParseCommandOption, py::arg("command"),
              py::arg("name"), py::arg("text"));
  module->def("command_names", &CommandNames);
}

}  // namespace mgsfm::python
