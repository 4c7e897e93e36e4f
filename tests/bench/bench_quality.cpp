// Times force closure and epsilon against GLPK, CLP and Qhull on the same contact sets, in one run, and the bounds of
// epsilon and the critical friction on the true cone, which are held against cones of many edges.
//
//     bench_quality [--json] [--quick] [--database DIR]
//
// Then verdicts are checked, on random sets and on the stored grasps of a database (check_verdicts.h).
// Every call gets another instance: a repeated one trains the branch predictor and looks three times as fast.
#include "bench/check_verdicts.h"
#include "bench/clp_margin.h"
#include "bench/grasp_like_contacts.h"
#include "bench/timings.h"
#include "core/error.h"
#include "quality/columns.h"
#include "quality/force_closure.h"
#include "quality/references.h"
#include "quality/true_cone.h"
#include "store/database.h"
#include "support/random_contacts.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using bench::ClpMargin;
using bench::cpuModel;
using bench::graspLikeContacts;
using bench::kManyEdges;
using bench::microsecondsNow;
using bench::quantile;
using bench::timed;
using bench::Timings;
using bench::VerdictCounts;
using nlohmann::ordered_json;

constexpr int kConeEdges = 8;
constexpr double kFriction = 0.5;
constexpr double kLpMargin = 1e-10;  // a weight of the balance; the LP solvers stop at 1e-9 and a closed set has more

struct Family {
  const char* name;
  bool graspLike;
};
constexpr Family kFamilies[] = {{"random", false}, {"grasp-like", true}};

std::vector<Contact> contactsOf(const Family& family, int nContacts, std::uint64_t seed) {
  return family.graspLike ? graspLikeContacts(seed, nContacts) : testing::randomContacts(seed, nContacts, 0.3);
}

WrenchModel modelOf(const Family& family, double friction = kFriction, int coneEdges = kConeEdges) {
  return {{0, 0, 0}, family.graspLike ? 0.09 : 1, friction, coneEdges};
}

WrenchMatrix instance(const Family& family, int nContacts, std::uint64_t seed) {
  return frictionConeWrenches(contactsOf(family, nContacts, seed), modelOf(family));
}

struct Sizes {
  int repeats = 5;
  int forceClosure = 2000;  // instances a repeat
  int linearPrograms = 200;
  int epsilon = 300;
  double qhullBudget = 200;  // wrenches squared / 1000 a repeat: 50, 12 and 3 sets at 8, 16 and 32 contacts
  int randomVerdicts = 100'000;
  int storedGrasps = 10'000;
  int trueCone = 300;  // instances a repeat
  int bracketed = 20;  // of these held against many edges
};

/// Our verdict and its time, on many instances; then the time of epsilon where it is closed.
ordered_json benchOurs(const Family& family, int nContacts, const Sizes& sizes, Timings& closure, Timings& epsilon) {
  Timings closedOnly;
  long nClosed = 0, nFailed = 0, nNan = 0;
  for (int repeat = 0; repeat < sizes.repeats; ++repeat) {
    closure.startRepeat();
    closedOnly.startRepeat();
    epsilon.startRepeat();
    int nEpsilon = 0;
    for (int i = 0; i < sizes.forceClosure; ++i) {
      const WrenchMatrix w = instance(family, nContacts, static_cast<std::uint64_t>(repeat) << 32 | i);
      const double before = microsecondsNow();
      const ForceClosureResult result = testForceClosure(w);
      const double microseconds = microsecondsNow() - before;
      closure.add(microseconds);
      nFailed += result.verdict == ForceClosure::failed;
      if (result.verdict != ForceClosure::closed) continue;
      closedOnly.add(microseconds);
      ++nClosed;
      if (nEpsilon++ < sizes.epsilon) nNan += std::isnan(timed(epsilon, [&] { return epsilonMetric(w, result); }));
    }
  }
  const double share = static_cast<double>(nClosed) / (sizes.repeats * sizes.forceClosure);
  return {{"closed_share", share},
          {"verdicts_failed", nFailed},
          {"epsilon_nan", nNan},
          {"force_closure", closure.json()},
          {"force_closure_closed", closedOnly.json()},
          {"epsilon", epsilon.json()}};
}

