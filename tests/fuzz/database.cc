// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/database/database.h"

#include <sqlite3.h>

#include <cmath>
#include <limits>
#include <memory>
#include <sstream>

#include "database/database_rows.h"
#include "fuzz/fuzz_target.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/models/scene_loading.h"

namespace mgsfm {
namespace {

constexpr TableLayout kLayouts[] = {TableLayout::k38, TableLayout::k312,
                                    TableLayout::k38And312};
struct Table {
  const char* name;
  int num_columns;
};
constexpr Table kTables[] = {
    {"cameras", 6},     {"images", 3},    {"keypoints", 4},
    {"descriptors", 4}, {"matches", 4},   {"two_view_geometries", 10},
    {"pose_priors", 4}, {"rigs", 3},      {"rig_sensors", 4},
    {"frames", 2},      {"frame_data", 4}};

// An empty database of small pages, as bytes.
std::string MakeEmptyDatabase(TableLayout layout) {
  const std::filesystem::path path = FuzzFolder() / "empty.db";
  std::filesystem::remove(path);
  {
    SqliteDatabase database = SqliteDatabase::Create(path.string());
    database.Execute("PRAGMA page_size = 512");
    CreateTables(layout, &database);
  }
  return ReadTextFile(path);
}

struct Closer {
  void operator()(sqlite3* db) const { sqlite3_close(db); }
  void operator()(sqlite3_stmt* row) const { sqlite3_finalize(row); }
};

// One value of a row, of any type and size.
void BindValue(ByteSource* source, int parameter, sqlite3_stmt* row) {
  switch (source->Take<uint8_t>()) {
    case 0:
      sqlite3_bind_null(row, parameter);
      break;
    case 1:
      sqlite3_bind_int64(row, parameter, source->Take<int8_t>());
      break;
    case 2:
      sqlite3_bind_int64(row, parameter, source->Take<int64_t>());
      break;
    case 3:
      sqlite3_bind_double(row, parameter, source->Take<double>());
      break;
    case 4: {
      const int64_t id1 = source->Take<uint8_t>();
      const int64_t id2 = source->Take<uint8_t>();
      sqlite3_bind_int64(row, parameter, PairId(id1, id2));
      break;
    }
    case 5: {
      const std::string text = source->TakeString(source->Take<uint8_t>());
      sqlite3_bind_text64(row, parameter, text.data(), text.size(),
                          SQLITE_TRANSIENT, SQLITE_UTF8);
      break;
    }
    default: {
      const std::string blob = source->TakeString(source->Take<uint8_t>());
      sqlite3_bind_blob64(row, parameter, blob.data(), blob.size(),
                          SQLITE_TRANSIENT);
      break;
    }
  }
}

void InsertRow(const Table& table, ByteSource* source, sqlite3* db) {
  std::string sql = std::string("INSERT INTO ") + table.name;
  if (sql == "INSERT INTO images") sql += " (image_id, name, camera_id)";
  sql += " VALUES (?";
  for (int i = 1; i < table.num_columns; ++i) sql += ", ?";
  sqlite3_stmt* statement = nullptr;
  sqlite3_prepare_v2(db, (sql + ")").c_str(), -1, &statement, nullptr);
  const std::unique_ptr<sqlite3_stmt, Closer> row(statement);
  if (!row) return;  // the layout lacks the table
  for (int i = 1; i <= table.num_columns; ++i) BindValue(source, i, row.get());
  sqlite3_step(row.get());  // rows that break a constraint are left out
}

// Changes of the schema, limited in time.
void ExecuteSql(const std::string& sql, sqlite3* db) {
  sqlite3_progress_handler(
      db, 20000, [](void*) { return 1; }, nullptr);
  sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr);
  sqlite3_progress_handler(db, 0, nullptr, nullptr);
}

// Input: layout, SQL with its length, number of rows, rows, and then bytes of
// the file to overwrite: position and value.
std::string MakeDatabase(const std::string& input, bool* is_writable) {
  static const std::vector<std::string>* const empty_databases = [] {
    auto* databases = new std::vector<std::string>;
    for (const TableLayout layout : kLayouts) {
      databases->push_back(MakeEmptyDatabase(layout));
    }
    return databases;
  }();
  ByteSource source(input);
  const auto layout = source.Take<uint8_t>();
  *is_writable = layout >= 128;
  std::string image = empty_databases->at(layout % std::size(kLayouts));
  sqlite3* opened = nullptr;
  sqlite3_open(":memory:", &opened);
  const std::unique_ptr<sqlite3, Closer> db(opened);
  auto* memory = static_cast<unsigned char*>(sqlite3_malloc64(image.size()));
  std::memcpy(memory, image.data(), image.size());
  sqlite3_deserialize(
      db.get(), "main", memory, static_cast<sqlite3_int64>(image.size()),
      static_cast<sqlite3_int64>(image.size()),
      SQLITE_DESERIALIZE_FREEONCLOSE | SQLITE_DESERIALIZE_RESIZEABLE);
  sqlite3_exec(db.get(), "BEGIN", nullptr, nullptr, nullptr);
  const std::string sql = source.TakeString(source.Take<uint8_t>());
  if (!sql.empty()) ExecuteSql(sql, db.get());
  const auto num_rows = source.Take<uint8_t>();
  for (int i = 0; i < num_rows && !source.IsEmpty(); ++i) {
    const auto table = source.Take<uint8_t>();
    InsertRow(kTables[table % std::size(kTables)], &source, db.get());
  }
  sqlite3_exec(db.get(), "COMMIT", nullptr, nullptr, nullptr);
  sqlite3_int64 size = 0;
  unsigned char* bytes = sqlite3_serialize(db.get(), "main", &size, 0);
  std::string file(reinterpret_cast<const char*>(bytes),
                   static_cast<size_t>(size));
  sqlite3_free(bytes);
  while (!source.IsEmpty() && !file.empty()) {
    const size_t position = source.Take<uint16_t>() % file.size();
    file[position] = source.Take<char>();
  }
  return file;
}

// All values as text, without loss.
class Describer {
 public:
  Describer() { text_ << std::hexfloat; }

