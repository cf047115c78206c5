// SPDX-License-Identifier: BSD-3-Clause
#include "video/video_sampling.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "files/file_operations.h"
#include "files/image_writing.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "video/motion_sampler.h"
#include "video/sampling_plan.h"
#include "video/video_decoder.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Sharpness needs more pixels than motion; even larger images add nothing.
constexpr int kAnalysisSizePx = 640;

std::string SecondsText(int64_t time_ns) {
  return FormatDouble(Seconds(time_ns), std::chars_format::fixed, 3);
}

std::string Settings(const std::vector<fs::path>& paths,
                     const VideoSamplingOptions& options) {
  nlohmann::ordered_json videos = nlohmann::ordered_json::array();
  for (const fs::path& path : paths) {
    std::error_code ignored;
    videos.push_back(
        {{"path", fs::weakly_canonical(fs::absolute(path)).string()},
         {"size", fs::file_size(path, ignored)}});
  }
  const nlohmann::ordered_json settings = {
      {"videos", std::move(videos)},
      {"sampling", EnumName(*options.sampling)},
      {"min_motion", *options.min_motion},
      {"rate", *options.rate},
      {"alignment", EnumName(*options.alignment)},
      {"time_offsets", *options.time_offsets},
      {"max_time_difference_s", *options.max_time_difference_s},
      {"image_format", EnumName(*options.image_format)},
      {"jpeg_quality", *options.jpeg_quality}};
  return settings.dump();
}

// --------------------------------------------------------------- common clock

struct Video {
  fs::path path;
  VideoIndex index;
  int64_t offset_ns = 0;  // from time stamps to the common clock

  std::vector<int64_t> CommonTimes() const {
    std::vector<int64_t> times_ns = index.times_ns;
    for (int64_t& time_ns : times_ns) time_ns += offset_ns;
    return times_ns;
  }
};

std::vector<int64_t> ParseOffsets(const std::string& list, size_t num_videos) {
  std::vector<int64_t> offsets_ns;
  for (const std::string& word : SplitList(list)) {
    const std::optional<double> offset_s = ParseDouble(word);
    if (!offset_s || std::abs(*offset_s) > 1e9) {
      throw Error("time_offsets: '" + word + "' is not a number of seconds");
    }
    offsets_ns.push_back(std::llround(*offset_s * kNsPerSecond));
  }
  if (offsets_ns.empty()) offsets_ns.resize(num_videos, 0);
  if (offsets_ns.size() != num_videos) {
    throw Error("time_offsets has " + std::to_string(offsets_ns.size()) +
                " numbers, but there are " + std::to_string(num_videos) +
                " videos; give one per video");
  }
  return offsets_ns;
}

int64_t OffsetOf(const fs::path& path, const VideoIndex& index,
                 VideoAlignment alignment) {
  if (alignment == VideoAlignment::kTimestamps) return 0;
  if (alignment == VideoAlignment::kStart) return -index.times_ns.front();
  if (!index.creation_time_ns) {
    throw Error("video '" + path.string() +
                "' does not state its creation time; set another alignment or "
                "time_offsets");
  }
  return *index.creation_time_ns - index.times_ns.front();
}

std::vector<Video> ReadVideos(const std::vector<fs::path>& paths,
                              const VideoSamplingOptions& options,
                              const Context& context) {
  const std::vector<int64_t> offsets_ns =
      ParseOffsets(options.time_offsets, paths.size());
  std::vector<Video> videos;
  for (size_t i = 0; i < paths.size(); ++i) {
    context.ReportProgress("reading videos", i, paths.size());
    VideoIndex index = IndexVideo(paths[i]);
    if (index.is_cut_off) {
      context.Warning("video '" + paths[i].string() + "' is damaged after " +
                      SecondsText(index.times_ns.back()) +
                      " s; the rest is skipped");
    }
    const int64_t offset_ns =
        OffsetOf(paths[i], index, options.alignment) + offsets_ns[i];
    videos.push_back({paths[i], std::move(index), offset_ns});
  }
  return videos;
}

// Suggests creation times: cameras started by hand differ by seconds.
void SuggestCreationTimes(const std::vector<Video>& videos,
                          const VideoSamplingOptions& options,
                          const Context& context) {
  // Containers store creation times as whole seconds.
  constexpr int64_t kPrecisionNs = kNsPerSecond;
  if (options.alignment == VideoAlignment::kCreationTime ||
      !options.time_offsets->empty()) {
    return;
  }
  std::vector<int64_t> times_ns;
  for (const Video& video : videos) {
    if (!video.index.creation_time_ns) return;
    times_ns.push_back(*video.index.creation_time_ns);
  }
  const auto [first, last] =
      std::minmax_element(times_ns.begin(), times_ns.end());
  if (*last - *first <= kPrecisionNs) return;
  context.Warning("the creation times of the videos differ by " +
                  SecondsText(*last - *first) +
                  " s; unless the videos were cut to begin at once, set "
                  "time_offsets, or alignment creation_time for whole seconds");
}

