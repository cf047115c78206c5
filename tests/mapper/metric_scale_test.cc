// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "georegistration/world_frame.h"
#include "mapper/run_summary.h"
#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Simulation StereoDrive(bool extrinsics_are_known) {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.path = PathPreset::kCurve;
  options.num_frames = 12;
  options.extrinsics_are_known = extrinsics_are_known;
  return Simulate(options);
}

MapperModel Map(const Simulation& simulation, const std::string& metric_scale) {
  MapperOptions options;
  options.metric_scale = metric_scale;
  MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph}, options, Context());
  EXPECT_EQ(result.models.size(), 1u);
  const RunSummary summary = SummarizeRun(simulation.scene, result);
  EXPECT_THAT(summary.models[0].unit_of_length,
              HasSubstr(metric_scale.empty() ? "arbitrary scale" : "metric"));
  return std::move(result.models.at(0));
}

std::string ErrorOf(const Simulation& simulation, const std::string& text) {
  try {
    (void)ParseMetricScale(text, simulation.scene);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// The model is in the unit of the rig, but that is no meter.
TEST(MetricScaleTest, RigsInMillimetersAreNotCalledMetric) {
  for (const double factor : {1.0, 1000.0}) {
    Simulation simulation = StereoDrive(true);
    for (Sensor& sensor : simulation.scene.sensors) {
      if (sensor.sensor_from_rig) sensor.sensor_from_rig->translation *= factor;
    }
    const MapperResult result = RunMapper(
        {simulation.scene, simulation.view_graph}, MapperOptions(), Context());
    const std::string unit =
        SummarizeRun(simulation.scene, result).models.at(0).unit_of_length;
    EXPECT_EQ(unit.rfind("metric", 0) == 0, factor == 1.0) << unit;
    EXPECT_THAT(unit, HasSubstr("that of the known rig"));
  }
}

// All lengths of the model are multiplied by one factor.
TEST(MetricScaleTest, ScalesPosesPointsAndRig) {
  const Simulation simulation = StereoDrive(false);
  const Reconstruction free = Map(simulation, "").reconstruction;
  const MapperModel model = Map(simulation, "known_baseline=cam0:cam1:2.5");
  const Reconstruction& metric = model.reconstruction;
  EXPECT_NEAR(metric.sensor_from_rig[1]->translation.norm(), 2.5, 1e-12);
  const double factor = 2.5 / free.sensor_from_rig[1]->translation.norm();
  EXPECT_NEAR(*model.meters_per_unit, factor, 1e-9 * factor);
  for (size_t i = 0; i < simulation.scene.frames.size(); ++i) {
    EXPECT_LT((metric.rig_from_world[i]->Center() -
               factor * free.rig_from_world[i]->Center())
                  .norm(),
              1e-6 * factor);
  }
  ASSERT_EQ(metric.points.size(), free.points.size());
  EXPECT_LT(
      (metric.points[0].point_in_world - factor * free.points[0].point_in_world)
          .norm(),
      1e-6 * factor);
}

TEST(MetricScaleTest, KnownRigsDefineTheUnit) {
  const Simulation simulation = StereoDrive(true);
  const double length =
      simulation.scene.sensors[1].sensor_from_rig->translation.norm();
  const MapperModel model =
      Map(simulation, "known_baseline=cam0:cam1:" + std::to_string(length));
  EXPECT_FALSE(model.meters_per_unit.has_value());
  EXPECT_THAT(ErrorOf(simulation, "known_baseline=cam0:cam1:9"),
              HasSubstr("the known rig has the distance"));
}

TEST(MetricScaleTest, MalformedValuesAreNamed) {
  const Simulation simulation = StereoDrive(false);
  EXPECT_FALSE(ParseMetricScale("", simulation.scene).has_value());
  for (const char* text : {"cam0:cam1:1", "known_baseline=cam0:1", ":",
                           "known_baseline=::", "known_baseline=", "a:b"}) {
    EXPECT_THAT(ErrorOf(simulation, text),
                AllOf(HasSubstr("metric_scale"), HasSubstr(text)));
  }
  for (const char* length : {"0", "-1", "nan", "x", ""}) {
    EXPECT_THAT(
        ErrorOf(simulation, std::string("known_baseline=cam0:cam1:") + length),
        HasSubstr("positive number"));
  }
  EXPECT_THAT(ErrorOf(simulation, "known_baseline=cam0:cam0:1"),
              HasSubstr("no rig has both cameras"));
  EXPECT_THAT(ErrorOf(simulation, "known_baseline=cam0:right:1"),
              HasSubstr("'cam0', 'cam1'"));
}

}  // namespace
}  // namespace mgsfm
