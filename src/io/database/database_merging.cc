// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_merging.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <system_error>
#include <tuple>

#include "base/ranges.h"
#include "base/text.h"
#include "database/database_reader.h"
#include "database/database_rows.h"
#include "database/database_shard.h"
#include "database/merged_structure.h"
#include "database/sqlite_database.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSeparate =
    "; these are not the same images: separate them by image_prefix";

// ---------------------------------------------------------------- equality

bool AreEqual(const std::vector<FeatureKeypoint>& a,
              const std::vector<FeatureKeypoint>& b) {
  return AreEqualBy(a, b, [](const FeatureKeypoint& k) {
    return std::tie(k.x_px, k.y_px, k.a11, k.a12, k.a21, k.a22);
  });
}

bool AreEqual(const DescriptorMatrix& a, const DescriptorMatrix& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() && a == b;
}

bool AreEqual(const std::vector<Match>& a, const std::vector<Match>& b) {
  return AreEqualBy(a, b, [](const Match& match) {
    return std::tie(match.keypoint_idx1, match.keypoint_idx2);
  });
}

bool AreEqual(const TwoViewGeometryRow& a, const TwoViewGeometryRow& b) {
  return a.config == b.config && a.F == b.F && a.E == b.E && a.H == b.H &&
         a.cam2_from_cam1 == b.cam2_from_cam1 && AreEqual(a.matches, b.matches);
}

bool AreEqual(const PosePriorRow& a, const PosePriorRow& b) {
  return a.coordinate_system == b.coordinate_system &&
         (a.position == b.position ||
          (!a.position.allFinite() && !b.position.allFinite())) &&
         a.covariance == b.covariance && a.gravity == b.gravity;
}

// ------------------------------------------------------------------- pairs

// Copies matches and two-view geometries. They replace rows of the result or,
// if `must_agree`, must equal them.
class PairCopier {
 public:
  // The new id of an image; nullopt for rows of a deleted image.
  using FindImage = std::function<std::optional<ImageId>(int64_t)>;

  PairCopier(FeatureDatabase* output, const Context& context)
      : output_(*output), context_(context) {}

  void Copy(const SqliteDatabase& database, const FindImage& find,
            bool must_agree) {
    CopyMatches(database, find, must_agree);
    CopyTwoViewGeometries(database, find, must_agree);
  }
  size_t num_pairs() const { return num_pairs_; }

 private:
  static std::string NameOf(int64_t id1, int64_t id2) {
    return "image " + std::to_string(id1) + " and image " + std::to_string(id2);
  }
  [[noreturn]] static void ThrowDifferent(const SqliteDatabase& database,
                                          const char* what, int64_t id1,
                                          int64_t id2) {
    ThrowDatabaseError(database.path(),
                       std::string(what) + " of " + NameOf(id1, id2) +
                           " differs from that of another input; match all "
                           "shards with the same options, or leave one out");
  }
  void CopyMatches(const SqliteDatabase& database, const FindImage& find,
                   bool must_agree);
  void CopyTwoViewGeometries(const SqliteDatabase& database,
                             const FindImage& find, bool must_agree);

  FeatureDatabase& output_;
  const Context& context_;
  size_t num_pairs_ = 0;
};

void PairCopier::CopyMatches(const SqliteDatabase& database,
                             const FindImage& find, bool must_agree) {
  if (!database.HasTable("matches")) return;
  SqliteStatement row = database.Prepare(
      "SELECT pair_id, rows, cols, data FROM matches ORDER BY pair_id");
  while (row.Step()) {
    context_.CheckInterrupted();
    const int64_t id1 = row.Int(0) / kMaxNumIds, id2 = row.Int(0) % kMaxNumIds;
    const auto new_id1 = find(id1), new_id2 = find(id2);
    if (!new_id1 || !new_id2) continue;
    const std::vector<Match> matches = DecodeMatches(row, NameOf(id1, id2));
    if (!must_agree || !output_.HasMatches(*new_id1, *new_id2)) {
      output_.WriteMatches(*new_id1, *new_id2, matches);
    } else if (!AreEqual(output_.ReadMatches(*new_id1, *new_id2), matches)) {
      ThrowDifferent(database, "the list of matches", id1, id2);
    }
  }
}