int64_t MaxDifferenceNs(const Video& a, const Video& b,
                        const VideoSamplingOptions& options) {
  if (options.max_time_difference_s > 0.0) {
    return std::llround(options.max_time_difference_s * kNsPerSecond);
  }
  return std::max(MedianInterval(a.index.times_ns).value_or(0),
                  MedianInterval(b.index.times_ns).value_or(0)) /
         2;
}

// ------------------------------------------------------------------- planning

std::vector<int> SelectByMotion(const Video& video, double min_motion,
                                const Context& context) {
  const std::vector<int64_t>& times_ns = video.index.times_ns;
  MotionSampler sampler(min_motion);
  const auto decoder = OpenVideo(video.path, context.num_threads);
  while (decoder->Next()) {
    const auto found =
        std::lower_bound(times_ns.begin(), times_ns.end(), decoder->TimeNs());
    if (found == times_ns.end() || *found != decoder->TimeNs()) continue;
    const auto idx = static_cast<int>(found - times_ns.begin());
    sampler.Add(idx, decoder->ReadSmallGray(kAnalysisSizePx));
    context.ReportProgress("measuring motion", idx, times_ns.size());
  }
  return sampler.Finish();
}

std::vector<int64_t> SelectInstants(const Video& leader,
                                    const VideoSamplingOptions& options,
                                    const Context& context) {
  const std::vector<int64_t> times_ns = leader.CommonTimes();
  const std::vector<int> selected =
      options.sampling == VideoSampling::kRate
          ? SelectByRate(times_ns, options.rate)
          : SelectByMotion(leader, options.min_motion, context);
  if (selected.empty()) {
    throw Error("video '" + leader.path.string() +
                "' is damaged: none of its images can be decoded; copy it "
                "again from the camera");
  }
  return Transformed(selected, [&](int idx) { return times_ns[idx]; });
}

// Adds the images of a video to the frames, and logs how well they fit.
void AddVideo(const Video& video, const Video& leader,
              const std::vector<int64_t>& instants_ns,
              const VideoSamplingOptions& options, const Context& context,
              std::vector<SampledFrame>* frames) {
  const std::vector<int64_t> times_ns = video.CommonTimes();
  const auto selected = SelectAtInstants(
      instants_ns, times_ns, MaxDifferenceNs(leader, video, options));
  std::vector<int64_t> differences_ns;
  for (size_t i = 0; i < selected.size(); ++i) {
    (*frames)[i].times_ns.emplace_back();
    if (!selected[i]) continue;
    (*frames)[i].times_ns.back() = video.index.times_ns[*selected[i]];
    differences_ns.push_back(std::abs(times_ns[*selected[i]] - instants_ns[i]));
  }
  if (differences_ns.empty()) {
    throw Error("video '" + video.path.string() + "' (" +
                SecondsText(times_ns.front()) + " s to " +
                SecondsText(times_ns.back()) +
                " s) has no image at the times of '" + leader.path.string() +
                "' (" + SecondsText(instants_ns.front()) + " s to " +
                SecondsText(instants_ns.back()) +
                " s); set alignment or time_offsets");
  }
  std::sort(differences_ns.begin(), differences_ns.end());
  context.Info("video '" + video.path.filename().string() +
               "': " + std::to_string(differences_ns.size()) + " of " +
               std::to_string(times_ns.size()) + " images in " +
               std::to_string(instants_ns.size()) +
               " frames; times differ from those of the first video by " +
               SecondsText(differences_ns[differences_ns.size() / 2]) +
               " s in the median, by " + SecondsText(differences_ns.back()) +
               " s at most");
}

SamplingPlan MakePlan(const std::vector<fs::path>& paths,
                      const VideoSamplingOptions& options,
                      const Context& context) {
  SamplingPlan plan;
  plan.folders = FoldersOfVideos(paths);
  const std::vector<Video> videos = ReadVideos(paths, options, context);
  SuggestCreationTimes(videos, options, context);
  const std::vector<int64_t> instants_ns =
      SelectInstants(videos.front(), options, context);
  for (const std::string& name : NamesOfTimes(instants_ns)) {
    plan.frames.push_back({name, {}});
  }
  for (const Video& video : videos) {
    plan.offsets_ns.push_back(video.offset_ns);
    AddVideo(video, videos.front(), instants_ns, options, context,
             &plan.frames);
  }
  return plan;
}