/// The same question to two linear program solvers; verdicts are compared.
ordered_json benchLinearPrograms(const Family& family, int nContacts, const Sizes& sizes, double ourMedian) {
  Timings glpk, clp;
  ClpMargin clpMargin;
  long nSets = 0, glpkAgrees = 0, clpAgrees = 0;
  for (int repeat = 0; repeat < sizes.repeats; ++repeat) {
    glpk.startRepeat();
    clp.startRepeat();
    for (int i = 0; i < sizes.linearPrograms; ++i) {
      const WrenchMatrix w = instance(family, nContacts, static_cast<std::uint64_t>(repeat + 100) << 32 | i);
      const bool closed = testForceClosure(w).verdict == ForceClosure::closed;
      const double byGlpk = timed(glpk, [&] { return testing::glpkMargin(w); });
      const double byClp = timed(clp, [&] { return clpMargin(w); });
      const bool fullRank = testing::hasFullRank(w);
      ++nSets;
      glpkAgrees += closed == (fullRank && byGlpk > kLpMargin);
      clpAgrees += closed == (fullRank && byClp > kLpMargin);
    }
  }
  return {{"sets", nSets},
          {"glpk", glpk.json()},
          {"glpk_agrees", glpkAgrees},
          {"glpk_ratio", glpk.median() / ourMedian},
          {"clp", clp.json()},
          {"clp_agrees", clpAgrees},
          {"clp_ratio", clp.median() / ourMedian}};
}

/// Qhull builds the whole hull; our value on the same set is timed beside it.
ordered_json benchQhull(const Family& family, int nContacts, const Sizes& sizes) {
  Timings qhull, ours;
  double worst = 0;
  long nSets = 0, nRefused = 0;
  const double wrenches = nContacts * kConeEdges;
  const int setsPerRepeat = std::clamp(static_cast<int>(sizes.qhullBudget * 1000 / (wrenches * wrenches)), 2, 60);
  for (int repeat = 0; repeat < sizes.repeats; ++repeat) {
    qhull.startRepeat();
    ours.startRepeat();
    int sets = 0;
    for (int i = 0; sets < setsPerRepeat && i < 50 * setsPerRepeat; ++i) {
      const WrenchMatrix w = instance(family, nContacts, static_cast<std::uint64_t>(repeat + 200) << 32 | i);
      const ForceClosureResult closure = testForceClosure(w);
      if (closure.verdict != ForceClosure::closed) continue;
      ++sets;
      const double value = timed(ours, [&] { return epsilonMetric(w, closure); });
      const double reference = timed(qhull, [&] { return testing::qhullEpsilon(w); });
      nRefused += std::isnan(reference);
      if (!std::isnan(reference)) worst = std::fmax(worst, std::abs(value - reference));
    }
    nSets += sets;
  }
  return {{"sets", nSets},
          {"qhull", qhull.json()},
          {"epsilon_beside_qhull", ours.json()},
          {"qhull_ratio", qhull.median() / ours.median()},
          {"largest_difference", worst},
          {"qhull_refused", nRefused}};
}

/// Epsilon by an inscribed (or the narrowest circumscribed) cone of many edges; 0 when not closed.
double manyEdgeEpsilon(const Family& family, const std::vector<Contact>& contacts, double friction) {
  const WrenchMatrix w = frictionConeWrenches(contacts, modelOf(family, friction, kManyEdges));
  const ForceClosureResult closure = testForceClosure(w);
  return closure.verdict == ForceClosure::closed ? epsilonMetric(w, closure) : 0;
}

