# Turns comments into those that Doxygen reads: before a declaration ("/// ..."),
# or after it in the same line ("///< ..."). Indented formulas become code.
s|^( *)// SPDX-.*$||
/^ *\/\//{
  s|<|\&lt;|g
  s|^( *)//|\1///|
  s|^( *///)   |\1       |
}
s|^(.*[;,{}]) +// (.*)$|\1  ///< \2|
