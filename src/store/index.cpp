#include "store/index.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/log.h"

#include <bit>
#include <charconv>
#include <cmath>
#include <concepts>
#include <iterator>
#include <limits>
#include <memory>

#include <fmt/format.h>
#include <sqlite3.h>
#include <sys/stat.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// visit(NAME, MEMBER) for every column but path, modified_ns, the lists and the checksum.
template <class Visit>
void forEachColumn(const Visit& visit) {
  visit("object", &GraspSetSummary::object);
  visit("hand", &GraspSetSummary::hand);
  visit("set_version", &GraspSetSummary::setVersion);
  visit("bytes", &GraspSetSummary::bytes);
  visit("grasps", &GraspSetSummary::grasps);
  visit("best_epsilon", &GraspSetSummary::bestEpsilon);
  visit("best_epsilon_lower", &GraspSetSummary::bestEpsilonLower);
  visit("best_epsilon_upper", &GraspSetSummary::bestEpsilonUpper);
  visit("least_critical_friction", &GraspSetSummary::leastCriticalFriction);
  visit("best_load_margin", &GraspSetSummary::bestLoadMargin);
  visit("largest_load_margin", &GraspSetSummary::largestLoadMargin);
  visit("load_margins", &GraspSetSummary::loadMargins);
  visit("robustness_trials", &GraspSetSummary::robustnessTrials);
  visit("robustness_position", &GraspSetSummary::robustnessPosition);
  visit("robustness_rotation", &GraspSetSummary::robustnessRotation);
  visit("best_robustness", &GraspSetSummary::bestRobustness);
  visit("best_robustness_lower", &GraspSetSummary::bestRobustnessLower);
  visit("best_robustness_upper", &GraspSetSummary::bestRobustnessUpper);
  visit("torsion_radius", &GraspSetSummary::torsionRadius);
  visit("friction", &GraspSetSummary::friction);
  visit("cone_edges", &GraspSetSummary::coneEdges);
  visit("policy", &GraspSetSummary::policy);
  visit("samples", &GraspSetSummary::samples);
  visit("rolls", &GraspSetSummary::rolls);
  visit("preshapes", &GraspSetSummary::preshapes);
  visit("trials_by_reference", &GraspSetSummary::trialsByReference);
  visit("watertight", &GraspSetSummary::watertight);
  visit("input_hash", &GraspSetSummary::inputHash);
  visit("generator", &GraspSetSummary::generator);
  visit("created", &GraspSetSummary::created);
  visit("host", &GraspSetSummary::host);
}

/// The lists of a summary as texts; zero bytes, which no text of a set has, end each of them in the index.
struct Lists {
  std::vector<std::string> outcomes, seconds, notes;  // the first two: name, number, name, number, ...
};

Lists listsOf(const GraspSetSummary& summary) {
  Lists lists;
  for (const auto& [name, count] : summary.outcomes) {
    lists.outcomes.insert(lists.outcomes.end(), {name, fmt::to_string(count)});
  }
  for (const auto& [stage, seconds] : summary.seconds) {
    lists.seconds.insert(lists.seconds.end(), {stage, fmt::to_string(seconds)});
  }
  lists.notes = summary.objectNotes;
  return lists;
}