void PairCopier::CopyTwoViewGeometries(const SqliteDatabase& database,
                                       const FindImage& find, bool must_agree) {
  const std::string table = database.HasTable("two_view_geometries")
                                ? "two_view_geometries"
                                : "inlier_matches";
  SqliteStatement row = database.Prepare(TwoViewGeometryQuery(database, table) +
                                         " ORDER BY pair_id");
  while (row.Step()) {
    context_.CheckInterrupted();
    const int64_t id1 = row.Int(0) / kMaxNumIds, id2 = row.Int(0) % kMaxNumIds;
    const auto new_id1 = find(id1), new_id2 = find(id2);
    if (!new_id1 || !new_id2) continue;
    TwoViewGeometryRow pair{*new_id1, *new_id2};
    DecodeTwoViewGeometry(row, NameOf(id1, id2), &pair);
    // Keeps the order of the output, because swapping twice changes the last
    // bits.
    if (pair.image_id2 < pair.image_id1) SwapImages(&pair);
    const auto present =
        must_agree ? output_.ReadTwoViewGeometry(pair.image_id1, pair.image_id2)
                   : std::nullopt;
    if (!present) {
      output_.WriteTwoViewGeometry(pair);
      ++num_pairs_;
    } else if (!AreEqual(*present, pair)) {
      ThrowDifferent(database, "the two-view geometry", id1, id2);
    }
  }
}

// --------------------------------------------------------- whole databases

// Copies the rows of databases whose structures are merged.
class DatabaseCopier {
 public:
  DatabaseCopier(const MergedStructure& structure, FeatureDatabase* output,
                 const Context& context)
      : structure_(structure),
        output_(*output),
        context_(context),
        pairs_(output, context) {
    for (const Camera& camera : structure.cameras) output_.AddCamera(camera);
    for (const ImageRow& image : structure.images) {
      output_.AddImage(image.name, image.camera_id);
    }
    output_.WriteRigsAndFrames(structure.rigs, structure.frames);
  }

  void Copy(size_t input, const std::string& path) {
    const SqliteSnapshot snapshot(path);
    database_ = &snapshot.database();
    positions_ = &structure_.image_positions[input];
    CopyFeatures();
    pairs_.Copy(
        *database_,
        [&](int64_t id) -> std::optional<ImageId> {
          const ImageRow* image = Find(id);
          if (image == nullptr) return std::nullopt;
          return image->id;
        },
        structure_.has_common_images);
    CopyPriors();
    snapshot.CheckUnchanged();
  }

  DatabaseMergeSummary Summary() const {
    return {structure_.images.size(), pairs_.num_pairs(),
            structure_.rigs.size()};
  }

 private:
  // Copies a table with a row per image.
  template <class Decode, class Values>
  void CopyTable(const char* table, const Decode& decode,
                 bool (FeatureDatabase::*has)(ImageId) const,
                 Values (FeatureDatabase::*read)(ImageId) const,
                 void (FeatureDatabase::*write)(ImageId, const Values&));
  void CopyFeatures();
  void CopyPriors();
  // nullptr for rows of a deleted image.
  const ImageRow* Find(int64_t id) const {
    const auto found = positions_->find(id);
    return found == positions_->end() ? nullptr
                                      : &structure_.images[found->second];
  }
  [[noreturn]] void ThrowDifferent(const std::string& what,
                                   const ImageRow& image) const {
    ThrowDatabaseError(database_->path(),
                       what + " of image '" + image.name +
                           "' differ from those of another input" + kSeparate);
  }

