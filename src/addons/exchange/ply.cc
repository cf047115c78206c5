// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/ply.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <optional>

#include "base/file_reading.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct PlyHeader {
  bool is_text = false;
  bool has_other_elements = false;  // behind the vertices
  uint64_t num_vertices = 0;
  std::vector<std::string> names, types;  // of the properties of a vertex
  size_t size = 0;                        // bytes
};

[[noreturn]] void Throw(const fs::path& path, const std::string& problem) {
  throw Error("'" + path.string() + "' " + problem +
              "; write the points again as x y z red green blue, ASCII or "
              "binary little-endian");
}

bool ReadCount(TextInput* words, uint64_t* count) {
  std::string word;
  *words >> word;
  const char* end = word.data() + word.size();
  const auto [parsed_end, error] = std::from_chars(word.data(), end, *count);
  return error == std::errc() && parsed_end == end;
}

PlyHeader ReadHeader(const std::string& file, const fs::path& path) {
  PlyHeader header;
  TextInput lines(file);
  std::string line, word;
  bool is_in_vertex = false;
  for (int number = 1; std::getline(lines, line); ++number) {
    TextInput words(line);
    if (number == 1 && (!(words >> word) || word != "ply")) break;
    words >> word;
    if (word == "format") {
      words >> word;
      header.is_text = word == "ascii";
      if (!header.is_text && word != "binary_little_endian") break;
    } else if (word == "element") {
      words >> word;
      if (!is_in_vertex && word != "vertex") break;
      header.has_other_elements |= is_in_vertex;
      is_in_vertex = word == "vertex";
      if (is_in_vertex && !ReadCount(&words, &header.num_vertices)) break;
    } else if (word == "property" && is_in_vertex) {
      header.types.emplace_back();
      header.names.emplace_back();
      words >> header.types.back() >> header.names.back();
    } else if (word == "end_header") {
      header.size =
          lines.eof() ? file.size() : static_cast<size_t>(lines.tellg());
      return header;
    }
  }
  Throw(path, "is not a PLY file of points");
}

template <class T>
double Decode(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return static_cast<double>(value);
}

// Types of PLY, with both of their names.
struct PlyType {
  const char* name;
  const char* other_name;
  size_t size;
  double (*decode)(const char* bytes);
};

constexpr PlyType kTypes[] = {
    {"char", "int8", 1, Decode<int8_t>},
    {"uchar", "uint8", 1, Decode<uint8_t>},
    {"short", "int16", 2, Decode<int16_t>},
    {"ushort", "uint16", 2, Decode<uint16_t>},
    {"int", "int32", 4, Decode<int32_t>},
    {"uint", "uint32", 4, Decode<uint32_t>},
    {"float", "float32", 4, Decode<float>},
    {"double", "float64", 8, Decode<double>},
};

const PlyType& FindType(const std::string& name, const fs::path& path) {
  for (const PlyType& type : kTypes) {
    if (name == type.name || name == type.other_name) return type;
  }
  Throw(path, "has a property of the type '" + Printable(name) + "'");
}

constexpr std::string_view kColors[] = {"red", "green", "blue"};

void SetProperty(const std::string& name, double value,
                 Eigen::Vector3d* position, Eigen::Vector3d* color) {
  constexpr std::string_view kAxes[] = {"x", "y", "z"};
  for (int k = 0; k < 3; ++k) {
    if (name == kAxes[k]) (*position)[k] = value;
    if (name == kColors[k]) (*color)[k] = value;
  }
}

// Colors that are not integers are from 0 to 1, unless one is larger.
double ScaleOfColors(const PlyHeader& header,
                     const std::vector<Eigen::Vector3d>& colors) {
  for (size_t i = 0; i < header.names.size(); ++i) {
    const bool is_float =
        header.types[i] == "float" || header.types[i] == "float32" ||
        header.types[i] == "double" || header.types[i] == "float64";
    if (header.names[i] != kColors[0] || !is_float) continue;
    double max = 0.0;
    for (const Eigen::Vector3d& color : colors) {
      max = std::max(max, color.maxCoeff());
    }
    return max <= 1.0 ? 255.0 : 1.0;
  }
  return 1.0;
}

// The values of a vertex, one after another.
class VertexReader {
 public:
  VertexReader(const std::string& file, const PlyHeader& header,
               const fs::path& path)
      : header_(header),
        path_(path),
        bytes_(file.data() + header.size),
        num_bytes_(file.size() - header.size) {
    if (header.is_text) words_.str(file.substr(header.size));
    for (const std::string& type : header.types) {
      types_.push_back(&FindType(type, path));
    }
    for (const char* axis : {"x", "y", "z"}) {
      if (std::count(header.names.begin(), header.names.end(), axis) == 1) {
        continue;
      }
      Throw(path, std::string("does not have the coordinate ") + axis +
                      " of its points once");
    }
  }

  // Throws Error if the file goes on after all vertices.
  void CheckEnd() {
    if (header_.has_other_elements) return;
    std::string word;
    if (header_.is_text ? bool(words_ >> word) : num_bytes_ > 0) {
      Throw(path_, "has more points than its header says");
    }
  }

  double Next(size_t property) {
    if (header_.is_text) {
      std::string word;
      words_ >> word;
      const std::optional<double> value = ParseDouble(word);
      if (!value)
        Throw(path_, "is truncated or has a word that is not a number");
      return *value;
    }
    const PlyType& type = *types_[property];
    if (num_bytes_ < type.size) Throw(path_, "is truncated");
    const double value = type.decode(bytes_);
    bytes_ += type.size;
    num_bytes_ -= type.size;
    return value;
  }

 private:
  const PlyHeader& header_;
  const fs::path& path_;
  const char* bytes_;
  size_t num_bytes_;
  TextInput words_;
  std::vector<const PlyType*> types_;
};

}  // namespace

// Little-endian, as on every machine that Debian's COLMAP runs on.
std::string PointsToPly(const Reconstruction& model) {
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement vertex " +
      std::to_string(model.points.size()) +
      "\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n";
  for (const Point3D& point : model.points) {
    const Eigen::Vector3f position = point.point_in_world.cast<float>();
    text.append(reinterpret_cast<const char*>(position.data()),
                3 * sizeof(float));
    text.append(reinterpret_cast<const char*>(point.color.data()), 3);
  }
  return text;
}

std::vector<ImportedPoint> ReadPly(const fs::path& path) {
  const std::string file = ReadFile(path);
  const PlyHeader header = ReadHeader(file, path);
  VertexReader values(file, header, path);
  std::vector<ImportedPoint> points;
  std::vector<Eigen::Vector3d> colors;
  for (uint64_t i = 0; i < header.num_vertices; ++i) {
    points.emplace_back();
    colors.emplace_back(Eigen::Vector3d::Zero());
    for (size_t k = 0; k < header.names.size(); ++k) {
      SetProperty(header.names[k], values.Next(k),
                  &points.back().point_in_world, &colors.back());
    }
  }
  values.CheckEnd();
  const double scale = ScaleOfColors(header, colors);
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Array3d color = (scale * colors[i].array()).round();
    if (!(color >= 0.0 && color <= 255.0).all()) {
      Throw(path, "has a color out of the range from 0 to 255");
    }
    for (int k = 0; k < 3; ++k) {
      points[i].color[k] = static_cast<uint8_t>(color[k]);
    }
  }
  return points;
}

}  // namespace mgsfm
