// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/svg_raster.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "base/text.h"
#include "base/text_streams.h"
#include "io/files/image_encoding.h"
#include "io/files/image_reading.h"
#include "report_page/encoding.h"

namespace mgsfm {
namespace {

using Attributes = std::map<std::string, std::string>;

// The drawing is made at twice the size and halved, for smooth edges.
constexpr int kSupersampling = 2;
// The number of fractional bits of integer coordinates in OpenCV.
constexpr int kShift = 4;

struct Element {
  std::string name;  // with '/' in front if it ends one
  Attributes attributes;
  std::string text;
};

std::string Unescape(std::string text) {
  const std::pair<const char*, const char*> entities[] = {
      {"&lt;", "<"}, {"&gt;", ">"}, {"&amp;", "&"}};
  for (const auto& [entity, character] : entities) {
    const std::string name = entity;
    for (size_t at = text.find(name); at != std::string::npos;
         at = text.find(name, at + 1)) {
      text.replace(at, name.size(), character);
    }
  }
  return text;
}

// The attributes of SvgDrawing are quoted by ' and contain none.
Attributes ParseAttributes(const std::string& tag) {
  Attributes attributes;
  size_t at = 0;
  while (true) {
    const size_t equals = tag.find("='", at);
    if (equals == std::string::npos) return attributes;
    const size_t name = tag.find_last_of(" \n", equals) + 1;
    const size_t end = std::min(tag.find('\'', equals + 2), tag.size());
    attributes[tag.substr(name, equals - name)] =
        tag.substr(equals + 2, end - equals - 2);
    at = end + 1;
  }
}

std::vector<Element> ParseSvg(const std::string& svg) {
  std::vector<Element> elements;
  for (size_t at = svg.find('<'); at != std::string::npos;
       at = svg.find('<', at + 1)) {
    const size_t end = std::min(svg.find('>', at), svg.size());
    const std::string tag = svg.substr(at + 1, end - at - 1);
    Element element;
    element.name = tag.substr(0, tag.find_first_of(" \n/", 1));
    element.attributes = ParseAttributes(tag);
    if (element.name == "text") {
      element.text =
          Unescape(svg.substr(end + 1, svg.find('<', end) - end - 1));
    }
    elements.push_back(std::move(element));
  }
  return elements;
}

double Number(const Attributes& attributes, const std::string& name,
              double otherwise) {
  const auto found = attributes.find(name);
  if (found == attributes.end()) return otherwise;
  return ParseDouble(found->second).value_or(otherwise);
}

std::vector<double> Numbers(std::string text) {
  for (char& c : text) {
    if (c == ',' || c == '(' || c == ')') c = ' ';
  }
  TextInput words(text);
  std::vector<double> numbers;
  for (std::string word; words >> word;) {
    const std::optional<double> number = ParseDouble(word);
    if (number) numbers.push_back(*number);
  }
  return numbers;
}

// "#rgb", "#rrggbb" or "white"; nullopt for "none".
std::optional<cv::Scalar> ParseColor(const std::string& color) {
  if (color == "white") return cv::Scalar(255, 255, 255);
  if (color.empty() || color[0] != '#') return std::nullopt;
  const bool is_short = color.size() == 4;
  std::array<double, 3> rgb{};
  for (size_t c = 0; c < 3; ++c) {
    const std::string digits =
        is_short ? std::string(2, color[c + 1]) : color.substr(2 * c + 1, 2);
    rgb[c] = static_cast<double>(std::stoi(digits, nullptr, 16));
  }
  return cv::Scalar(rgb[2], rgb[1], rgb[0]);
}

std::string DecodeBase64(const std::string& text) {
  std::string bytes;
  uint32_t bits = 0;
  int num_bits = 0;
  for (const char c : text) {
    const size_t digit = kBase64Digits.find(c);
    if (digit == std::string_view::npos) break;
    bits = bits << 6 | static_cast<uint32_t>(digit);
    num_bits += 6;
    if (num_bits < 8) continue;
    num_bits -= 8;
    bytes.push_back(static_cast<char>(bits >> num_bits & 0xff));
  }
  return bytes;
}

int ToFixed(double value) {
  return static_cast<int>(std::lround(value * (1 << kShift)));
}

cv::Point ToFixed(const cv::Point2d& p) {
  return {ToFixed(p.x - 0.5), ToFixed(p.y - 0.5)};
}

int Thickness(const Attributes& a, double scale) {
  return std::max(
      1, static_cast<int>(std::lround(Number(a, "stroke-width", 1.0) * scale)));
}

class Raster {
 public:
  Raster(double width, double height, double pixels_per_unit)
      : scale_(pixels_per_unit * kSupersampling),
        canvas_(Length(height), Length(width), CV_8UC3,
                cv::Scalar(255, 255, 255)),
        clip_(0, 0, canvas_.cols, canvas_.rows) {}