  const MergedStructure& structure_;
  FeatureDatabase& output_;
  const Context& context_;
  PairCopier pairs_;
  const SqliteDatabase* database_ = nullptr;
  const std::unordered_map<int64_t, size_t>* positions_ = nullptr;
  std::map<ImageId, PosePriorRow> priors_;  // of images in several inputs
};

template <class Decode, class Values>
void DatabaseCopier::CopyTable(const char* table, const Decode& decode,
                               bool (FeatureDatabase::*has)(ImageId) const,
                               Values (FeatureDatabase::*read)(ImageId) const,
                               void (FeatureDatabase::*write)(ImageId,
                                                              const Values&)) {
  if (!database_->HasTable(table)) return;
  SqliteStatement row =
      database_->Prepare("SELECT image_id, rows, cols, data FROM " +
                         std::string(table) + " ORDER BY image_id");
  while (row.Step()) {
    context_.CheckInterrupted();
    const ImageRow* image = Find(row.Int(0));
    if (image == nullptr) continue;
    const Values values = decode(row, "image '" + image->name + "'");
    if (!structure_.has_common_images || !(output_.*has)(image->id)) {
      (output_.*write)(image->id, values);
    } else if (!AreEqual((output_.*read)(image->id), values)) {
      ThrowDifferent(std::string("the ") + table, *image);
    }
  }
}

void DatabaseCopier::CopyFeatures() {
  CopyTable(
      "keypoints",
      [](const SqliteStatement& row, const std::string& image) {
        return MakeFeatureKeypoints(
            DecodeKeypoints(row, "the keypoints of " + image));
      },
      &FeatureDatabase::HasKeypoints, &FeatureDatabase::ReadKeypoints,
      &FeatureDatabase::WriteKeypoints);
  CopyTable("descriptors", DecodeDescriptors, &FeatureDatabase::HasDescriptors,
            &FeatureDatabase::ReadDescriptors,
            &FeatureDatabase::WriteDescriptors);
}

void DatabaseCopier::CopyPriors() {
  for (PosePriorRow& prior : ReadPosePriorRows(*database_)) {
    const ImageRow* image = Find(prior.image_id.value());
    const bool is_empty = !prior.position.allFinite() && !prior.gravity;
    if (image == nullptr || is_empty) continue;
    prior.image_id = image->id;
    if (structure_.has_common_images) {
      const auto [other, is_new] = priors_.emplace(image->id, prior);
      if (!is_new && !AreEqual(other->second, prior)) {
        ThrowDifferent("the pose priors", *image);
      }
    }
    output_.WritePosePrior(prior);
  }
}

// ------------------------------------------------------------------ inputs

struct Input {
  MergeInput given;
  std::optional<ShardManifest> manifest;

  bool HasMatchesOnly() const {
    return manifest && manifest->kind == ShardKind::kMatches;
  }
};

std::vector<Input> ReadManifests(const std::vector<MergeInput>& given) {
  std::vector<Input> inputs;
  std::map<fs::path, MergeInput> by_file;
  for (const MergeInput& input : given) {
    const SqliteSnapshot snapshot(input.path);
    const auto [other, is_new] =
        by_file.emplace(fs::canonical(input.path), input);
    if (!is_new && other->second.prefix == input.prefix &&
        other->second.vehicle == input.vehicle) {
      continue;
    }
    if (const auto problem = WhyUnusable(input.prefix)) {
      throw Error("the prefix of images of '" + input.path + "' " + *problem);
    }
    inputs.push_back({input, ReadShardManifest(snapshot.database())});
  }
  return inputs;
}

