// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/html_parts.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "base/text.h"
#include "base/text_streams.h"
#include "evaluation/svg.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

// Bounds the size of the page; the report and the model have all rows.
constexpr size_t kMaxRows = 60;

// SVG files use fixed colors; in the page they follow its theme. Their clip
// paths get ids that the charts of a page do not share.
std::string Themed(std::string svg, std::string label) {
  std::replace(label.begin(), label.end(), ' ', '_');
  const std::pair<std::string, std::string> replacements[] = {
      {"id='clip", "id='" + label + "_clip"},
      {"url(#clip", "url(#" + label + "_clip"},
      {"fill='white'", "fill='none'"},
      {"fill='#222'", "fill='currentColor'"},
      {"'#e6e6e6'", "'var(--grid)'"},
      {"'#888'", "'var(--axis)'"},
      {"'#0b62b0'", "'var(--accent)'"}};
  for (const auto& [from, to] : replacements) {
    for (size_t at = svg.find(from); at != std::string::npos;
         at = svg.find(from, at + to.size())) {
      svg.replace(at, from.size(), to);
    }
  }
  return svg;
}

// The documentation has no address that a page without a network could link to.
std::string GuideOf(const std::string& section_id) {
  static const std::map<std::string, std::string> kGuides = {
      {"registration", "few_images_registered"},
      {"missing", "few_images_registered"},
      {"seams", "weak_seams"},
      {"truth", "accuracy_of_a_result"},
      {"comparison", "compare_methods"},
      {"error_maps", "intrinsics"},
      {"rigs", "rigs_and_frames"},
      {"view_graph", "duplicate_structures"},
      {"run", "time_and_memory"}};
  const auto found = kGuides.find(section_id);
  return found == kGuides.end() ? "inspect_a_result" : found->second;
}

}  // namespace

std::string Text(const std::string& text) {
  constexpr size_t kMaxBytes = 600;  // a cell of some lines
  return "<bdi>" + EscapeHtml(Shorten(text, kMaxBytes)) + "</bdi>";
}

std::string WithBlanks(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string Number(std::optional<double> value, int digits,
                   const std::string& unit) {
  if (!value || !std::isfinite(*value)) return "&ndash;";
  // Tiny and huge values need an exponent.
  const double size = std::abs(*value);
  std::string text = FormatNumber(*value, digits);
  if (size > 0.0 && (size < 0.5 * std::pow(10.0, -digits) || size > 1e9)) {
    TextOutput stream;
    stream.precision(3);
    stream << *value;
    text = stream.str();
  }
  return unit.empty() ? text : text + "&nbsp;" + unit;
}

std::string Count(size_t count) {
  std::string digits = std::to_string(count);
  for (auto i = static_cast<int>(digits.size()) - 3; i > 0; i -= 3) {
    digits.insert(static_cast<size_t>(i), ",");
  }
  return digits;
}

std::string Share(size_t part, size_t all) {
  if (all == 0) return "0 of 0";
  return Count(part) + " of " + Count(all) + " (" +
         FormatNumber(
             100.0 * static_cast<double>(part) / static_cast<double>(all), 1) +
         "&nbsp;%)";
}

std::string Table(const Row& head, const std::vector<Row>& rows) {
  if (rows.empty()) return "";
  std::string html = "<div class=\"scroll\"><table><thead><tr>";
  for (const std::string& cell : head) {
    html += "<th scope=\"col\">" + cell + "</th>";
  }
  html += "</tr></thead><tbody>\n";
  for (size_t i = 0; i < std::min(rows.size(), kMaxRows); ++i) {
    html += "<tr>";
    for (const std::string& cell : rows[i]) html += "<td>" + cell + "</td>";
    html += "</tr>\n";
  }
  html += "</tbody></table></div>\n";
  if (rows.size() > kMaxRows) {
    html += "<p class=\"muted\">and " + Count(rows.size() - kMaxRows) +
            " more</p>\n";
  }
  return html;
}

std::string Section(const std::string& id, const std::string& title,
                    const std::string& intro, const std::string& content) {
  if (content.empty()) return "";
  return "<section id=\"" + id + "\"><h2>" + title +
         "</h2>\n<p class=\"muted\">" + intro + " Guide: <code>docs/guides/" +
         GuideOf(id) + ".md</code></p>\n" + content + "</section>\n";
}

std::string FrameLink(const std::string& frame_name) {
  return "<a href=\"#view\" data-frame=\"" + EscapeHtml(frame_name) +
         "\">show</a>";
}

std::string ThemedChart(const std::string& svg, const std::string& label) {
  if (svg.empty()) return "";
  return "<figure class=\"chart\">" +
         Themed(svg, label)
             .replace(0, 4, "<svg role='img' aria-label='" + label + "'") +
         "</figure>\n";
}

std::string ThemedColumns(const std::string& svg, const std::string& label,
                          const Columns& columns, size_t num_panels) {
  if (svg.empty()) return "";
  const std::string whole = Themed(svg, label);
  const size_t begin = whole.find(">\n") + 2;
  const std::string body = whole.substr(begin, whole.rfind("</svg>") - begin);
  const size_t height_at = whole.find("height='") + 8;
  const std::string height =
      whole.substr(height_at, whole.find('\'', height_at) - height_at);
  const std::string id = "chart_" + label.substr(0, label.find(' '));
  const std::string width = FormatNumber(columns.width, 2);
  const size_t num_columns = static_cast<size_t>(columns.max_num);
  const size_t num_rows = (num_panels + num_columns - 1) / num_columns;
  const double panel_height =
      (ParseDouble(height).value_or(0.0) - columns.top) /
      static_cast<double>(num_rows);
  const auto panel = [&](size_t i) {
    const double x =
        columns.first_x + columns.width * static_cast<double>(i % num_columns);
    const size_t row = i / num_columns;
    const double y = columns.top + panel_height * static_cast<double>(row);
    const double head = i == 0 ? columns.top : 0.0;
    return "<svg role='img' aria-label='" + label + "' width='" + width +
           "' viewBox='" + FormatNumber(x, 2) + " " +
           FormatNumber(y - head, 2) + " " + width + " " +
           FormatNumber(panel_height + head, 2) +
           "' font-family='sans-serif' font-size='13' fill='currentColor'>" +
           (i == 0 ? "<g id='" + id + "'>" + body + "</g>"
                   : "<use href='#" + id + "'/>") +
           "</svg>\n";
  };
  std::string html = "<figure class=\"chart columns\">";
  for (size_t i = 0; i < num_panels; ++i) html += panel(i);
  return html + "</figure>\n";
}

}  // namespace mgsfm