template <class Number>
Number toNumber(const std::string& text) {
  Number number{};
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

void setLists(const Lists& lists, GraspSetSummary& summary) {
  for (std::size_t i = 0; i + 1 < lists.outcomes.size(); i += 2) {
    summary.outcomes.emplace_back(lists.outcomes[i], toNumber<std::size_t>(lists.outcomes[i + 1]));
  }
  for (std::size_t i = 0; i + 1 < lists.seconds.size(); i += 2) {
    summary.seconds[lists.seconds[i]] = toNumber<double>(lists.seconds[i + 1]);
  }
  summary.objectNotes = lists.notes;
}

std::string joined(const std::vector<std::string>& texts) {
  std::string result;
  for (const std::string& text : texts) result.append(text).push_back('\0');
  return result;
}

std::vector<std::string> split(const std::string& joinedTexts) {
  std::vector<std::string> texts;
  for (std::size_t begin = 0, end; (end = joinedTexts.find('\0', begin)) != std::string::npos; begin = end + 1) {
    texts.push_back(joinedTexts.substr(begin, end - begin));
  }
  return texts;
}

/// SQLite has no checksums: a flipped bit in a row would be believed.
std::string checksumOf(const std::string& path, const IndexedSet& set) {
  std::string text;
  const auto add = [&](const auto& value) { fmt::format_to(std::back_inserter(text), "{}\n", value); };
  add(path);
  add(set.modifiedNs);
  forEachColumn([&](const char*, auto member) {
    if constexpr (std::is_same_v<decltype(member), double GraspSetSummary::*>) {
      add(std::isnan(set.summary.*member) ? 0 : std::bit_cast<std::uint64_t>(set.summary.*member));
    } else {
      add(set.summary.*member);
    }
  });
  const Lists lists = listsOf(set.summary);
  for (const auto& list : {lists.outcomes, lists.seconds, lists.notes}) add(joined(list));
  return hashBytes(text.data(), text.size());
}

/// Also says what an index is: one whose table was made by another statement is of another make.
std::string createStatement() {
  std::string sql = "CREATE TABLE sets (path TEXT PRIMARY KEY, modified_ns INTEGER";
  forEachColumn([&]<class T>(const char* name, T GraspSetSummary::*) {
    sql += fmt::format(", {} {}", name,
                       std::is_same_v<T, std::string> ? "TEXT"
                       : std::is_floating_point_v<T>  ? "REAL"
                                                      : "INTEGER");
  });
  return sql + ", outcomes BLOB, seconds BLOB, notes BLOB, checksum TEXT) WITHOUT ROWID";
}

[[noreturn]] void fail(sqlite3* database) {
  throw SystemError(fmt::format("{}: SQLite cannot build it: {}", kIndexName, sqlite3_errmsg(database)));
}

/// Puts values into the parameters of a statement, from the first on. The values outlive the statement's next step.
class Binder {
 public:
  explicit Binder(sqlite3_stmt* statement) : statement_(statement) {}
  void add(const std::string& text) {
    sqlite3_bind_text(statement_, ++index_, text.data(), static_cast<int>(text.size()), SQLITE_STATIC);
  }
  void addBlob(const std::string& bytes) {
    sqlite3_bind_blob(statement_, ++index_, bytes.data(), static_cast<int>(bytes.size()), SQLITE_STATIC);
  }
  void add(double value) { sqlite3_bind_double(statement_, ++index_, value); }  // NaN becomes NULL
  template <std::integral T>
  void add(T value) {
    sqlite3_bind_int64(statement_, ++index_, static_cast<sqlite3_int64>(value));
  }

 private:
  sqlite3_stmt* statement_;
  int index_ = 0;
};

/// Takes the columns of a row, from the first on. What has another type becomes empty, 0 or NaN: the checksum tells.
class RowReader {
 public:
  explicit RowReader(sqlite3_stmt* statement) : statement_(statement) {}
  void take(std::string& text) {
    const void* bytes = sqlite3_column_blob(statement_, index_);
    const int size = sqlite3_column_bytes(statement_, index_++);
    text.assign(static_cast<const char*>(bytes), bytes == nullptr ? 0 : static_cast<std::size_t>(size));
  }
  void take(double& value) {
    const bool isNull = sqlite3_column_type(statement_, index_) == SQLITE_NULL;
    value = isNull ? std::numeric_limits<double>::quiet_NaN() : sqlite3_column_double(statement_, index_);
    ++index_;
  }
  template <std::integral T>
  void take(T& value) {
    value = static_cast<T>(sqlite3_column_int64(statement_, index_++));
  }

 private:
  sqlite3_stmt* statement_;
  int index_ = 0;
};

std::string keyOf(const fs::path& folder, const fs::path& file) { return file.lexically_relative(folder).string(); }

void insertRow(sqlite3_stmt* insert, const std::string& path, const IndexedSet& set) {
  const Lists lists = listsOf(set.summary);
  const std::string outcomes = joined(lists.outcomes), seconds = joined(lists.seconds), notes = joined(lists.notes);
  const std::string checksum = checksumOf(path, set);
  Binder binder(insert);
  binder.add(path);
  binder.add(set.modifiedNs);
  forEachColumn([&](const char*, auto member) { binder.add(set.summary.*member); });
  for (const std::string* bytes : {&outcomes, &seconds, &notes}) binder.addBlob(*bytes);
  binder.add(checksum);
  if (sqlite3_step(insert) != SQLITE_DONE) fail(sqlite3_db_handle(insert));
  sqlite3_reset(insert);
}

std::string encodeRows(sqlite3* database, const fs::path& folder, const std::vector<IndexedSet>& sets) {
  const auto run = [&](const std::string& sql) {
    if (sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) fail(database);
  };
  run(createStatement());
  run("BEGIN");
  std::string parameters = "?, ?, ?, ?, ?, ?";  // path, modified_ns, three lists, checksum
  forEachColumn([&](const char*, auto) { parameters += ", ?"; });
  sqlite3_stmt* insert = nullptr;
  const std::string sql = "INSERT INTO sets VALUES (" + parameters + ")";
  if (sqlite3_prepare_v2(database, sql.c_str(), -1, &insert, nullptr) != SQLITE_OK) fail(database);
  const std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)> owner(insert, sqlite3_finalize);
  for (const IndexedSet& set : sets) insertRow(insert, keyOf(folder, set.summary.path), set);
  run("COMMIT");
  sqlite3_int64 size = 0;
  const std::unique_ptr<unsigned char, void (*)(void*)> image(sqlite3_serialize(database, "main", &size, 0),
                                                              sqlite3_free);
  if (image == nullptr) fail(database);
  return {reinterpret_cast<const char*>(image.get()), static_cast<std::size_t>(size)};
}

}  // namespace

