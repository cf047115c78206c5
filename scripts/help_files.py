#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes man pages and shell completions, from what the program says.

Below FOLDER, the files lie as in /usr/share.
  scripts/help_files.py PROGRAM FOLDER
"""

import pathlib
import re
import subprocess
import sys

EXIT_STATUS = """.SH EXIT STATUS
0: done. 1: bad usage or input. 2: nothing to reconstruct.
3: internal error. 128 plus a signal's number: stopped by it.
"""
BASH = r"""_mgsfm() {
  local word=${COMP_WORDS[COMP_CWORD]}
  local previous=${COMP_WORDS[COMP_CWORD - 1]} flags='' values=''
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W 'NAMES help --help --version' -- "$word"))
    return
  fi
  case ${COMP_WORDS[1]}:$previous in
    *:--*_path)
      compopt -o filenames 2>/dev/null
      mapfile -t COMPREPLY < <(compgen -f -- "$word")
      return ;;
CASES    help:*) flags='NAMES' ;;
  esac
  COMPREPLY=($(compgen -W "${values:-$flags}" -- "$word"))
}
complete -F _mgsfm mgsfm
"""
ZSH = r"""#compdef mgsfm
_mgsfm() {
  if (( CURRENT == 2 )); then
    local -a commands
    commands=(
COMMANDS    )
    _describe command commands
    return
  fi
  local command=$words[2]
  shift words
  (( CURRENT-- ))
  case $command in
CASES  esac
}
_mgsfm "$@"
"""


class Option:
    """A flag, its line of values, and the sentences about it."""

    def __init__(self, flag, argument, texts):
        self.flag = flag
        self.argument = argument
        self.values = texts[0] if texts and "default:" in texts[0] else ""
        self.text = " ".join(texts[1:] if self.values else texts)
        names = self.values.split(";")[0]
        self.choices = names.split("|") if "|" in names else []
        # A sentence that follows starts with a capital letter.
        self.summary = re.split(r"(?<=\.) (?=[A-Z])", self.text)[0]
        self.takes_path = flag.endswith("_path")
        self.takes_value = bool(self.values or argument)


class Command:
    def __init__(self, run, name, summary):
        self.name, self.summary = name, summary
        self.example, self.sections = "", []
        for block in re.split(r"\n(?=  --|\S)", run(name, "--help_all")):
            lines = [line.strip() for line in block.splitlines() if line.strip()]
            if not lines or lines[0].startswith(f"mgsfm {name}:"):
                continue
            if not lines[0].startswith("--"):
                if lines[0] == "Example":
                    self.example = lines[1]
                else:
                    self.sections.append((lines[0], []))
                continue
            if not self.sections:
                self.sections.append(("", []))
            for flag in lines[0].split(", "):
                words = flag.split()
                self.sections[-1][1].append(Option(words[0], " ".join(words[1:]), lines[1:]))

    def options(self):
        return [option for _, options in self.sections for option in options]


def read_commands(run):
    found = re.findall(r"^  ([a-z]\w*) +(.*)$", run("help"), re.MULTILINE)
    return [Command(run, name, summary) for name, summary in found]


def roff(text):
    """Text that troff prints as it is; lists of values may be broken."""
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("|", "|\\:")
    return ("\\&" if text[:1] in (".", "'") else "") + text


def page(name, version, summary, usage, body):
    return (f'.TH "{roff(name)}" 1 "" "{version}" "User Commands"\n.ad l\n.SH NAME\n'
            f"{roff(name)} \\- {roff(summary)}\n.SH SYNOPSIS\n{usage}\n"
            f"[\\fB\\-\\-option\\fR \\fIvalue\\fR ...]\n{body}")


def man_page(version, commands):
    body = ".SH COMMANDS\n"
    for command in commands:
        body += f".TP\n.B {roff(command.name)}\n{roff(command.summary)}\n"
    see_also = ",\n".join(f".BR mgsfm\\-{roff(c.name)} (1)" for c in commands)
    return page("mgsfm", version, "global structure from motion for multi-camera rigs",
                ".B mgsfm\n.I COMMAND", f"{body}{EXIT_STATUS}.SH SEE ALSO\n{see_also}\n")


def man_page_of(version, command):
    body = f".SH EXAMPLE\n.nf\n{roff(command.example)}\n.fi\n.SH OPTIONS\n"
    for title, options in command.sections:
        body += f".SS {roff(title)}\n" if title else ""
        for option in options:
            body += f".TP\n.B {roff(' '.join([option.flag, option.argument]).strip())}\n"
            body += f"{roff(option.values)}\n.br\n" if option.values else ""
            body += f"{roff(option.text)}\n"
    return page(f"mgsfm-{command.name}", version, command.summary,
                f".B mgsfm {roff(command.name)}", body + EXIT_STATUS)


def bash(commands):
    cases = ""
    for command in commands:
        for option in command.options():
            if option.choices:
                cases += (f"    {command.name}:{option.flag}) "
                          f"values='{' '.join(option.choices)}' ;;\n")
        flags = " ".join(option.flag for option in command.options())
        cases += f"    {command.name}:*) flags='{flags}' ;;\n"
    names = " ".join(command.name for command in commands)
    return BASH.replace("NAMES", names).replace("CASES", cases)


def quoted(text):
    """A word of zsh."""
    return "'" + text.replace("'", "'\\''") + "'"


def zsh(commands):
    names = cases = ""
    for command in commands:
        summary = re.sub(r"([\\:])", r"\\\1", command.summary)
        names += f"      {quoted(command.name + ':' + summary)}\n"
        cases += f"    {command.name})\n      _arguments"
        for option in command.options():
            spec = option.flag + "[" + re.sub(r"([\[\]\\])", r"\\\1", option.summary) + "]"
            if option.choices:
                spec += f":value:({' '.join(option.choices)})"
            elif option.takes_value:
                spec += ":path:_files" if option.takes_path else ":value:"
            cases += f" \\\n        {quoted(spec)}"
        cases += "\n      ;;\n"
    return ZSH.replace("COMMANDS", names).replace("CASES", cases)


def fish(commands):
    def described(text):
        return " -d '" + re.sub(r"([\\'])", r"\\\1", text) + "'\n"

    lines = "complete -c mgsfm -f\n"
    for command in commands:
        lines += f"complete -c mgsfm -n __fish_use_subcommand -a {command.name}"
        lines += described(command.summary)
        for option in command.options():
            lines += (f"complete -c mgsfm -n '__fish_seen_subcommand_from {command.name}' "
                      f"-l {option.flag[2:]}")
            if option.choices:
                lines += f" -x -a '{' '.join(option.choices)}'"
            elif option.takes_value:
                lines += " -r -F" if option.takes_path else " -x"
            lines += described(option.summary)
    return lines


def main():
    program, folder = sys.argv[1], pathlib.Path(sys.argv[2])

    def run(*arguments):
        return subprocess.run([program, *arguments], check=True, text=True,
                              stdout=subprocess.PIPE).stdout

    version = run("--version").split(",")[0]
    commands = read_commands(run)
    files = {
        "bash-completion/completions/mgsfm": bash(commands),
        "zsh/site-functions/_mgsfm": zsh(commands),
        "fish/vendor_completions.d/mgsfm.fish": fish(commands),
        "man/man1/mgsfm.1": man_page(version, commands),
    }
    for command in commands:
        files[f"man/man1/mgsfm-{command.name}.1"] = man_page_of(version, command)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


main()
