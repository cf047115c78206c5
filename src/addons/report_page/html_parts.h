// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// Parts of the page as HTML. Texts are escaped and not too long.

std::string Text(const std::string& text);

// "two words" of "two_words".
std::string WithBlanks(std::string name);

// A dash for no value; an exponent for tiny and huge ones.
std::string Number(std::optional<double> value, int digits,
                   const std::string& unit = "");

// "12,345".
std::string Count(size_t count);

// "3 of 4 (75 %)".
std::string Share(size_t part, size_t all);

using Row = std::vector<std::string>;  // HTML of the cells

// "" without rows. Rows beyond a limit are counted only.
std::string Table(const Row& head, const std::vector<Row>& rows);

// "" without content. `intro` tells how to read it.
std::string Section(const std::string& id, const std::string& title,
                    const std::string& intro, const std::string& content);

// Shows a frame in the 3D view.
std::string FrameLink(const std::string& frame_name);

// A drawing in the colors of the theme.
std::string ThemedChart(const std::string& svg, const std::string& label);

// Panels of a drawing, row by row and of equal size in its px, below a head of
// `top` px. A page sets them one below the other where it is narrow.
struct Columns {
  double first_x, width;
  int max_num;
  double top;
};

// The first word of the label is the id of the drawing.
std::string ThemedColumns(const std::string& svg, const std::string& label,
                          const Columns& columns, size_t num_panels);

}  // namespace mgsfm
