// SPDX-License-Identifier: BSD-3-Clause
#include <string>
#include <string_view>
#include <vector>

#include "base/text_streams.h"
#include "help.h"
#include "help_formats.h"

namespace mgsfm {
namespace {

// Text that troff prints as it is.
std::string Roff(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\') {
      escaped += "\\e";
    } else if (c == '-') {
      escaped += "\\-";
    } else if (c == '|') {
      escaped += "|\\:";  // lists of values may be broken there
    } else {
      escaped += c;
    }
  }
  // roff takes a line that begins with . or ' for a request; \& prevents that.
  if (!escaped.empty() && (escaped[0] == '.' || escaped[0] == '\'')) {
    escaped.insert(0, "\\&");
  }
  return escaped;
}

std::string Title(const std::string& name, const std::string& version) {
  return ".TH \"" + Roff(name) + "\" 1 \"\" \"mgsfm " + version +
         "\" \"User Commands\"\n.ad l\n";  // lists of values cannot be
                                           // justified
}

// Turns the help text, whose indentation is 0 for a section, 2 for a flag or an
// example and 6 for what is said about a flag, into a man page.
std::string RoffOfHelp(const std::string& help) {
  std::string text;
  TextInput lines(help);
  bool follows_flag = false;
  bool is_in_options = false;
  for (std::string line; std::getline(lines, line);) {
    const size_t indent = line.find_first_not_of(' ');
    if (indent == std::string::npos) continue;
    const std::string content = Roff(std::string_view(line).substr(indent));
    const bool is_flag = indent == 2 && line.compare(2, 2, "--") == 0;
    if (is_flag && !is_in_options) {
      text += ".SH OPTIONS\n";
      is_in_options = true;
    }
    if (content == "Example") {
      text += ".SH EXAMPLE\n";
    } else if (indent == 0) {
      text += ".SS " + content + "\n";
    } else if (is_flag) {
      text += ".TP\n.B " + content + "\n";
    } else if (indent == 2) {
      text += ".nf\n" + content + "\n.fi\n";
    } else {
      text += content + "\n";
      if (follows_flag && content.find("default:") != std::string::npos) {
        text += ".br\n";
      }
    }
    follows_flag = indent == 2;
  }
  return text;
}

constexpr char kExitStatus[] =
    ".SH EXIT STATUS\n"
    "0: done. 1: bad usage or input. 2: nothing to reconstruct.\n"
    "3: internal error. 128 plus a signal's number: stopped by it.\n";

}  // namespace

std::string ManPage(const std::string& version,
                    const std::vector<CommandHelp>& commands) {
  std::string text =
      Title("mgsfm", version) +
      ".SH NAME\n"
      "mgsfm \\- global structure from motion for multi\\-camera "
      "rigs\n"
      ".SH SYNOPSIS\n"
      ".B mgsfm\n"
      ".I COMMAND\n"
      "[\\fB\\-\\-option\\fR \\fIvalue\\fR ...]\n"
      ".SH COMMANDS\n";
  std::string see_also;
  for (const CommandHelp& command : commands) {
    text +=
        ".TP\n.B " + Roff(command.name) + "\n" + Roff(command.summary) + "\n";
    see_also += (see_also.empty() ? "" : ",\n") +
                (".BR mgsfm\\-" + Roff(command.name)) + " (1)";
  }
  return text + kExitStatus + ".SH SEE ALSO\n" + see_also + "\n";
}

std::string ManPageOf(const std::string& version, const CommandHelp& command) {
  const std::string help =
      MakeHelp(command.name, command.summary, command.options, HelpLevel::kAll);
  const size_t end_of_title = help.find('\n');
  return Title("mgsfm-" + command.name, version) + ".SH NAME\nmgsfm\\-" +
         Roff(command.name) + " \\- " + Roff(command.summary) +
         "\n.SH SYNOPSIS\n.B mgsfm " + Roff(command.name) +
         "\n[\\fB\\-\\-option\\fR \\fIvalue\\fR ...]\n" +
         RoffOfHelp(help.substr(end_of_title)) + kExitStatus +
         ".SH SEE ALSO\n.BR mgsfm (1)\n";
}

}  // namespace mgsfm