// ----------------------------------------------------------------- extraction

class Extractor {
 public:
  Extractor(const SamplingPlan& plan, const fs::path& output_path,
            const VideoSamplingOptions& options)
      : plan_(plan), output_path_(output_path), options_(options) {}

  // Writes the missing images of a video.
  void Extract(size_t video_idx, const fs::path& path, const Context& context,
               VideoSamplingSummary* summary) const {
    std::map<int64_t, size_t> frame_of_time;
    for (size_t i = 0; i < plan_.frames.size(); ++i) {
      const auto& time_ns = plan_.frames[i].times_ns[video_idx];
      if (!time_ns) continue;
      if (IsWritten(ImagePath(i, video_idx))) {
        ++summary->num_present;
      } else {
        frame_of_time[*time_ns] = i;
      }
    }
    if (frame_of_time.empty()) return;
    const fs::path folder = output_path_ / "images" / plan_.folders[video_idx];
    fs::create_directories(folder);
    const auto decoder = OpenVideo(path, context.num_threads);
    const std::string stage = "extracting '" + plan_.folders[video_idx] + "'";
    const size_t num_images = frame_of_time.size();
    while (!frame_of_time.empty() && decoder->Next()) {
      context.ReportProgress(stage, num_images - frame_of_time.size(),
                             num_images);
      const auto found = frame_of_time.find(decoder->TimeNs());
      if (found == frame_of_time.end()) continue;
      Write(ImagePath(found->second, video_idx), decoder->ReadPixels());
      frame_of_time.erase(found);
      ++summary->num_written;
    }
    FileOperations operations;
    operations.Sync(folder);
    operations.Sync(folder.parent_path());
    operations.Sync(output_path_);
    if (!frame_of_time.empty()) {
      context.Warning("video '" + path.string() +
                      "' is damaged: " + std::to_string(frame_of_time.size()) +
                      " of " + std::to_string(num_images) +
                      " images cannot be decoded and are skipped");
    }
  }

  // One line per existing image.
  std::string Timestamps() const {
    std::string lines = "# image_name SECONDS\n";
    for (size_t v = 0; v < plan_.folders.size(); ++v) {
      for (size_t i = 0; i < plan_.frames.size(); ++i) {
        const auto& time_ns = plan_.frames[i].times_ns[v];
        if (!time_ns || !IsWritten(ImagePath(i, v))) continue;
        const double time_s = Seconds(*time_ns + plan_.offsets_ns[v]);
        lines += ImageName(i, v) + ' ' +
                 FormatDouble(time_s, std::chars_format::fixed, 6) + '\n';
      }
    }
    return lines;
  }

 private:
  std::string ImageName(size_t frame_idx, size_t video_idx) const {
    return plan_.folders[video_idx] + "/" + plan_.frames[frame_idx].name + "." +
           std::string(EnumName(*options_.image_format));
  }
  fs::path ImagePath(size_t frame_idx, size_t video_idx) const {
    return output_path_ / "images" / ImageName(frame_idx, video_idx);
  }
  void Write(const fs::path& path, const cv::Mat& image) const {
    ReplaceOneOfMany(
        path, EncodeImage(path.extension().string(), image,
                          {cv::IMWRITE_JPEG_QUALITY, options_.jpeg_quality}));
  }

  const SamplingPlan& plan_;
  const fs::path output_path_;
  const VideoSamplingOptions& options_;
};

}  // namespace

std::vector<fs::path> SplitVideoPaths(const std::string& list) {
  const std::vector<std::string> items = SplitList(list);
  if (items.empty()) {
    throw Error("video_path names no video; list one per camera");
  }
  return {items.begin(), items.end()};
}

VideoSamplingSummary SampleVideos(const std::vector<fs::path>& paths,
                                  const fs::path& output_path,
                                  const VideoSamplingOptions& options,
                                  const Context& context) {
  const Timer timer;
  const std::string settings = Settings(paths, options);
  std::optional<SamplingPlan> plan = ReadPlan(output_path, settings);
  if (!plan) {
    plan = MakePlan(paths, options, context);
    WritePlan(output_path, settings, *plan);
  }
  const Extractor extractor(*plan, output_path, options);
  VideoSamplingSummary summary;
  summary.num_frames = plan->frames.size();
  for (size_t i = 0; i < paths.size(); ++i) {
    extractor.Extract(i, paths[i], context, &summary);
  }
  ReplaceFile(output_path / "timestamps.txt", extractor.Timestamps());
  summary.seconds = timer.Seconds();
  return summary;
}

}  // namespace mgsfm
