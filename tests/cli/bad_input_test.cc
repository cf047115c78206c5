// SPDX-License-Identifier: BSD-3-Clause
// Answers of the mapper to input that it cannot use, and to places where it
// cannot write: one line, exit code 1, and everything stays as it was.
#include <sqlite3.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "cli/program_runs.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Matcher;

constexpr const char* kMatchAgain = "match the images again";
constexpr const char* kExtractAgain = "extract the features again";
// The image whose row is damaged.
constexpr const char* kOfImage = " WHERE name = 'cam0/000001.png'";

// A database to be changed in any way.
class OpenDatabase {
 public:
  explicit OpenDatabase(const std::string& path) {
    MGSFM_CHECK(sqlite3_open(path.c_str(), &db_) == SQLITE_OK);
  }
  ~OpenDatabase() { sqlite3_close(db_); }
  OpenDatabase(const OpenDatabase&) = delete;
  OpenDatabase& operator=(const OpenDatabase&) = delete;

  void Execute(const std::string& sql) {
    char* error = nullptr;
    const int result = sqlite3_exec(db_, sql.c_str(), nullptr, nullptr, &error);
    MGSFM_CHECK_MSG(result == SQLITE_OK, error);
  }

  // Changes the blob in the first row of a table that has a long one.
  void Edit(const std::string& table, const std::string& column,
            const std::function<void(std::string*)>& edit) {
    sqlite3_stmt* row = nullptr;
    const std::string select = "SELECT rowid, " + column + " FROM " + table +
                               " WHERE length(" + column +
                               ") >= 16 ORDER BY rowid LIMIT 1";
    MGSFM_CHECK(sqlite3_prepare_v2(db_, select.c_str(), -1, &row, nullptr) ==
                SQLITE_OK);
    MGSFM_CHECK(sqlite3_step(row) == SQLITE_ROW);
    const int64_t rowid = sqlite3_column_int64(row, 0);
    std::string blob(static_cast<const char*>(sqlite3_column_blob(row, 1)),
                     static_cast<size_t>(sqlite3_column_bytes(row, 1)));
    sqlite3_finalize(row);
    edit(&blob);
    const std::string update =
        "UPDATE " + table + " SET " + column + " = ?1 WHERE rowid = ?2";
    MGSFM_CHECK(sqlite3_prepare_v2(db_, update.c_str(), -1, &row, nullptr) ==
                SQLITE_OK);
    sqlite3_bind_blob(row, 1, blob.data(), static_cast<int>(blob.size()),
                      SQLITE_TRANSIENT);
    sqlite3_bind_int64(row, 2, rowid);
    MGSFM_CHECK(sqlite3_step(row) == SQLITE_DONE);
    sqlite3_finalize(row);
  }

 private:
  sqlite3* db_ = nullptr;
};

template <class T>
void Overwrite(std::string* blob, size_t position, T value) {
  std::memcpy(blob->data() + position, &value, sizeof(value));
}

// A copy of a good database and an earlier model, in a folder of their own.
class BadInput : public testing::Test {
 protected:
  BadInput() {
    Restore();
    fs::create_directories(Out() + "/0");
    WriteTextFile(Out() + "/0/images.bin", "earlier");
    WriteTextFile(Out() + "/report.json", "earlier");
  }

  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Database() const { return Path("in.db"); }
  std::string Out() const { return Path("out"); }
  void Restore() const {
    fs::copy_file(DemoDatabase(), Database(),
                  fs::copy_options::overwrite_existing);
  }
  std::string MapperCall(const std::string& database,
                         const std::string& output) const {
    return "mapper --database_path '" + database + "' --output_path '" +
           output + "' ";
  }
  CommandOutput Map(const std::string& more_flags = "") const {
    return RunMgsfm(MapperCall(Database(), Out()) + more_flags);
  }

