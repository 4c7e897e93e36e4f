#pragma once

#include "store/grasp_set.h"
#include "view/report_page.h"

#include <cstddef>
#include <string>
#include <vector>

namespace handhold {

/// What a report shows of a set.
struct ReportedSet {
  GraspSet set;
  std::string path;
  std::size_t bytes = 0;  // of the file
  std::size_t top = 0;    // at most so many grasps, the best; of the others the outcomes, samples and epsilons show
  /// (n) share of the simulated directions that each grasp survived, NaN: not simulated. Empty: physics was not run.
  std::vector<float> physics;
};

/// Data of a page about grasp sets, added set by set, so that one set is in memory at a time.
class SetsReport {
 public:
  /// @param thumbnails  draw the best grasp of every set, for the overview of many
  explicit SetsReport(bool thumbnails);

  /// @throws InputError  the stored hand cannot be restored
  void add(const ReportedSet& reported);
  /// A set that could not be read: the page says so.
  void addFailure(const std::string& message) { failures_.push_back(message); }

  /// The page: assemblePage's HTML. @param database  its folder
  std::string html(const std::string& database) const;

 private:
  std::string shareBlock(const std::string& kind, const std::string& json);

  bool thumbnails_;
  std::vector<PageData> blocks_;        // of the sets, and the meshes that they share
  std::vector<std::string> summaries_;  // JSON, a row of the overview each
  std::vector<std::string> failures_;
};

}  // namespace handhold
