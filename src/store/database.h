#pragma once

#include "store/grasp_set.h"
#include "store/query.h"

#include <filesystem>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace handhold {

/// What `list` and `info` show of a set, read without its large arrays.
struct GraspSetSummary {
  std::filesystem::path path;
  std::string object, hand, inputHash, generator, policy;
  int setVersion = 0;
  double friction = 0, torsionRadius = 0;
  int coneEdges = 0;
  bool watertight = false;
  std::size_t samples = 0, rolls = 0, preshapes = 0, grasps = 0, bytes = 0;
  std::uint64_t trialsByReference = 0;
  std::vector<std::pair<std::string, std::size_t>> outcomes;           // in the file's order, zero counts included
  double bestEpsilon = 0;                                              // 0 when there is no grasp
  double bestEpsilonLower = std::numeric_limits<double>::quiet_NaN();  // of the same grasp; NaN: not known
  double bestEpsilonUpper = std::numeric_limits<double>::quiet_NaN();
  double leastCriticalFriction = std::numeric_limits<double>::quiet_NaN();
  double bestLoadMargin = std::numeric_limits<double>::quiet_NaN();     // N, of the grasp with the best epsilon
  double largestLoadMargin = std::numeric_limits<double>::quiet_NaN();  // N, of any
  int robustnessTrials = 0;                                             // 0: robustness was not asked for
  double robustnessPosition = 0, robustnessRotation = 0;                // m, rad
  double bestRobustness = std::numeric_limits<double>::quiet_NaN();     // of the grasp with the best epsilon
  double bestRobustnessLower = std::numeric_limits<double>::quiet_NaN();
  double bestRobustnessUpper = std::numeric_limits<double>::quiet_NaN();
  std::size_t loadMargins = 0;  // grasps that have one
  std::map<std::string, double> seconds;
  std::string created, host;
  std::vector<std::string> objectNotes;
};

/// A set file, as its path names it.
struct SetFile {
  std::filesystem::path path;
  std::string object, hand;
  int version = 0;
};

/// `DIR/<object>/<hand>/v<NNNN>.h5`: complete or absent, never changed once written (db/FORMAT.md).
/// Object and hand names that could not be folders are refused with InputError by every function that takes them.
/// @note  Const; safe from many threads, and from many processes on one folder.
class Database {
 public:
  explicit Database(std::filesystem::path folder) : folder_(std::move(folder)) {}
  const std::filesystem::path& folder() const { return folder_; }

  /// Writes the set under the next free version (set.setVersion is ignored) and returns its path. Nothing is visible
  /// before it is whole, nothing is left behind when it cannot be. Needs memory for two copies of the file.
  /// @throws SystemError  disk full, no permission
  /// @throws InputError   `set OBJECT/HAND: ...` the set contradicts itself: readGraspSet would refuse it
  std::filesystem::path write(GraspSet set) const;

  /// The newest version's number of (object, hand), 0 when there is none.
  int newestVersion(const std::string& object, const std::string& hand) const;
  std::filesystem::path setPath(const std::string& object, const std::string& hand, int version) const;

  /// Every set file, sorted by object, hand, version; none when there is no such folder.
  std::vector<std::filesystem::path> files() const;
  /// Every folder `DIR/<object>/<hand>`, whatever is in it, sorted.
  std::vector<std::filesystem::path> setFolders() const;

  /// @throws InputError  the folder of the database is none
  void requireFolder() const;

  /// Those whose names match the shell patterns, in the same order.
  /// @throws InputError  as requireFolder()
  std::vector<SetFile> sets(const std::string& objectGlob = "*", const std::string& handGlob = "*") const;
  /// Of each object and hand the newest of them.
  std::vector<SetFile> newestSets(const std::string& objectGlob = "*", const std::string& handGlob = "*") const;

  /// What `list` shows, in the order of files(): from the index where its row is up to date, else from the set.
  /// A set that cannot be read is left out and a line about it added to `failures`.
  /// @throws InputError  as requireFolder()
  std::vector<GraspSetSummary> summaries(std::vector<std::string>& failures) const;
  /// Writes `index.sqlite`, which makes summaries() and queries over many sets fast, in place of a former one; reads
  /// the sets that the former one does not know as they are. Returns how many sets it holds.
  /// @throws InputError, SystemError  as summaries() and write() do
  std::size_t writeIndex(std::vector<std::string>& failures) const;

  /// The grasps that pass the filters. Of each set the checksum of the whole file is checked, and /grasps read.
  /// @throws InputError  the query contradicts itself, picks no set, or asks for more friction than a set was built
  /// with
  QueryAnswer query(const GraspQuery& query) const;

 private:
  std::filesystem::path folder_;
};

/// Reads a whole set. The checksum is checked before HDF5 opens the file, then every shape, index and order.
/// @throws InputError  `PATH: ...` not a set, damaged, of a newer format, contradicting itself
GraspSet readGraspSet(const std::filesystem::path& path);
/// Checks the checksum of the whole file, then reads what is asked for. Throws InputError as readGraspSet does.
GraspSetSummary readSummary(const std::filesystem::path& path);
/// The attribute input_hash, from the first 512 bytes; of the rest only the length is checked. For skipping unchanged
/// sets: takes microseconds. Throws InputError as readGraspSet does.
std::string readInputHash(const std::filesystem::path& path);

/// Empty when the sets are equal: /timings, generator and set_version aside, NaN equal to NaN. Else the path of the
/// first dataset or attribute that differs, as db/FORMAT.md writes it (`/trials/outcome@names`).
std::string firstDifference(const GraspSet& a, const GraspSet& b);

}  // namespace handhold
