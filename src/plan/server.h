#pragma once

#include "plan/planner.h"

#include <iosfwd>
#include <string>

namespace handhold {

/// Answers requests of a robot, one JSON object a line (DESIGN.md, docs/online.md):
///
///     {"id", "op": "scene" | "add" | "move" | "remove" | "target" | "joints" | "rank" | "plan" | "quit", ...}
///     {"id", "ok": true, "result"} or {"id", "ok": false, "error"}
///
/// Whatever comes in, an answer goes out and the scene is the one before unless the answer says ok.
class PlanServer {
 public:
  /// `planner` must outlive it.
  explicit PlanServer(Planner& planner) : planner_(planner) {}

  /// The answer to one line, without the line's end. @param stopAt  > 0: a search with a deadline ends after as many
  /// checks instead (replay)
  std::string answer(const std::string& line, std::uint64_t stopAt = 0);
  bool hasQuit() const { return hasQuit_; }

 private:
  Planner& planner_;
  bool hasQuit_ = false;
};

/// Reads requests until the end or `quit`, writes answers; `record`, when not null, gets both, a line each.
void serve(PlanServer& server, std::istream& in, std::ostream& out, std::ostream* record);

/// Asks the recorded requests again. Prints one line for every answer that differs, `timing_ms` aside, and a last one
/// with the counts; true when none does. @throws InputError  `NAME:LINE: ...` no record
bool replay(PlanServer& server, std::istream& record, const std::string& name, std::ostream& out);

}  // namespace handhold
