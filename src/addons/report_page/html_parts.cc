// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/html_parts.h"

#include <algorithm>
#include <cmath>

#include "base/text_streams.h"
#include "evaluation/svg.h"
#include "report_page/chart_parts.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

// Bounds the size of the page; the report and the model have all rows.
constexpr size_t kMaxRows = 60;

// SVG files use fixed colors; in the page they follow its theme.
std::string Themed(std::string svg) {
  const std::pair<const char*, const char*> colors[] = {
      {"fill='white'", "fill='none'"},
      {"fill='#222'", "fill='currentColor'"},
      {"'#e6e6e6'", "'var(--grid)'"},
      {"'#888'", "'var(--axis)'"},
      {"'#0b62b0'", "'var(--accent)'"}};
  for (const auto& [color, themed] : colors) {
    const std::string from = color, to = themed;
    for (size_t at = svg.find(from); at != std::string::npos;
         at = svg.find(from, at + to.size())) {
      svg.replace(at, from.size(), to);
    }
  }
  return svg;
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

std::string Count(size_t count) { return FormatCount(count); }

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
         "</h2>\n<p class=\"muted\">" + intro + "</p>\n" + content +
         "</section>\n";
}

std::string FrameLink(const std::string& frame_name) {
  return "<a href=\"#view\" data-frame=\"" + EscapeHtml(frame_name) +
         "\">show</a>";
}

std::string ThemedChart(const std::string& svg, const std::string& label) {
  if (svg.empty()) return "";
  // Clip paths of several charts must not share their ids.
  return "<figure class=\"chart\">" +
         Themed(svg).replace(0, 4,
                             "<svg role='img' aria-label='" + label + "'") +
         "</figure>\n";
}

std::string ThemedColumns(const std::string& svg, const std::string& label,
                          const Columns& columns, size_t num_panels) {
  if (svg.empty()) return "";
  const std::string whole = Themed(svg);
  const size_t begin = whole.find(">\n") + 2;
  const std::string body = whole.substr(begin, whole.rfind("</svg>") - begin);
  const size_t height_at = whole.find("height='") + 8;
  const std::string height =
      whole.substr(height_at, whole.find('\'', height_at) - height_at);
  const std::string id = "chart_" + label.substr(0, label.find(' '));
  const std::string width = FormatNumber(columns.width, 2);
  std::string html = "<figure class=\"chart columns\">";
  const size_t num_columns =
      std::min(num_panels, static_cast<size_t>(columns.max_num));
  for (size_t i = 0; i < num_columns; ++i) {
    const double x = columns.first_x + columns.width * static_cast<double>(i);
    html += "<svg role='img' aria-label='" + label + "' width='" + width +
            "' viewBox='" + FormatNumber(x, 2) + " 0 " + width + " " + height +
            "' font-family='sans-serif' font-size='13' fill='currentColor'>" +
            (i == 0 ? "<g id='" + id + "'>" + body + "</g>"
                    : "<use href='#" + id + "'/>") +
            "</svg>\n";
  }
  return html + "</figure>\n";
}

}  // namespace mgsfm