  void Draw(const Element& element);

  std::string ToPng() const {
    cv::Mat half;
    cv::resize(canvas_, half,
               {canvas_.cols / kSupersampling, canvas_.rows / kSupersampling},
               0, 0, cv::INTER_AREA);
    return EncodeImage(".png", half);
  }

 private:
  int Length(double value) const {
    // Even, so that the drawing can be halved.
    return kSupersampling * std::max(1, static_cast<int>(std::lround(
                                            value * scale_ / kSupersampling)));
  }
  // Coordinates in the part of the canvas that is not clipped.
  cv::Point2d ToCanvas(double x, double y) const {
    return {x * scale_ - clip_.x, y * scale_ - clip_.y};
  }
  cv::Rect RectOf(const Attributes& a) const {
    const double x = Number(a, "x", 0.0) * scale_;
    const double y = Number(a, "y", 0.0) * scale_;
    const double right = x + Number(a, "width", 0.0) * scale_;
    const double bottom = y + Number(a, "height", 0.0) * scale_;
    const cv::Point from(cvRound(x), cvRound(y));
    return {from, cv::Point(std::max(cvRound(right), from.x + 1),
                            std::max(cvRound(bottom), from.y + 1))};
  }
  // Draws with an opacity; `draw` gets the part that is not clipped.
  template <class Function>
  void Blend(double opacity, const Function& draw) {
    cv::Mat part = canvas_(clip_);
    if (opacity >= 1.0) {
      draw(&part);
      return;
    }
    cv::Mat copy = part.clone();
    draw(&copy);
    cv::addWeighted(copy, opacity, part, 1.0 - opacity, 0.0, part);
  }

  void DrawLines(const std::vector<cv::Point2d>& points, const Attributes& a);
  void DrawRectangle(const Attributes& a);
  void DrawEllipse(const cv::Point2d& center, const cv::Size2d& radii,
                   double angle_deg, const Attributes& a);
  void DrawImage(const Attributes& a);
  void DrawText(const Element& element);

