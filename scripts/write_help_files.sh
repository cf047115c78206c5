#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Writes man pages and shell completions below FOLDER, as /usr/share has them.
#   scripts/write_help_files.sh PROGRAM FOLDER
set -euo pipefail

mgsfm=$1
folder=$2
mkdir -p "$folder"/{man/man1,bash-completion/completions} \
  "$folder"/{zsh/site-functions,fish/vendor_completions.d}
"$mgsfm" help --format bash >"$folder/bash-completion/completions/mgsfm"
"$mgsfm" help --format zsh >"$folder/zsh/site-functions/_mgsfm"
"$mgsfm" help --format fish >"$folder/fish/vendor_completions.d/mgsfm.fish"
"$mgsfm" help --format man >"$folder/man/man1/mgsfm.1"
"$mgsfm" help | awk '/^  [a-z]/ {print $1}' | while read -r command; do
  "$mgsfm" help --format man "$command" >"$folder/man/man1/mgsfm-$command.1"
done