  // One line that names `what` and the remedy, and no file has changed.
  void ExpectRefused(const std::string& arguments,
                     const Matcher<std::string>& message) const {
    const Files before = FilesIn(dir_.path());
    const CommandOutput output = RunMgsfm(arguments);
    EXPECT_EQ(output.exit_code, 1) << output.err;
    EXPECT_THAT(output.out, IsEmpty());
    EXPECT_THAT(LastWord(output), message) << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before) << output.err;
  }
  // The same of the database, which the message names as well.
  void ExpectDatabaseRefused(const std::string& message,
                             const std::string& remedy) const {
    ExpectRefused(
        MapperCall(Database(), Out()),
        AllOf(HasSubstr(Database()), HasSubstr(message), HasSubstr(remedy)));
  }

  // Makes one change to a copy of the good database.
  void ExpectRefusedAfter(const std::string& sql, const std::string& message,
                          const std::string& remedy) const {
    Restore();
    OpenDatabase(Database()).Execute(sql);
    ExpectDatabaseRefused(message, remedy);
  }
  void ExpectRefusedAfterEdit(const std::string& table,
                              const std::string& column,
                              const std::function<void(std::string*)>& edit,
                              const std::string& message,
                              const std::string& remedy) const {
    Restore();
    OpenDatabase(Database()).Edit(table, column, edit);
    ExpectDatabaseRefused(message, remedy);
  }
  // The values are too short, too long, and a single byte.
  void ExpectLengthsRefused(const std::string& table, const std::string& column,
                            const std::string& message,
                            const std::string& remedy) const {
    const auto shorten = [](std::string* blob) { blob->pop_back(); };
    const auto lengthen = [](std::string* blob) { blob->append(8, '\0'); };
    const auto empty = [](std::string* blob) { blob->resize(1); };
    ExpectRefusedAfterEdit(table, column, shorten, message, remedy);
    ExpectRefusedAfterEdit(table, column, lengthen, message, remedy);
    ExpectRefusedAfterEdit(table, column, empty, message, remedy);
  }

  const TempDir dir_;
};

// ----------------------------------------------------- the file as a whole

TEST_F(BadInput, TheGoodDatabaseIsAccepted) {
  const Files before = FilesIn(dir_.path());
  EXPECT_EQ(Map().exit_code, 0);
  EXPECT_EQ(ReadTextFile(Database()), before.at(Database()));
}

TEST_F(BadInput, NoSuchFile) {
  ExpectRefused(MapperCall(Path("none.db"), Out()),
                AllOf(HasSubstr(Path("none.db")), HasSubstr("no such file"),
                      HasSubstr("check the path")));
}

TEST_F(BadInput, AFolderInPlaceOfTheFile) {
  ExpectRefused(MapperCall(dir_.path().string(), Out()),
                AllOf(HasSubstr("is not a file"), HasSubstr("give")));
}

TEST_F(BadInput, NotADatabase) {
  for (const std::string& text :
       {std::string(), std::string("SQLite"), std::string(5000, 'x'),
        std::string(200, '\0')}) {
    WriteTextFile(Database(), text);
    ExpectDatabaseRefused("is not an SQLite database", "feature extractor");
  }
}

TEST_F(BadInput, ADatabaseOfSomethingElse) {
  fs::remove(Database());
  OpenDatabase(Database()).Execute("CREATE TABLE addresses(name TEXT)");
  ExpectDatabaseRefused("no table 'cameras'", "feature extractor");
}

TEST_F(BadInput, TablesWithOtherColumns) {
  ExpectRefusedAfter("ALTER TABLE images RENAME COLUMN name TO title",
                     "no such column: name", "COLMAP");
}

TEST_F(BadInput, ADatabaseWithoutVerifiedMatches) {
  ExpectRefusedAfter("DROP TABLE two_view_geometries", "two_view_geometries",
                     "match its images");
}

TEST_F(BadInput, ADatabaseWithoutImages) {
  ExpectRefusedAfter("DELETE FROM images", "has no images",
                     "run the feature extractor");
}

TEST_F(BadInput, TruncatedDatabase) {
  const std::string whole = ReadTextFile(Database());
  for (const size_t size :
       {size_t{16}, size_t{50}, size_t{100}, size_t{101}, size_t{1000},
        size_t{4096}, whole.size() / 3, whole.size() / 2, whole.size() - 4096,
        whole.size() - 1}) {
    WriteTextFile(Database(), whole.substr(0, size));
    ExpectDatabaseRefused("is truncated", "copy it again");
  }
}

