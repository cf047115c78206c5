// SPDX-License-Identifier: BSD-3-Clause
#include "priors/urdf.h"

#include <re2/re2.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "base/file_reading.h"
#include "base/text_lines.h"
#include "mgsfm/base/error.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

using Attributes = std::map<std::string, std::string>;

struct Joint {
  std::string name;
  bool is_fixed = false;
  std::string parent;
  std::string child;
  Rigid3 parent_from_child;
};

Attributes AttributesOf(const std::string& text) {
  static const RE2 kAttribute(R"re(([\w:.-]+)\s*=\s*(?:"([^"]*)"|'([^']*)'))re",
                              RE2::Latin1);
  re2::StringPiece rest(text);
  Attributes attributes;
  std::string key, in_quotes, in_apostrophes;
  while (RE2::FindAndConsume(&rest, kAttribute, &key, &in_quotes,
                             &in_apostrophes)) {
    attributes[key] = in_quotes + in_apostrophes;
  }
  return attributes;
}

// Zeros if the attribute is missing.
Eigen::Vector3d VectorOf(const Attributes& attributes, const char* key,
                         const std::string& place) {
  const auto found = attributes.find(key);
  if (found == attributes.end()) return Eigen::Vector3d::Zero();
  std::string text = found->second;
  std::replace(text.begin(), text.end(), '\n', ' ');
  const auto numbers = ParseNumbers(text);
  if (!numbers || numbers->size() != 3) {
    throw Error(place + " has no three numbers in " + key + "; correct it");
  }
  return {(*numbers)[0], (*numbers)[1], (*numbers)[2]};
}

Rigid3 PoseOf(const Attributes& origin, const std::string& place) {
  const Eigen::Vector3d rpy = VectorOf(origin, "rpy", place);
  const Eigen::Quaterniond rotation(
      Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()));
  Rigid3 pose{rotation, VectorOf(origin, "xyz", place)};
  const auto why = WhyImplausible(pose);
  if (why) throw Error(place + " has an origin that " + *why + "; correct it");
  return pose;
}

// The links as children of their roots, so that chains of any length take
// linear time.
FrameTree BelowRoots(const Urdf& urdf) {
  FrameTree below_roots;
  std::set<std::string> passed;
  for (const std::string& link : urdf.links) {
    std::vector<std::string> path;
    std::string frame = link;
    while (below_roots.FindParent(frame) == nullptr) {
      const auto* parent = urdf.fixed.FindParent(frame);
      if (parent == nullptr) break;
      if (!passed.insert(frame).second) {
        throw Error("'" + urdf.path +
                    "' has a cycle of fixed joints above the link '" + link +
                    "'; correct their parents");
      }
      path.push_back(std::move(frame));
      frame = parent->first;
    }
    for (; !path.empty(); path.pop_back()) {
      const auto* parent = urdf.fixed.FindParent(path.back());
      const auto [root, root_from_parent] = below_roots.RootFrom(parent->first);
      below_roots.Add(root, path.back(), root_from_parent * parent->second);
    }
  }
  return below_roots;
}

}  // namespace

Urdf ReadUrdf(const std::string& path) {
  // Comments and declarations have no name. Bytes of any encoding are read.
  static const RE2 kTag(
      R"re((?s)<!--.*?-->|<!\[CDATA\[.*?\]\]>|(<!--|<!\[CDATA\[)|)re"
      R"re(<[?!][^>]*>|)re"
      R"re(<(/?)([\w:.-]+)((?:[^<>"']|"[^"]*"|'[^']*')*)>)re",
      RE2::Latin1);
  const std::string text = ReadFile(path);
  re2::StringPiece rest(text);
  std::string open, slash, name, content;
  Urdf urdf{path, {}, {}};
  Joint joint;
  bool is_complete = false;
  while (RE2::FindAndConsume(&rest, kTag, &open, &slash, &name, &content)) {
    if (!open.empty()) {
      throw Error("'" + path + "' has " +
                  (open == "<!--" ? "a comment without end; close it by -->"
                                  : "CDATA without end; close them by ]]>"));
    }
    if (name.compare(0, 6, "xacro:") == 0) {
      throw Error("'" + path +
                  "' has macros; expand it by `xacro FILE > robot.urdf`");
    }
    const bool is_end = !slash.empty();
    Attributes attributes = AttributesOf(content);
    if (name == "robot") {
      is_complete = is_end;
    } else if (name == "link" && !is_end) {
      urdf.links.push_back(attributes["name"]);
    } else if (name == "joint" && is_end) {
      if (joint.is_fixed) {
        urdf.fixed.Add(joint.parent, joint.child, joint.parent_from_child);
      }
      joint = Joint();
    } else if (name == "joint") {
      joint = {attributes["name"], attributes["type"] == "fixed"};
    } else if (name == "parent") {
      joint.parent = attributes["link"];
    } else if (name == "child") {
      joint.child = attributes["link"];
    } else if (name == "origin" && joint.is_fixed) {
      joint.parent_from_child =
          PoseOf(attributes, "'" + path + "': joint '" + joint.name + "'");
    }
  }
  if (!is_complete) {
    throw Error("'" + path +
                "' is no whole URDF, <robot> ... </robot>; export it again");
  }
  urdf.fixed = BelowRoots(urdf);
  return urdf;
}

}  // namespace mgsfm
