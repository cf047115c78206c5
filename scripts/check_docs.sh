#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Fails if docs/reference/options.md is stale, if a document names a command,
# option or value that the program lacks, if a relative link in a Markdown file
# leads nowhere, if code and documents name what does not exist, or if the results
# or the architecture have grown beyond a short read. Needs the program in
# build/release. The test docs runs the commands and checks of the pages.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/gen_docs.sh --check
python3 scripts/check_options.py

git ls-files --cached --others --exclude-standard '*.md' |
  xargs grep -oHE '\]\([^)# ]+' | sed 's/\](/ /' | {
  num_broken=0
  while read -r file target; do
    file=${file%:}
    case $target in *://* | mailto:*) continue ;; esac
    if [ ! -e "$(dirname "$file")/$target" ]; then
      echo "$file: no such file: $target" >&2
      num_broken=$((num_broken + 1))
    fi
  done
  [ "$num_broken" = 0 ]
}

# Pages that comments name, and constants that the table of constants names.
grep -rhoE 'docs/[a-z_/]+\.md' src include apps tests bench cmake scripts experiments |
  sort -u | while read -r page; do
  [ -e "$page" ] || { echo "comments name $page, which does not exist" >&2; exit 1; }
done
grep -oE '`k[A-Z][A-Za-z_]+`' docs/results/constants.md | tr -d '`' | sort -u |
  while read -r name; do
    grep -rqwE "(constexpr|const) .*$name" src apps include || {
      echo "docs/results/constants.md names $name, which does not exist" >&2
      exit 1
    }
  done
if [ "$(cat docs/results/*.md | wc -l)" -gt 800 ]; then
  echo 'docs/results has more than 800 lines' >&2
  exit 1
fi

# The table of modules: the same modules as check_layers.sh has, each with a
# folder, and entries that their headers declare.
page=docs/development/architecture.md
modules() { sort -u | tr '\n' ' '; }
in_page=$(sed -nE 's/^\| ([a-z]+) \| `([a-z_]+)`.*/\1\/\2/p' "$page" | modules)
in_layers=$(sed -n "/^table='/,/^'/p" scripts/check_layers.sh |
  grep -oE '^[a-z]+/[a-z_]+:' | tr -d : | modules)
in_code=$(find src -name CMakeLists.txt | sed 's|^src/||; s|/CMakeLists.txt||' | modules)
if [ "$in_page" != "$in_layers" ] || [ "$in_page" != "$in_code" ]; then
  printf '%s\n' "modules of $page: $in_page" "of check_layers.sh: $in_layers" \
    "of src: $in_code" >&2
  exit 1
fi
grep -E '^\| [a-z]+ \| `[a-z_]+`' "$page" | while IFS='|' read -r _ _ module _ entry _; do
  module=$(echo "$module" | tr -d ' \`')
  entry=$(echo "$entry" | tr -d ' \`')
  find src include -path "*/$module/*.h" -print0 |
    xargs -0 grep -qE "(struct|class|enum class|using) $entry\b|\b$entry\(" || {
    echo "$page: no header of $module declares $entry" >&2
    exit 1
  }
done
if [ "$(wc -l <"$page")" -gt 120 ]; then
  echo "$page has more than 120 lines, two screens" >&2
  exit 1
fi

# Every file that names the version, and every folder of the repository.
version=$(sed -nE 's/^project\(mgsfm VERSION ([0-9.]+).*/\1/p' CMakeLists.txt)
for file in CITATION.cff vcpkg.json packaging/conda/meta.yaml CHANGELOG.md; do
  grep -qE "(version|^##).* \"?${version//./\\.}\"?" "$file" || {
    echo "$file does not name the version of CMakeLists.txt, $version" >&2
    exit 1
  }
done
git ls-files | grep -oE '^[^/]+/' | sort -u | while read -r folder; do
  grep -q "\`$folder" CONTRIBUTING.md || {
    echo "the map in CONTRIBUTING.md lacks $folder" >&2
    exit 1
  }
done

echo "options, links and names are up to date"
