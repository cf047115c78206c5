// SPDX-License-Identifier: BSD-3-Clause
#include <cctype>
#include <string>
#include <string_view>
#include <vector>

#include "help_formats.h"

namespace mgsfm {
namespace {

// A flag as a shell completes it.
struct Flag {
  std::string name;
  std::string help;  // one sentence
  std::vector<std::string> values;
  bool takes_path = false;
  bool takes_value = true;
};

bool EndsWith(std::string_view text, std::string_view end) {
  return text.size() >= end.size() &&
         text.substr(text.size() - end.size()) == end;
}

bool IsUpper(char c) {
  return std::isupper(static_cast<unsigned char>(c)) != 0;
}

std::string FirstSentence(const std::string& text) {
  for (size_t i = 0; i + 2 < text.size(); ++i) {
    // A sentence that follows starts with a capital letter; the dots of
    // "0, 1, ... and so on" do not end one.
    if (text.compare(i, 2, ". ") == 0 && IsUpper(text[i + 2])) {
      return text.substr(0, i + 1);
    }
  }
  return text;
}

std::vector<Flag> FlagsOf(const CommandHelp& command) {
  std::vector<Flag> flags;
  for (const OptionEntry& option : command.options) {
    Flag flag{option.name, FirstSentence(option.help), option.choices,
              EndsWith(option.name, "_path")};
    if (std::holds_alternative<bool>(option.default_value)) {
      flag.values = {"true", "false"};
    }
    flags.push_back(flag);
  }
  flags.push_back({"config_path", "Read options from a file.", {}, true});
  flags.push_back({"dump_config", "Print all options.", {}, false, false});
  flags.push_back({"help", "Print the basic options.", {}, false, false});
  flags.push_back({"help_all", "Print all options.", {}, false, false});
  return flags;
}

std::string Join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : " ") + word;
  }
  return text;
}

std::string NamesOf(const std::vector<CommandHelp>& commands) {
  std::vector<std::string> names;
  for (const CommandHelp& command : commands) names.push_back(command.name);
  return Join(names);
}

// Puts a backslash before each of the characters.
std::string Escape(const std::string& text, std::string_view characters) {
  std::string escaped;
  for (const char c : text) {
    if (characters.find(c) != std::string_view::npos) escaped += '\\';
    escaped += c;
  }
  return escaped;
}

// Escapes a word in '...', in which zsh and bash know no escape sequences.
std::string EscapeQuotes(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\'') {
      escaped += "'\\''";
    } else {
      escaped += c;
    }
  }
  return escaped;
}

std::string BashCase(const CommandHelp& command) {
  std::string names;
  std::string values;
  for (const Flag& flag : FlagsOf(command)) {
    names += " --" + flag.name;
    if (!flag.values.empty()) {
      values += "    " + command.name + ":--" + flag.name + ") values='" +
                Join(flag.values) + "' ;;\n";
    }
  }
  return values + "    " + command.name + ":*) flags='" + names.substr(1) +
         "' ;;\n";
}

std::string ZshCase(const CommandHelp& command) {
  std::string text = "    " + command.name + ")\n      _arguments";
  for (const Flag& flag : FlagsOf(command)) {
    // The text ends at ']', and "'" ends the word.
    std::string spec = "--" + flag.name + "[" + Escape(flag.help, "[]\\") + "]";
    if (!flag.values.empty()) {
      spec += ":value:(" + Join(flag.values) + ")";
    } else if (flag.takes_path) {
      spec += ":path:_files";
    } else if (flag.takes_value) {
      spec += ":value:";
    }
    text += " \\\n        '" + EscapeQuotes(spec) + "'";
  }
  return text + "\n      ;;\n";
}

}  // namespace

std::string BashCompletion(const std::vector<CommandHelp>& commands) {
  std::string text =
      "# Made by `mgsfm help --format bash`.\n"
      "_mgsfm() {\n"
      "  local word=${COMP_WORDS[COMP_CWORD]}\n"
      "  local previous=${COMP_WORDS[COMP_CWORD - 1]} flags='' values=''\n"
      "  COMPREPLY=()\n"
      "  if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
      "    COMPREPLY=($(compgen -W '" +
      NamesOf(commands) +
      " help --help --version' -- \"$word\"))\n"
      "    return\n"
      "  fi\n"
      "  case ${COMP_WORDS[1]}:$previous in\n"
      "    *:--*_path)\n"
      "      compopt -o filenames 2>/dev/null\n"
      "      mapfile -t COMPREPLY < <(compgen -f -- \"$word\")\n"
      "      return ;;\n";
  for (const CommandHelp& command : commands) text += BashCase(command);
  return text + "    help:*) flags='" + NamesOf(commands) +
         "' ;;\n"
         "  esac\n"
         "  COMPREPLY=($(compgen -W \"${values:-$flags}\" -- \"$word\"))\n"
         "}\n"
         "complete -F _mgsfm mgsfm\n";
}

std::string ZshCompletion(const std::vector<CommandHelp>& commands) {
  std::string text =
      "#compdef mgsfm\n"
      "# Made by `mgsfm help --format zsh`.\n"
      "_mgsfm() {\n"
      "  if (( CURRENT == 2 )); then\n"
      "    local -a commands\n"
      "    commands=(\n";
  for (const CommandHelp& command : commands) {
    text += "      '" +
            EscapeQuotes(command.name + ":" + Escape(command.summary, "\\:")) +
            "'\n";
  }
  text +=
      "    )\n"
      "    _describe command commands\n"
      "    return\n"
      "  fi\n"
      "  local command=$words[2]\n"
      "  shift words\n"
      "  (( CURRENT-- ))\n"
      "  case $command in\n";
  for (const CommandHelp& command : commands) text += ZshCase(command);
  return text + "  esac\n}\n_mgsfm \"$@\"\n";
}

std::string FishCompletion(const std::vector<CommandHelp>& commands) {
  std::string text =
      "# Made by `mgsfm help --format fish`.\n"
      "complete -c mgsfm -f\n";
  for (const CommandHelp& command : commands) {
    text += "complete -c mgsfm -n __fish_use_subcommand -a " + command.name +
            " -d '" + Escape(command.summary, "\\'") + "'\n";
    for (const Flag& flag : FlagsOf(command)) {
      text += "complete -c mgsfm -n '__fish_seen_subcommand_from " +
              command.name + "' -l " + flag.name;
      if (!flag.values.empty()) {
        text += " -x -a '" + Join(flag.values) + "'";
      } else if (flag.takes_path) {
        text += " -r -F";
      } else if (flag.takes_value) {
        text += " -x";
      }
      text += " -d '" + Escape(flag.help, "\\'") + "'\n";
    }
  }
  return text;
}

}  // namespace mgsfm