/// Bounds and critical friction on the true cone of the sets that are closed there.
ordered_json benchTrueCone(const Family& family, int nContacts, const Sizes& sizes) {
  constexpr double kRounding = 4 * kEpsilonTolerance;
  const double circumscribed = 1 / std::cos(std::numbers::pi / kManyEdges);
  Timings test, bounds, critical;
  std::vector<double> facets;
  long nSets = 0, nFailed = 0, nBracketed = 0, outOfBracket = 0, nConfirmed = 0, notConfirmed = 0;
  double largestGap = 0;
  TrueCones cones(modelOf(family));
  for (int repeat = 0; repeat < sizes.repeats; ++repeat) {
    test.startRepeat();
    bounds.startRepeat();
    critical.startRepeat();
    for (int i = 0; i < sizes.trueCone; ++i) {
      const auto contacts = contactsOf(family, nContacts, static_cast<std::uint64_t>(repeat + 300) << 32 | i);
      const ForceClosure verdict = timed(test, [&] { return cones.testForceClosure(contacts); });
      nFailed += verdict == ForceClosure::failed;
      if (verdict != ForceClosure::closed) continue;
      ++nSets;
      const EpsilonBounds b = timed(bounds, [&] { return cones.epsilonBounds(contacts); });
      const CriticalFriction c = timed(critical, [&] { return cones.criticalFriction(contacts); });
      nFailed += b.verdict != ForceClosure::closed || c.verdict != ForceClosure::closed;
      facets.push_back(b.facets);
      largestGap = std::fmax(largestGap, 1 - b.lower / b.upper);
      if (c.friction > kLeastFriction) {
        const auto isClosed = [&](double friction) {
          const WrenchMatrix w = frictionConeWrenches(contacts, modelOf(family, friction, kManyEdges));
          return testForceClosure(w).verdict == ForceClosure::closed;
        };
        ++nConfirmed;
        notConfirmed += !isClosed(1.01 * c.friction) || isClosed(0.99 * c.friction * circumscribed);
      }
      if (i >= sizes.bracketed) continue;
      ++nBracketed;
      outOfBracket += !(b.upper >= manyEdgeEpsilon(family, contacts, kFriction) - kRounding) ||
                      !(b.lower <= manyEdgeEpsilon(family, contacts, kFriction * circumscribed) + kRounding);
    }
  }
  return {{"sets", nSets},
          {"failed", nFailed},
          {"force_closure", test.json()},
          {"bounds", bounds.json()},
          {"facets_median", quantile(facets, 0.5)},
          {"facets_p90", quantile(facets, 0.9)},
          {"largest_gap", largestGap},
          {"bracketed", nBracketed},
          {"out_of_bracket", outOfBracket},
          {"critical_friction", critical.json()},
          {"confirmed", nConfirmed},
          {"not_confirmed", notConfirmed}};
}

/// Median cost of reading the clock twice; part of every time.
double clockCost() {
  Timings empty;
  empty.startRepeat();
  for (int i = 0; i < 2000; ++i) timed(empty, [] { return 0; });
  return empty.median();
}

ordered_json machine(const Sizes& sizes) {
  return {{"cpu", cpuModel()},
          {"instruction_set", polar::name(polar::instructionSet())},
          {"compiler", __VERSION__},
          {"build_type", HANDHOLD_BUILD_TYPE},
          {"threads", 1},
          {"clock_us", clockCost()},
          {"cone_edges", kConeEdges},
          {"friction", kFriction},
          {"repeats", sizes.repeats}};
}

ordered_json benchOne(const Family& family, int nContacts, const Sizes& sizes) {
  Timings closure, epsilon;
  ordered_json result = {{"sets", family.name}, {"contacts", nContacts}};
  result["ours"] = benchOurs(family, nContacts, sizes, closure, epsilon);
  result["linear_programs"] = benchLinearPrograms(family, nContacts, sizes, closure.median());
  result["hull"] = benchQhull(family, nContacts, sizes);
  result["true_cone"] = benchTrueCone(family, nContacts, sizes);
  return result;
}

ordered_json countsJson(const VerdictCounts& counts) {
  return {{"sets", counts.sets},
          {"closed", counts.closed},
          {"not_closed", counts.notClosed},
          {"failed", counts.failed},
          {"wrong_closed", counts.wrongClosed},
          {"wrong_not_closed", counts.wrongNotClosed},
          {"clp_undecided", counts.clpUndecided},
          {"clp_disagrees", counts.clpDisagrees},
          {"least_inradius", counts.leastInradius}};
}