  std::string Describe(const DatabaseContents& contents) {
    for (const Camera& camera : contents.cameras) {
      text_ << camera.id.value() << ' ' << static_cast<int>(camera.model) << ' '
            << camera.width_px << ' ' << camera.height_px << ' '
            << camera.has_prior_focal_length;
      for (const double param : camera.params) Number(param);
    }
    for (const ImageRow& image : contents.images) {
      text_ << image.id.value() << image.name << image.camera_id.value();
      for (const Eigen::Vector2f& p : image.keypoints_px) {
        Number(p.x());
        Number(p.y());
      }
    }
    for (const TwoViewGeometryRow& pair : contents.pairs) Add(pair);
    for (const RigRow& rig : contents.rigs) {
      text_ << "\nrig " << rig.id.value();
      if (rig.ref_camera_id) text_ << " of " << rig.ref_camera_id->value();
      for (const RigSensorRow& sensor : rig.sensors) {
        text_ << ' ' << sensor.camera_id.value();
        Add(sensor.sensor_from_rig);
      }
    }
    for (const FrameRow& frame : contents.frames) {
      text_ << "\nframe " << frame.id.value() << ' ' << frame.rig_id.value();
      for (const FrameDataRow& data : frame.data) {
        text_ << ' ' << data.camera_id.value() << ' ' << data.image_id.value();
      }
    }
    return text_.str();
  }

 private:
  void Number(double value) {
    FUZZ_CHECK(std::isfinite(value));
    text_ << ' ' << value;
  }
  void Add(const std::optional<Rigid3>& pose) {
    if (!pose) return;
    for (const double value : pose->rotation.coeffs()) Number(value);
    for (const double value : pose->translation) Number(value);
  }
  void Add(const TwoViewGeometryRow& pair) {
    text_ << "\npair " << pair.image_id1.value() << ' '
          << pair.image_id2.value() << ' ' << static_cast<int>(pair.config);
    for (const auto* matrix : {&pair.F, &pair.E, &pair.H}) {
      text_ << '|';
      if (!*matrix) continue;
      for (const double value : (*matrix)->reshaped()) Number(value);
    }
    Add(pair.cam2_from_cam1);
    for (const Match& match : pair.matches) {
      text_ << ' ' << match.keypoint_idx1 << ' ' << match.keypoint_idx2;
    }
  }

  std::ostringstream text_;
};

void ReadAndWriteAgain(const std::string& path) {
  DatabaseContents contents;
  if (!Accepts([&] { contents = ReadDatabase(path, {}); })) return;
  Accepts([&] {
    const LoadedScene loaded = LoadScene(contents, {}, {});
    CheckConsistent(loaded.scene);
  });
  const std::string copy = (FuzzFolder() / "copy.db").string();
  std::filesystem::remove(copy);
  // A rig whose reference is no camera cannot be written.
  if (!Accepts([&] { WriteDatabase(copy, contents, DatabaseSchema::k312); })) {
    return;
  }
  FUZZ_CHECK(Describer().Describe(ReadDatabase(copy, {})) ==
             Describer().Describe(contents));
}

// Everything that the steps before reconstruction read.
void ReadFeatures(const std::string& path) {
  Accepts([&] {
    const FeatureDatabase database(path, FeatureDatabase::OpenMode::kExisting);
    const DatabaseContents contents = database.ReadStructure({});
    for (const ImageRow& image : contents.images) {
      Accepts([&] { (void)database.ReadKeypoints(image.id); });
      Accepts([&] { (void)database.ReadDescriptors(image.id); });
    }
    Accepts([&] {
      for (const PairCount& pair : database.CountMatches()) {
        (void)database.ReadMatches(pair.image_id1, pair.image_id2);
      }
    });
    Accepts([&] {
      for (const PairCount& pair : database.CountInlierMatches()) {
        (void)database.ReadTwoViewGeometry(pair.image_id1, pair.image_id2);
      }
    });
    for (const PosePriorRow& prior : database.ReadPosePriors()) {
      FUZZ_CHECK(prior.position.allFinite());
    }
  });
}

}  // namespace

void FuzzDatabase(const std::string& input) {
  const std::string path = (FuzzFolder() / "database.db").string();
  bool is_writable = false;
  WriteTextFile(path, MakeDatabase(input, &is_writable));
  Accepts([&] { (void)ReadImageNames(path); });
  ReadAndWriteAgain(path);
  if (is_writable) ReadFeatures(path);
  for (const char* suffix : {"-journal", "-wal", "-shm"}) {
    std::filesystem::remove(path + suffix);
  }
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(database, mgsfm::FuzzDatabase)
