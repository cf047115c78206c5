// SPDX-License-Identifier: BSD-3-Clause
#include "reference_positions.h"

#include <algorithm>
#include <map>
#include <vector>

#include "database/database_reader.h"
#include "database/sqlite_database.h"
#include "mgsfm/base/error.h"
#include "mgsfm/priors/pose_priors.h"
#include "priors/position_files.h"

namespace mgsfm {
namespace {

PosePriorOptions PriorOptions(const ReferenceSource& source) {
  PosePriorOptions options;
  options.use_prior_position = true;
  options.ref_is_gps = source.ref_is_gps;
  options.overwrite_priors_covariance = true;
  options.prior_position_std_x_m = source.position_std_m;
  options.prior_position_std_y_m = source.position_std_m;
  options.prior_position_std_z_m = source.position_std_m;
  options.use_prior_gravity = source.uses_gravity;
  return options;
}

// Positions of images of the model; those of other images are skipped.
std::vector<PosePriorRow> ReadPositions(const std::string& path,
                                        const Scene& scene) {
  std::vector<PosePriorRow> rows;
  for (const NamedVector& line : ReadNamedVectors(
           scene, path, "X Y Z", "ref_images_path", UnknownImages::kIgnore)) {
    rows.push_back({scene.images[line.image_idx].id,
                    PosePriorRow::CoordinateSystem::kUndefined, line.value,
                    std::nullopt});
  }
  if (rows.empty()) {
    throw Error("'" + path +
                "' (--ref_images_path) has no position of an image of the "
                "model, such as '" +
                scene.images.front().name + "'; give names as in the model");
  }
  return rows;
}

// Only the names and ids of the images of a database, in canonical order.
Scene ImagesOfDatabase(const std::string& path, const Context& context) {
  const SqliteSnapshot snapshot(path);
  Scene scene;
  for (const ImageRow& row :
       ReadStructure(snapshot.database(), context).images) {
    scene.images.push_back({row.id, row.name, 0, 0, 0, {}});
  }
  std::sort(scene.images.begin(), scene.images.end(),
            [](const Image& a, const Image& b) { return a.name < b.name; });
  return scene;
}

// The index in the database of each image of the model.
std::vector<size_t> FindImages(const Scene& model, const Scene& database,
                               const std::string& database_path) {
  std::map<std::string, size_t> idx_of_name;
  for (size_t i = 0; i < database.images.size(); ++i) {
    idx_of_name.emplace(database.images[i].name, i);
  }
  std::vector<size_t> idxs;
  for (const Image& image : model.images) {
    const auto found = idx_of_name.find(image.name);
    if (found == idx_of_name.end()) {
      throw Error("the database '" + database_path + "' has no image '" +
                  image.name +
                  "' of the model; give the database of its images");
    }
    idxs.push_back(found->second);
  }
  return idxs;
}

}  // namespace

ReferencePositions ReadReference(const ReferenceSource& source,
                                 const Scene& scene, const Context& context) {
  const PosePriorOptions options = PriorOptions(source);
  ReferencePositions reference;
  if (!source.ref_images_path.empty()) {
    reference.positions =
        MakePositionPriors(scene, ReadPositions(source.ref_images_path, scene),
                           "'" + source.ref_images_path + "'", options);
    return reference;
  }
  const Scene all = ImagesOfDatabase(source.database_path, context);
  const std::vector<size_t> idxs = FindImages(scene, all, source.database_path);
  if (source.uses_positions) {
    PositionPriors positions =
        ReadPositionPriors(all, source.database_path, options);
    reference.positions.origin_wgs84 = positions.origin_wgs84;
    reference.positions.num_null_fixes = positions.num_null_fixes;
    for (const size_t i : idxs) {
      reference.positions.images.push_back(positions.images[i]);
    }
  }
  if (source.uses_gravity) {
    const GravityPriors gravity =
        ReadGravity(all, source.database_path, options);
    for (const size_t i : idxs) {
      reference.gravity.images.push_back(gravity.images[i]);
    }
  }
  return reference;
}

}  // namespace mgsfm