/// Adds what is found of verdicts, and of stored bounds, to the report.
void addChecks(const Sizes& sizes, const std::string& database, ordered_json& report) {
  ordered_json& verdicts = report["verdicts"];
  verdicts = {{"random", countsJson(bench::checkRandomVerdicts(sizes.randomVerdicts))}};
  if (database.empty()) {
    verdicts["stored"] = nullptr;
    return;
  }
  const bench::StoredVerdicts stored = bench::checkStoredVerdicts(database, sizes.storedGrasps);
  verdicts["stored"] = countsJson(stored.whole);
  verdicts["stored_without_one_link"] = countsJson(stored.withoutOneLink);
  const bench::BoundCounts bounds = bench::checkStoredBounds(database, sizes.storedGrasps);
  report["stored_bounds"] = {{"sets", bounds.sets},
                             {"unknown", bounds.unknown},
                             {"out_of_bracket", bounds.outOfBracket},
                             {"critical_frictions", bounds.frictions},
                             {"not_confirmed", bounds.notConfirmed}};
}

std::string cell(const ordered_json& timing) {
  if (timing.is_null()) return "-";
  return fmt::format("{:.2f} ({:.2f})", timing["median_us"].get<double>(), timing["p90_us"].get<double>());
}

/// Largest spread of the medians of repeats, relative to the median of all.
double spread(const ordered_json& report, const char* timing) {
  double worst = 0;
  for (const ordered_json& row : report["results"]) {
    const ordered_json& t = row["ours"][timing];
    if (t.is_null()) continue;
    const double range = t["median_max_us"].get<double>() - t["median_min_us"].get<double>();
    worst = std::fmax(worst, range / t["median_us"].get<double>());
  }
  return worst;
}

void printTable(const ordered_json& report) {
  fmt::print("{}\n", report["machine"].dump());
  fmt::print("us a call: median (p90) over different instances. FC: force closure; agree: verdicts equal to ours\n\n");
  fmt::print("{:10} {:>3} {:>7} {:>14} {:>14} {:>17} {:>17} {:>9} {:>13} {:>16} {:>18} {:>6} {:>8}\n", "sets", "n",
             "closed", "FC", "FC closed", "GLPK", "CLP", "agree", "ratios", "epsilon", "Qhull", "ratio", "differ");
  for (const ordered_json& row : report["results"]) {
    const ordered_json &ours = row["ours"], &lp = row["linear_programs"], &hull = row["hull"];
    fmt::print(
        "{:10} {:>3} {:>6.1f}% {:>14} {:>14} {:>17} {:>17} {:>4}/{:<4} {:>6.0f} {:>6.0f} {:>16} {:>18} {:>6.0f} "
        "{:>8.0e}\n",
        row["sets"].get<std::string>(), row["contacts"].get<int>(), 100 * ours["closed_share"].get<double>(),
        cell(ours["force_closure"]), cell(ours["force_closure_closed"]), cell(lp["glpk"]), cell(lp["clp"]),
        std::min(lp["glpk_agrees"].get<long>(), lp["clp_agrees"].get<long>()), lp["sets"].get<long>(),
        lp["glpk_ratio"].get<double>(), lp["clp_ratio"].get<double>(), cell(ours["epsilon"]), cell(hull["qhull"]),
        hull["qhull_ratio"].get<double>(), hull["largest_difference"].get<double>());
  }
  fmt::print("\nmedians of single repeats spread over {:.0f} % (FC) and {:.0f} % (epsilon) at most\n",
             100 * spread(report, "force_closure"), 100 * spread(report, "epsilon"));
}

