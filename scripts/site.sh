#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Builds the documentation site in build/site/html from docs/, without a network:
# pages with search and mathematics, the C++ interface by Doxygen, and notebooks
# of the tutorials. Fails on warnings and broken links.
#   scripts/site.sh
#   python3 -m http.server -d build/site/html   # the search needs a server
set -euo pipefail
cd "$(dirname "$0")/.."

docs=build/site/docs
rm -rf build/site
mkdir -p build/site
cp -r docs "$docs"

version=$(sed -n 's/^project(mgsfm VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
{
  cat site/Doxyfile
  echo "PROJECT_NUMBER = $version"
  echo "OUTPUT_DIRECTORY = $docs"
  echo "HTML_OUTPUT = api/cpp"
} | (mkdir -p "$docs/api" && doxygen -)

for page in docs/tutorials/*.md; do
  /usr/bin/python3 scripts/tutorial_pages.py notebook --if_python "$page" \
    "$docs/tutorials/notebooks/$(basename "$page" .md).ipynb"
done

cp -r site/assets "$docs/assets"
mkdir -p "$docs/assets/katex"
cp -rL /usr/share/javascript/katex/{katex.min.js,katex.min.css,fonts} \
  "$docs/assets/katex"
mkdocs build --quiet --strict --config-file site/mkdocs.yml
/usr/bin/python3 scripts/check_site.py build/site/html
if command -v chromium >/dev/null; then
  /usr/bin/python3 tests/docs/site_in_browser.py build/site/html
fi