// Whichever page it is, SQLite or the checks of the rows notice, or it holds
// nothing that is read.
TEST_F(BadInput, OverwrittenPages) {
  const std::string whole = ReadTextFile(Database());
  int num_refused = 0;
  constexpr int kNumPlaces = 8;
  for (size_t k = 0; k < kNumPlaces; ++k) {
    std::string damaged = whole;
    const size_t page = whole.size() / 4096 * k / kNumPlaces;
    damaged.replace(std::max<size_t>(100, page * 4096), 3000, 3000, '\xd7');
    WriteTextFile(Database(), damaged);
    const Files before = FilesIn(dir_.path());
    const CommandOutput output = Map();
    if (output.exit_code == 1) {
      ++num_refused;
      EXPECT_THAT(LastWord(output), HasSubstr(Database()));
      EXPECT_TRUE(FilesIn(dir_.path()) == before);
    } else {
      EXPECT_EQ(output.exit_code, 0) << output.err;
    }
    EXPECT_EQ(ReadTextFile(Database()), damaged);
  }
  EXPECT_GE(num_refused, 2);
}

// ------------------------------------------------------------------- rows

TEST_F(BadInput, KeypointsOfTheWrongLength) {
  ExpectLengthsRefused("keypoints", "data", "the keypoints of image 'cam0/",
                       kExtractAgain);
  ExpectRefusedAfter(
      "UPDATE keypoints SET cols = 5 WHERE image_id = (SELECT min(image_id) "
      "FROM images)",
      "the keypoints of image 'cam0/", kExtractAgain);
  ExpectRefusedAfter(
      "UPDATE keypoints SET rows = -3 WHERE image_id = (SELECT min(image_id) "
      "FROM images)",
      "the keypoints of image 'cam0/", kExtractAgain);
}

TEST_F(BadInput, KeypointsThatAreNotFinite) {
  for (const float value : {std::nanf(""), -HUGE_VALF}) {
    ExpectRefusedAfterEdit(
        "keypoints", "data",
        [value](std::string* blob) { Overwrite(blob, 4, value); },
        "image 'cam0/000000.png' has a keypoint that is not finite",
        kExtractAgain);
  }
}

TEST_F(BadInput, VerifiedMatchesOfTheWrongLength) {
  ExpectLengthsRefused("two_view_geometries", "data",
                       "the matches of the pair of images", kMatchAgain);
  ExpectRefusedAfter("UPDATE two_view_geometries SET cols = 3 WHERE rows > 0",
                     "the matches of the pair", kMatchAgain);
}

TEST_F(BadInput, MatchesWithKeypointsThatDoNotExist) {
  for (const uint32_t index : {1000000u, ~0u}) {
    ExpectRefusedAfterEdit(
        "two_view_geometries", "data",
        [index](std::string* blob) { Overwrite(blob, 4, index); },
        "'cam0/000000.png'", kMatchAgain);
  }
  ExpectRefusedAfter(
      "DELETE FROM keypoints WHERE image_id = (SELECT min(image_id) FROM "
      "images)",
      "'cam0/000000.png'", kMatchAgain);
}

TEST_F(BadInput, MatchesBeforeVerification) {
  ExpectLengthsRefused("matches", "data", "the matches of the pair of images",
                       kMatchAgain);
  ExpectRefusedAfterEdit(
      "matches", "data",
      [](std::string* blob) {
        Overwrite(blob, 0, ~0u);
        Overwrite(blob, 4, ~0u);
      },
      "'cam0/000000.png'", kMatchAgain);
}

TEST_F(BadInput, MatricesAndPosesOfTheWrongLength) {
  for (const std::string column : {"F", "E", "H"}) {
    ExpectRefusedAfter("UPDATE two_view_geometries SET " + column +
                           " = zeroblob(71) WHERE rows > 0",
                       "the matrix " + column + " of the pair", kMatchAgain);
  }
  for (const std::string column : {"qvec", "tvec"}) {
    ExpectRefusedAfter("UPDATE two_view_geometries SET " + column +
                           " = zeroblob(40) WHERE rows > 0",
                       "the relative pose of the pair", kMatchAgain);
  }
}