void printTrueCone(const ordered_json& report) {
  fmt::print(
      "\nthe true cone, sets closed there. out: bounds that miss the bracket of {0} inscribed and circumscribed "
      "edges;\n"
      "wrong: critical friction not confirmed by {0} edges 1 % above and below it\n\n",
      kManyEdges);
  fmt::print("{:10} {:>3} {:>6} {:>7} {:>16} {:>20} {:>12} {:>9} {:>9} {:>18} {:>11}\n", "sets", "n", "count", "failed",
             "FC", "bounds", "facets", "gap", "out", "critical friction", "wrong");
  for (const ordered_json& row : report["results"]) {
    const ordered_json& cone = row["true_cone"];
    fmt::print("{:10} {:>3} {:>6} {:>7} {:>16} {:>20} {:>5.0f} ({:.0f}) {:>9.1e} {:>4}/{:<4} {:>18} {:>5}/{:<5}\n",
               row["sets"].get<std::string>(), row["contacts"].get<int>(), cone["sets"].get<long>(),
               cone["failed"].get<long>(), cell(cone["force_closure"]), cell(cone["bounds"]),
               cone["facets_median"].get<double>(), cone["facets_p90"].get<double>(), cone["largest_gap"].get<double>(),
               cone["out_of_bracket"].get<long>(), cone["bracketed"].get<long>(), cell(cone["critical_friction"]),
               cone["not_confirmed"].get<long>(), cone["confirmed"].get<long>());
  }
}

void printStoredBounds(const ordered_json& bounds) {
  const auto count = [&](const char* key) { return bounds[key].get<long>(); };
  fmt::print(
      "\nstored bounds of {} grasps ({} others have none): {} out of the bracket of {} inscribed and circumscribed "
      "edges\nby more than the bounds' own gap; {} of {} critical frictions not confirmed 1 % above and below\n",
      count("sets"), count("unknown"), count("out_of_bracket"), kManyEdges, count("not_confirmed"),
      count("critical_frictions"));
}

void printVerdicts(const ordered_json& verdicts) {
  fmt::print(
      "\nverdicts. Wrong: its proof does not hold (closed: strictly; not closed: within {:.2g} R). CLP does not "
      "decide\n"
      "where the least weight of its balance is below {:g}\n\n",
      bench::kProofMargin, bench::kClpMargin);
  fmt::print("{:24} {:>7} {:>7} {:>10} {:>6} {:>12} {:>16} {:>14} {:>12} {:>14}\n", "sets", "n", "closed", "not closed",
             "failed", "wrong closed", "wrong not closed", "CLP undecided", "CLP differs", "least inradius");
  for (const auto& [name, row] : verdicts.items()) {
    if (row.is_null()) {
      fmt::print("{:24} left out: name a built database with --database DIR\n", name);
      continue;
    }
    const auto count = [&](const char* key) { return row[key].get<long>(); };
    fmt::print("{:24} {:>7} {:>7} {:>10} {:>6} {:>12} {:>16} {:>14} {:>12} {:>14.1e}\n", name, count("sets"),
               count("closed"), count("not_closed"), count("failed"), count("wrong_closed"), count("wrong_not_closed"),
               count("clp_undecided"), count("clp_disagrees"), row["least_inradius"].get<double>());
  }
}

int run(int argc, char** argv) {
  bool asJson = false;
  std::string database;
  Sizes sizes;
  for (int i = 1; i < argc; ++i) {
    const std::string_view option = argv[i];
    if (option == "--json") {
      asJson = true;
    } else if (option == "--quick") {
      sizes = {3, 500, 20, 100, 30, 5'000, 1'000, 100, 5};
    } else if (option == "--database" && i + 1 < argc) {
      database = argv[++i];
    } else {
      fmt::print(stderr, "usage: bench_quality [--json] [--quick] [--database DIR]\n");
      return 2;
    }
  }
  if (!database.empty()) {  // said now, not after minutes
    Database(database).requireFolder();
    if (Database(database).files().empty()) throw InputError(database + ": holds no set, want a built database");
  }
  ordered_json report = {{"machine", machine(sizes)}, {"results", ordered_json::array()}};
  for (const Family& family : kFamilies) {
    for (const int nContacts : {4, 8, 16, 32}) report["results"].push_back(benchOne(family, nContacts, sizes));
  }
  addChecks(sizes, database, report);
  if (asJson) {
    fmt::print("{}\n", report.dump(2));
  } else {
    printTable(report);
    printTrueCone(report);
    printVerdicts(report["verdicts"]);
    if (report.contains("stored_bounds")) printStoredBounds(report["stored_bounds"]);
  }
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) try {
  return handhold::run(argc, argv);
} catch (const std::exception& error) {  // a database that cannot be read
  fmt::print(stderr, "bench_quality: {}\n", error.what());
  return 2;
}