  double scale_;
  cv::Mat canvas_;
  cv::Rect clip_;
  std::map<std::string, cv::Rect> clip_paths_;
  std::string open_clip_path_;  // its rectangle follows
};

std::optional<cv::Scalar> ColorOf(const Attributes& a, const char* name,
                                  const char* otherwise) {
  const auto found = a.find(name);
  return ParseColor(found == a.end() ? otherwise : found->second);
}

// Splits a line into dashes and gaps of these lengths.
std::vector<std::pair<cv::Point2d, cv::Point2d>> Dashes(
    const std::vector<cv::Point2d>& points, double dash, double gap) {
  std::vector<std::pair<cv::Point2d, cv::Point2d>> dashes;
  for (size_t i = 1; i < points.size(); ++i) {
    const cv::Point2d step = points[i] - points[i - 1];
    const double length = std::hypot(step.x, step.y);
    for (double at = 0.0; at < length; at += dash + gap) {
      dashes.emplace_back(
          points[i - 1] + at / length * step,
          points[i - 1] + std::min(at + dash, length) / length * step);
    }
  }
  return dashes;
}

void Raster::DrawLines(const std::vector<cv::Point2d>& points,
                       const Attributes& a) {
  const std::optional<cv::Scalar> stroke = ColorOf(a, "stroke", "none");
  if (!stroke) return;
  const int thickness = Thickness(a, scale_);
  const auto dash = a.find("stroke-dasharray");
  Blend(Number(a, "opacity", 1.0), [&](cv::Mat* part) {
    if (dash != a.end()) {
      const std::vector<double> lengths = Numbers(dash->second);
      if (lengths.size() != 2) return;
      for (const auto& [from, to] :
           Dashes(points, scale_ * lengths[0], scale_ * lengths[1])) {
        cv::line(*part, ToFixed(from), ToFixed(to), *stroke, thickness,
                 cv::LINE_AA, kShift);
      }
      return;
    }
    std::vector<cv::Point> fixed;
    for (const cv::Point2d& p : points) fixed.push_back(ToFixed(p));
    cv::polylines(*part, fixed, false, *stroke, thickness, cv::LINE_AA, kShift);
  });
}

void Raster::DrawRectangle(const Attributes& a) {
  const cv::Rect rect = RectOf(a) - clip_.tl();
  Blend(Number(a, "opacity", 1.0), [&](cv::Mat* part) {
    if (const auto fill = ColorOf(a, "fill", "#222")) {
      cv::rectangle(*part, rect, *fill, cv::FILLED);
    }
    if (const auto stroke = ColorOf(a, "stroke", "none")) {
      cv::rectangle(*part, rect, *stroke, Thickness(a, scale_));
    }
  });
}

void Raster::DrawEllipse(const cv::Point2d& center, const cv::Size2d& radii,
                         double angle_deg, const Attributes& a) {
  const cv::Size axes(ToFixed(radii.width), ToFixed(radii.height));
  if (const auto fill = ColorOf(a, "fill", "#222")) {
    Blend(Number(a, "fill-opacity", 1.0), [&](cv::Mat* part) {
      cv::ellipse(*part, ToFixed(center), axes, angle_deg, 0.0, 360.0, *fill,
                  cv::FILLED, cv::LINE_AA, kShift);
    });
  }
  if (const auto stroke = ColorOf(a, "stroke", "none")) {
    Blend(1.0, [&](cv::Mat* part) {
      cv::ellipse(*part, ToFixed(center), axes, angle_deg, 0.0, 360.0, *stroke,
                  Thickness(a, scale_), cv::LINE_AA, kShift);
    });
  }
}

void Raster::DrawImage(const Attributes& a) {
  const auto url = a.find("href");
  if (url == a.end()) return;
  const std::string file =
      DecodeBase64(url->second.substr(url->second.find(',') + 1));
  const cv::Mat image =
      DecodeImage(file, cv::IMREAD_UNCHANGED, kDefaultMaxNumPixels).pixels;
  if (image.type() != CV_8UC4) return;
  const cv::Rect rect = RectOf(a);
  const cv::Rect visible = rect & clip_;
  for (int y = visible.y; y < visible.br().y; ++y) {
    const int row = (y - rect.y) * image.rows / rect.height;
    for (int x = visible.x; x < visible.br().x; ++x) {
      const auto& pixel =
          image.at<cv::Vec4b>(row, (x - rect.x) * image.cols / rect.width);
      auto& below = canvas_.at<cv::Vec3b>(y, x);
      for (int c = 0; c < 3; ++c) {
        below[c] = static_cast<uint8_t>(
            (pixel[c] * pixel[3] + below[c] * (255 - pixel[3])) / 255);
      }
    }
  }
}

// Each character that is not ASCII becomes one '?'.
std::string ToAscii(const std::string& text) {
  std::string ascii;
  for (const char c : text) {
    const auto byte = static_cast<uint8_t>(c);
    const bool is_continuation = (byte & 0xc0) == 0x80;
    if (is_continuation) continue;
    ascii.push_back(byte < 0x80 ? c : '?');
  }
  return ascii;
}

void Raster::DrawText(const Element& element) {
  // Capitals of this font are 21 units high, those of sans-serif fonts 0.72 of
  // the size of the font.
  constexpr double kFontUnits = 21.0, kCapitals = 0.72;
  constexpr double kStroke = 0.09;  // of the size of the font
  const Attributes& a = element.attributes;
  const std::optional<cv::Scalar> color = ColorOf(a, "fill", "#222");
  if (!color) return;
  const double size = Number(a, "font-size", 13.0) * scale_;
  const double font_scale = size * kCapitals / kFontUnits;
  const int thickness =
      std::max(1, static_cast<int>(std::lround(kStroke * size)));
  const std::string text = ToAscii(element.text);
  int base_line = 0;
  const int width = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, font_scale,
                                    thickness, &base_line)
                        .width;
  cv::Point2d at = ToCanvas(Number(a, "x", 0.0), Number(a, "y", 0.0));
  const auto anchor = a.find("text-anchor");
  if (anchor != a.end()) {
    at.x -= anchor->second == "middle" ? 0.5 * width : width;
  }
  Blend(Number(a, "opacity", 1.0), [&](cv::Mat* part) {
    cv::putText(*part, text, cv::Point(cvRound(at.x), cvRound(at.y)),
                cv::FONT_HERSHEY_SIMPLEX, font_scale, *color, thickness,
                cv::LINE_AA);
  });
}

void Raster::Draw(const Element& element) {
  const Attributes& a = element.attributes;
  const auto point = [&](const char* x, const char* y) {
    return ToCanvas(Number(a, x, 0.0), Number(a, y, 0.0));
  };
  if (element.name == "line") {
    DrawLines({point("x1", "y1"), point("x2", "y2")}, a);
  } else if (element.name == "polyline") {
    const std::vector<double> numbers = Numbers(a.at("points"));
    std::vector<cv::Point2d> points;
    for (size_t i = 0; i + 1 < numbers.size(); i += 2) {
      points.push_back(ToCanvas(numbers[i], numbers[i + 1]));
    }
    DrawLines(points, a);
  } else if (element.name == "circle") {
    const double radius = scale_ * Number(a, "r", 0.0);
    DrawEllipse(point("cx", "cy"), {radius, radius}, 0.0, a);
  } else if (element.name == "ellipse") {
    // translate(x y) rotate(degrees)
    const std::vector<double> n = Numbers(a.at("transform"));
    if (n.size() != 3) return;
    DrawEllipse(ToCanvas(n[0], n[1]),
                {scale_ * Number(a, "rx", 0.0), scale_ * Number(a, "ry", 0.0)},
                n[2], a);
  } else if (element.name == "clipPath") {
    open_clip_path_ = a.at("id");
  } else if (element.name == "rect" && !open_clip_path_.empty()) {
    clip_paths_["url(#" + open_clip_path_ + ")"] =
        RectOf(a) & cv::Rect(0, 0, canvas_.cols, canvas_.rows);
    open_clip_path_.clear();
  } else if (element.name == "rect") {
    DrawRectangle(a);
  } else if (element.name == "g") {
    clip_ = clip_paths_[a.at("clip-path")];
  } else if (element.name == "/g") {
    clip_ = {0, 0, canvas_.cols, canvas_.rows};
  } else if (element.name == "image") {
    DrawImage(a);
  } else if (element.name == "text") {
    DrawText(element);
  }
}

}  // namespace

std::string RasterizeSvg(const std::string& svg, double pixels_per_unit) {
  const std::vector<Element> elements = ParseSvg(svg);
  const Attributes& root = elements.front().attributes;
  Raster raster(Number(root, "width", 1.0), Number(root, "height", 1.0),
                pixels_per_unit);
  for (const Element& element : elements) raster.Draw(element);
  return raster.ToPng();
}

}  // namespace mgsfm