TEST_F(BadInput, PairsThatCannotBe) {
  const auto set_pair_id = [](const std::string& id) {
    return "UPDATE two_view_geometries SET pair_id = " + id +
           " WHERE pair_id = (SELECT max(pair_id) FROM two_view_geometries)";
  };
  for (const std::string id :
       {"-1", "-9223372036854775808", "9223372036854775807", "0", "5"}) {
    ExpectRefusedAfter(set_pair_id(id), "does not exist", kMatchAgain);
  }
  // 2147483647 times the smaller id plus the larger one.
  ExpectRefusedAfter(set_pair_id("2147483647 * 3 + 3"), "invalid pair id",
                     kMatchAgain);
  ExpectRefusedAfter(set_pair_id("2147483647 * 4 + 3"), "invalid pair id",
                     kMatchAgain);
  ExpectRefusedAfter(set_pair_id("2147483647 * 3 + 100000"), "100000",
                     kMatchAgain);
  ExpectRefusedAfter("UPDATE two_view_geometries SET config = 99",
                     "unknown configuration 99", kMatchAgain);
}

TEST_F(BadInput, PairsOfADeletedImage) {
  ExpectRefusedAfter(std::string("DELETE FROM images") + kOfImage,
                     "names an image that does not exist", kMatchAgain);
}

TEST_F(BadInput, UnknownCameraModel) {
  for (const std::string model :
       {"99", "-1", "-9223372036854775808", "9223372036854775807"}) {
    ExpectRefusedAfter("UPDATE cameras SET model = " + model,
                       "has the unknown camera model " + model, kExtractAgain);
  }
}

TEST_F(BadInput, CameraParametersThatCannotBe) {
  ExpectLengthsRefused("cameras", "params", "bytes of parameters, but",
                       kExtractAgain);
  for (const double value : {std::nan(""), HUGE_VAL}) {
    ExpectRefusedAfterEdit(
        "cameras", "params",
        [value](std::string* blob) { Overwrite(blob, 8, value); },
        "has a parameter that is not finite", kExtractAgain);
  }
  for (const std::string width : {"0", "-5", "9223372036854775807"}) {
    ExpectRefusedAfter("UPDATE cameras SET width = " + width,
                       "has the image size " + width, kExtractAgain);
  }
}

TEST_F(BadInput, ImagesThatCannotBe) {
  ExpectRefusedAfter(
      std::string("UPDATE images SET camera_id = 7777") + kOfImage,
      "'cam0/000001.png' has the camera 7777, which does not exist",
      kExtractAgain);
  ExpectRefusedAfter(std::string("UPDATE images SET name = ''") + kOfImage,
                     "'' has no name", kExtractAgain);
}

TEST_F(BadInput, NamesWithControlCharacters) {
  ExpectRefusedAfter(std::string("UPDATE images SET name = 'cam0/' || "
                                 "char(10, 13, 27) || 'x.png'") +
                         kOfImage,
                     "'cam0/   x.png' has a control character", kExtractAgain);
}

// Refused before the reconstruction, not when its result is written.
TEST_F(BadInput, NamesThatTextCannotHold) {
  OpenDatabase(Database())
      .Execute("UPDATE images SET name = 'cam0/a b.png'" +
               std::string(kOfImage));
  ExpectRefused(MapperCall(Database(), Out()) + "--output_format txt",
                AllOf(HasSubstr("'cam0/a b.png' has a blank"),
                      HasSubstr("write the model as binary")));
  EXPECT_THAT(Map("--output_format txt").err, Not(HasSubstr("registered")));
  EXPECT_EQ(Map().exit_code, 0);
}

// A rule that an engine with backtracking would never finish.
TEST_F(BadInput, LongNamesAndNestedRepetition) {
  OpenDatabase(Database())
      .Execute("UPDATE images SET name = name || '/' || hex(zeroblob(2000))");
  ExpectRefused(MapperCall(Database(), Out()) +
                    "--rig_name_rule '(?<camera>cam.)(?<frame>((0+)+)+)x'",
                AllOf(HasSubstr("rig_name_rule"), HasSubstr("does not match")));
  OpenDatabase(Database())
      .Execute("UPDATE images SET name = hex(zeroblob(25000)) || image_id");
  ExpectDatabaseRefused("is longer than 4096 bytes", "");
}

TEST_F(BadInput, PathsMustBeUsable) {
  ExpectRefused(MapperCall(Path("a\xff.db"), Out()),
                HasSubstr("option database_path: "));
}

// A disk that fails is not taken for the end of the file.
TEST_F(BadInput, FilesThatCannotBeReadToTheEnd) {
  for (const char* option :
       {"image_list_path", "image_timestamps_path", "gravity_path",
        "ref_images_path", "rig_config_path", "config_path"}) {
    ExpectRefused(
        MapperCall(Database(), Out()) + "--" + option + " /proc/self/mem",
        AllOf(HasSubstr("/proc/self/mem"), HasSubstr("Input/output error")));
  }
}