// Throws Error unless all shards of each run exist and are complete.
void CheckShards(const std::vector<Input>& inputs) {
  using Run = std::tuple<ShardKind, std::string, int, std::string>;
  std::map<Run, std::map<int, std::string>> paths_of_run;
  for (const Input& input : inputs) {
    if (!input.manifest) continue;
    const ShardManifest& manifest = *input.manifest;
    if (!manifest.is_complete) {
      ThrowDatabaseError(input.given.path,
                         "share " + manifest.share.ToString() +
                             " is unfinished; run its command again");
    }
    paths_of_run[{manifest.kind, manifest.fingerprint, manifest.share.count,
                  input.given.prefix}]
        .emplace(manifest.share.number, input.given.path);
  }
  for (const auto& [run, path_of_share] : paths_of_run) {
    const int count = std::get<2>(run);
    for (int number = 1; number <= count; ++number) {
      if (path_of_share.count(number) > 0) continue;
      ThrowDatabaseError(
          path_of_share.begin()->second,
          "is one of " + std::to_string(count) + " shards, of which share " +
              Share{number, count}.ToString() +
              " with the same images and options is missing; merge all of "
              "them, made with the same options");
    }
  }
}

// Removes an unfinished file.
class PartialFile {
 public:
  explicit PartialFile(const std::string& target) {
    const fs::path path(target);
    path_ =
        (path.parent_path() / ("." + path.filename().string() + ".mgsfm_merge"))
            .string();
    Remove();
  }
  ~PartialFile() { Remove(); }
  PartialFile(const PartialFile&) = delete;
  PartialFile& operator=(const PartialFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  void Remove() const {
    std::error_code ignored;
    for (const char* side : {"", "-journal"}) fs::remove(path_ + side, ignored);
  }
  std::string path_;
};

// Warns of databases without rigs beside one with rigs: the folders of their
// images would have formed rigs, but count no longer.
void WarnOfLostRigs(const std::vector<StructureInput>& inputs,
                    const MergedStructure& merged, const Context& context) {
  const auto with_rigs = std::find_if(
      inputs.begin(), inputs.end(),
      [](const StructureInput& input) { return input.contents.HasRigs(); });
  if (with_rigs == inputs.end()) return;
  std::set<ImageId> images_of_rigs;
  for (const FrameRow& frame : merged.frames) {
    if (frame.data.size() < 2) continue;
    for (const auto& data : frame.data) images_of_rigs.insert(data.image_id);
  }
  for (size_t i = 0; i < inputs.size(); ++i) {
    if (inputs[i].contents.HasRigs()) continue;
    const auto& positions = merged.image_positions[i];
    const auto num_single = CountIf(positions, [&](const auto& position) {
      return images_of_rigs.count(merged.images[position.second].id) == 0;
    });
    if (num_single == 0) continue;
    context.Warning("database '" + inputs[i].path + "' has no rigs, but '" +
                    with_rigs->path + "' has: " + std::to_string(num_single) +
                    " of its images are single in the merged database, even "
                    "if their folders form rigs; run rig_configurator on it "
                    "before merging");
  }
}

DatabaseMergeSummary MergeFeatures(const std::vector<Input>& inputs,
                                   const std::string& output_path,
                                   const Context& context) {
  std::vector<StructureInput> structures;
  for (const Input& input : inputs) {
    const SqliteSnapshot snapshot(input.given.path);
    structures.push_back({input.given,
                          ReadStructure(snapshot.database(), context),
                          ReadShardCameras(snapshot.database())});
  }
  const MergedStructure structure = MergeStructures(structures);
  if (structure.images.empty()) {
    throw Error(
        "there are no images to merge; the extractor gives the reasons");
  }
  WarnOfLostRigs(structures, structure, context);
  FeatureDatabase output(output_path, FeatureDatabase::OpenMode::kOrCreate);
  DatabaseTransaction transaction(&output);
  DatabaseCopier copier(structure, &output, context);
  for (size_t i = 0; i < inputs.size(); ++i) {
    context.ReportProgress("merging", i, inputs.size());
    copier.Copy(i, inputs[i].given.path);
  }
  transaction.Commit();
  return copier.Summary();
}

// The only input that is not a shard with matches.
const Input& FindMatched(const std::vector<Input>& inputs) {
  const Input* matched = nullptr;
  for (const Input& input : inputs) {
    if (!input.given.prefix.empty() || !input.given.vehicle.empty()) {
      throw Error(
          "shards with matches take neither prefixes nor vehicles; "
          "set them when the features are merged");
    }
    if (input.HasMatchesOnly()) continue;
    if (matched != nullptr || input.manifest) {
      ThrowDatabaseError(input.given.path,
                         "cannot be merged together with shards of matches; "
                         "merge the features first, and then the matches "
                         "with that one database");
    }
    matched = &input;
  }
  if (matched == nullptr) {
    throw Error(
        "there are only shards with matches; add the database from "
        "which they were matched");
  }
  return *matched;
}

void CopyFile(const std::string& from, const std::string& to) {
  std::error_code error;
  for (const char* side : {"-wal", "-journal"}) {
    const auto size = fs::file_size(from + side, error);
    if (!error && size > 0) {
      ThrowDatabaseError(from, "has unfinished changes in '" + from + side +
                                   "'; open it once with its program");
    }
  }
  fs::copy_file(from, to, error);
  if (error) {
    ThrowDatabaseError(to, "cannot be written: " + error.message());
  }
}

DatabaseMergeSummary MergeMatches(const std::vector<Input>& inputs,
                                  const std::string& output_path,
                                  const Context& context) {
  const std::string& matched_path = FindMatched(inputs).given.path;
  const FeatureDatabase matched(matched_path,
                                FeatureDatabase::OpenMode::kReadOnly);
  const std::string fingerprint = FingerprintOfStructure(matched, context);
  CopyFile(matched_path, output_path);
  matched.CheckUnchanged();
  FeatureDatabase output(output_path, FeatureDatabase::OpenMode::kExisting);
  DatabaseTransaction transaction(&output);
  PairCopier copier(&output, context);
  size_t num_done = 0;
  std::set<int> copied;  // shares
  for (const Input& input : inputs) {
    context.ReportProgress("merging", num_done++, inputs.size());
    if (!input.HasMatchesOnly()) continue;
    const std::string& run = input.manifest->fingerprint;
    if (run.compare(0, fingerprint.size(), fingerprint) != 0) {
      ThrowDatabaseError(input.given.path,
                         "was not matched from '" + matched_path +
                             "' as it is now; match it again");
    }
    const SqliteSnapshot snapshot(input.given.path);
    copier.Copy(
        snapshot.database(),
        [](int64_t id) { return ImageId(static_cast<uint32_t>(id)); },
        !copied.insert(input.manifest->share.number).second);
    snapshot.CheckUnchanged();
  }
  transaction.Commit();
  const DatabaseContents contents = output.ReadStructure(context);
  return {contents.images.size(), copier.num_pairs(), contents.rigs.size()};
}

}  // namespace

DatabaseMergeSummary MergeDatabases(const std::vector<MergeInput>& given,
                                    const std::string& merged_path,
                                    const Context& context) {
  if (fs::exists(merged_path)) {
    ThrowDatabaseError(merged_path, "exists already; choose another name");
  }
  const std::vector<Input> inputs = ReadManifests(given);
  CheckShards(inputs);
  const bool has_match_shards =
      AnyOf(inputs, [](const Input& input) { return input.HasMatchesOnly(); });
  const PartialFile partial(merged_path);
  const DatabaseMergeSummary summary =
      has_match_shards ? MergeMatches(inputs, partial.path(), context)
                       : MergeFeatures(inputs, partial.path(), context);
  // SQLite has synced the file; its name must last, too.
  FileOperations operations;
  operations.Rename(partial.path(), merged_path);
  operations.Sync(fs::absolute(merged_path).parent_path());
  return summary;
}

}  // namespace mgsfm