FileStamp stampOf(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return {};
  return {static_cast<std::uint64_t>(status.st_size),
          std::int64_t{status.st_mtim.tv_sec} * 1'000'000'000 + status.st_mtim.tv_nsec};
}

std::string encodeIndex(const fs::path& folder, const std::vector<IndexedSet>& sets) {
  sqlite3* database = nullptr;
  const int result = sqlite3_open(":memory:", &database);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> owner(database, sqlite3_close);
  if (result != SQLITE_OK) fail(database);
  return encodeRows(database, folder, sets);
}

CatalogIndex::CatalogIndex(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  if (!fs::exists(folder_ / kIndexName, error)) return;
  try {
    image_ = readFile(folder_ / kIndexName);
  } catch (const InputError& unreadable) {
    giveUp(unreadable.what());
    return;
  }
  sqlite3_open(":memory:", &database_);
  auto* bytes = reinterpret_cast<unsigned char*>(image_.data());
  const auto size = static_cast<sqlite3_int64>(image_.size());
  sqlite3_deserialize(database_, "main", bytes, size, size, SQLITE_DESERIALIZE_READONLY);
  const std::string table = "SELECT 1 FROM sqlite_schema WHERE type = 'table' AND sql = '" + createStatement() + "'";
  sqlite3_stmt* check = nullptr;
  sqlite3_prepare_v2(database_, table.c_str(), -1, &check, nullptr);
  const bool isOurs = sqlite3_step(check) == SQLITE_ROW;
  sqlite3_finalize(check);
  if (!isOurs) {
    giveUp("it is damaged, or of another version of Handhold");
  } else if (sqlite3_prepare_v2(database_, "SELECT * FROM sets WHERE path = ?", -1, &select_, nullptr) != SQLITE_OK) {
    giveUp(sqlite3_errmsg(database_));
  }
}

CatalogIndex::~CatalogIndex() {
  sqlite3_finalize(select_);
  sqlite3_close(database_);
}

void CatalogIndex::giveUp(const std::string& reason) {
  logWarning(
      fmt::format("{}: is not used: {}; handhold index writes it anew", (folder_ / kIndexName).string(), reason));
  sqlite3_finalize(select_);
  select_ = nullptr;
}

std::optional<IndexedSet> CatalogIndex::find(const fs::path& file) {
  if (select_ == nullptr) return std::nullopt;
  const std::string path = keyOf(folder_, file);
  sqlite3_reset(select_);
  Binder(select_).add(path);
  const int result = sqlite3_step(select_);
  if (result == SQLITE_DONE) return std::nullopt;
  if (result != SQLITE_ROW) {
    giveUp(fmt::format("it is damaged: {}", sqlite3_errmsg(database_)));
    return std::nullopt;
  }
  RowReader row(select_);
  std::string key, outcomes, seconds, notes, checksum;
  IndexedSet set;
  row.take(key);
  row.take(set.modifiedNs);
  forEachColumn([&](const char*, auto member) { row.take(set.summary.*member); });
  for (std::string* text : {&outcomes, &seconds, &notes, &checksum}) row.take(*text);
  setLists({split(outcomes), split(seconds), split(notes)}, set.summary);
  if (checksumOf(path, set) != checksum) {
    giveUp(fmt::format("its row of {} is damaged", path));
    return std::nullopt;
  }
  const FileStamp stamp = stampOf(file);
  const bool isFresh = set.modifiedNs == stamp.modifiedNs && set.summary.bytes == stamp.bytes;
  if (!isFresh) return std::nullopt;
  set.summary.path = file;
  return set;
}

}  // namespace handhold