TEST_F(BadInput, DevicesWithoutEnd) {
  for (const char* option : {"image_list_path", "image_timestamps_path",
                             "gravity_path", "config_path"}) {
    ExpectRefused(MapperCall(Database(), Out()) + "--" + option + " /dev/zero",
                  AllOf(HasSubstr("/dev/zero"), HasSubstr("is a device")));
  }
}

// A file of another kind may be one line of any length.
TEST_F(BadInput, LongLinesAreQuotedInPart) {
  const std::string list = Path("list.txt");
  std::string line;
  for (int i = 0; i < 200'000; ++i) line += "1 ";
  WriteTextFile(list, line);
  for (const char* option :
       {"image_timestamps_path", "gravity_path", "config_path"}) {
    const CommandOutput output =
        RunMgsfm(MapperCall(Database(), Out()) + "--" + option + " " + list);
    EXPECT_EQ(output.exit_code, 1) << option;
    EXPECT_THAT(LastWord(output), HasSubstr(list));
    EXPECT_LT(output.err.size(), 10'000u) << option;
  }
}

// ------------------------------------------------------ rig configurations

TEST_F(BadInput, RigConfigurations) {
  const std::string config = Path("rig.json");
  const std::string call =
      MapperCall(Database(), Out()) + "--rig_config_path " + config;
  ExpectRefused(call, AllOf(HasSubstr(config), HasSubstr("check the path")));
  const std::pair<const char*, const char*> cases[] = {
      {"", "not valid JSON"},
      {"[{\"cameras\": [", "not valid JSON"},
      {"[{\"cameras\":\n[\n{\"image_prefix\":\n ]", "not valid JSON"},
      {"{}", "not an array of rigs"},
      {"[1]", "rig 1 is not an object"},
      {"[{\"cameras\": []}]", "needs 'cameras'"},
      {"[{\"cameras\": [{\"ref_sensor\": true}]}]", "needs 'image_prefix'"},
      {"[{\"cameras\": [{\"image_prefix\": \"cam0/\"}]}]", "ref_sensor"},
      {"[{\"cameras\": [{\"image_prefix\": \"left/\", \"ref_sensor\": true}]}]",
       "no image of database"},
      {"[{\"cameras\": [{\"image_prefix\": \"cam0/\", \"ref_sensor\": true}, "
       "{\"image_prefix\": \"right/\"}]}]",
       "'right/'"},
      {"[{\"cameras\": [{\"image_prefix\": \"cam\", \"ref_sensor\": true}, "
       "{\"image_prefix\": \"cam1/\"}]}]",
       "fits both"},
      {"[{\"cameras\": [{\"image_prefix\": \"cam0/\", \"ref_sensor\": true, "
       "\"camera_model_name\": \"ROUND\", \"camera_params\": [1]}]}]",
       "unknown camera model 'ROUND'"}};
  for (const auto& [text, message] : cases) {
    WriteTextFile(config, text);
    ExpectRefused(call, AllOf(HasSubstr(config), HasSubstr(message)));
  }
}

// ------------------------------------------------------------------ output

TEST_F(BadInput, OutputBelowAFile) {
  ExpectRefused(MapperCall(Database(), Database() + "/out"),
                AllOf(HasSubstr(Database() + "/out"), HasSubstr("path")));
  ExpectRefused(MapperCall(Database(), Database()),
                AllOf(HasSubstr(Database()), HasSubstr("not a folder")));
}

// These paths are not writable even for root.
TEST_F(BadInput, OutputWhereNothingCanBeWritten) {
  ExpectRefused(
      MapperCall(Database(), "/proc/mgsfm_out"),
      AllOf(HasSubstr("/proc/mgsfm_out"), HasSubstr("choose another path")));
}

TEST_F(BadInput, FilesLargerThanTheLimit) {
  for (const char* limit : {"0", "1", "100"}) {
    const Files before = FilesIn(dir_.path());
    // The log may not be limited with the output.
    const CommandOutput output =
        RunShell("(ulimit -f " + std::string(limit) +
                 "; " MGSFM_EXECUTABLE " " + MapperCall(Database(), Out()) +
                 " 2>&1) | cat >&2; exit "
                 "1");
    EXPECT_THAT(LastWord(output),
                AllOf(HasSubstr("File too large"), HasSubstr("free some")))
        << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before);
  }
}

// In a name space of their own, where a user may mount what disappears with it.
class Mounted : public BadInput {
 protected:
  void SetUp() override {
    fs::create_directory(Path("mnt"));
    if (RunMounted("tmpfs -o size=64k", "true").exit_code != 0) {
      GTEST_SKIP() << "file systems cannot be mounted here";
    }
  }
  CommandOutput RunMounted(const std::string& what,
                           const std::string& command) const {
    WriteTextFile(Path("run.sh"), "set -e\nmount -t " + what + " none " +
                                      Path("mnt") + "\n" + command + "\n");
    return RunShell("unshare -rm bash " + Path("run.sh"));
  }
  // Ends with the files there are in the folder.
  std::string MapperThenList(const std::string& environment = "",
                             const std::string& output = "mnt/out") const {
    return environment + " " MGSFM_EXECUTABLE " " +
           MapperCall(Database(), Path(output)) + "&& code=0 || code=$?\n" +
           "find " + Path("mnt") + " -mindepth 1\nexit $code";
  }
};

TEST_F(Mounted, DiskFull) {
  for (const char* size :
       {"size=4k,nr_inodes=1", "size=4k", "size=64k", "size=400k"}) {
    const CommandOutput output =
        RunMounted(std::string("tmpfs -o ") + size, MapperThenList());
    EXPECT_EQ(output.exit_code, 1) << size;
    EXPECT_THAT(LastWord(output),
                AllOf(HasSubstr(Path("mnt/")), HasSubstr("No space left"),
                      HasSubstr("free some space")))
        << output.err;
    EXPECT_THAT(output.out, IsEmpty()) << size;
  }
}

TEST_F(Mounted, DiskFullKeepsTheEarlierModel) {
  const CommandOutput output = RunMounted(
      "tmpfs -o size=300k", "mkdir -p " + Path("mnt/out/0") + "\ncp " + Out() +
                                "/0/images.bin " + Path("mnt/out/0") + "\n" +
                                MapperThenList());
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(LastWord(output), HasSubstr("No space left"));
  EXPECT_EQ(output.out, Path("mnt/out") + "\n" + Path("mnt/out/0") + "\n" +
                            Path("mnt/out/0/images.bin") + "\n");
}

TEST_F(Mounted, ReadOnlyFileSystem) {
  const CommandOutput output = RunMounted("tmpfs -o ro", MapperThenList());
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(LastWord(output),
              AllOf(HasSubstr(Path("mnt/out")), HasSubstr("Read-only"),
                    HasSubstr("choose another path")));
}

// A database with a write-ahead log is read from a copy.
TEST_F(Mounted, DiskFullInTheFolderForTemporaryFiles) {
  OpenDatabase database(Database());
  database.Execute("PRAGMA journal_mode = WAL");
  database.Execute("UPDATE images SET name = name");
  ASSERT_GT(fs::file_size(Database() + "-wal"), 0u);
  const CommandOutput output = RunMounted(
      "tmpfs -o size=64k", MapperThenList("TMPDIR=" + Path("mnt"), "new"));
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(LastWord(output),
              AllOf(HasSubstr(Database()), HasSubstr("set TMPDIR")));
  EXPECT_THAT(output.out, IsEmpty());
  EXPECT_FALSE(fs::exists(Path("new")));
}

TEST_F(BadInput, FullDevices) {
  for (const char* arguments :
       {"--help", "mapper --help", "mapper --dump_config",
        "print_options_markdown"}) {
    const CommandOutput output =
        RunShell(std::string(MGSFM_EXECUTABLE " ") + arguments + " >/dev/full");
    EXPECT_EQ(output.exit_code, 1) << arguments;
    EXPECT_THAT(LastWord(output), HasSubstr("standard output"));
  }
  for (const char* flag : {"--json", "--svg_path"}) {
    ExpectRefused("model_evaluator --input_path " + DemoTruth() +
                      " --gt_path " + DemoTruth() + " " + flag + " /dev/full",
                  AllOf(HasSubstr("/dev/full"), HasSubstr("No space left")));
  }
}

}  // namespace
}  // namespace mgsfm
