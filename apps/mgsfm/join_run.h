// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "fleet/sub_maps.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/priors/pose_priors.h"
#include "model_file.h"

namespace mgsfm {

struct ModelMergerOptions {
  Option<std::string> input_path1{
      "input_path1", "",
      "Merge the model in this folder with the second one. The result keeps "
      "its world and poses."};
  Option<std::string> input_path2{
      "input_path2", "",
      "Merge the model in this folder, reconstructed from the same database."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "Write the merged model, or the models 0, 1, "
                                  "... of sub-maps, into this folder."};
  Option<bool> graph{"graph", false,
                     "Join any number of sub-maps, such as the clusters of "
                     "mapper --partition, "
                     "and adjust the result."};
  Option<std::string> input_path{
      "input_path", "",
      "Join the sub-maps in this folder with graph: an output folder of the "
      "mapper for each cluster, named 0, 1, ..."};
  Option<std::string> cluster_path{
      "cluster_path", "",
      "Report clusters without a model by their names in this folder of mapper "
      "--partition, with graph."};
  Option<std::string> database_path{
      "database_path", "",
      "Close loops between clusters with the matches of this database, with "
      "graph. It is not changed."};
  Option<bool> refine{"refine", true, "Adjust the joined models of graph."};
  Option<std::string> image_path{
      "image_path", "",
      "Color the points of the joined models of graph by the images in this "
      "folder. Without it, points keep the colors of the sub-maps."};
  Option<bool> compute_covariances{
      "compute_covariances", false,
      "Compute the covariances of the joined models of graph, as the mapper "
      "does."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into the folder of each "
      "joined model of graph."};
  Option<int> max_memory_mib{
      "max_memory", 0, AtLeast(0), "MiB",
      "Adjust the joined models of graph within this memory, by a selection of "
      "their tracks if necessary. 0: no limit."};
  Option<int> min_common_images{
      "min_common_images", 3, AtLeast(3), "images",
      "Require this many common images, or cameras in common frames."};
  Option<double> max_reproj_error{
      "max_reproj_error", 64.0, GreaterThan(0.0), "px",
      "Remove observations with larger errors from the merged model."};
  Option<ModelFormat> output_format = ModelFormatOption();
  ModelRigOptions rigs;
  JoinOptions join;
  PosePriorOptions priors;
  BundleAdjustmentOptions bundle_adjustment;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path1, input_path2, output_path, min_common_images,
          max_reproj_error, output_format, rigs, graph, input_path,
          cluster_path, database_path, image_path, write_report, refine,
          compute_covariances, max_memory_mib, priors);
    visit.Group("Join", join);
    visit.Group("BundleAdjustment", bundle_adjustment);
  }
};

// Joins the models of clusters from `mapper --partition` into the models 0, 1,
// ... with the tables and pages of the mapper, and a report.json. Reports
// clusters without a model. Returns an ExitCode; throws Error for bad input.
int JoinClusters(const ModelMergerOptions& options, const Context& context);

}  // namespace mgsfm
