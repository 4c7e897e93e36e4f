// Times the load margin: CHOLMOD, the same method with a dense factor, the tasks one by one, and CLP, on the same
// instances in one run. Every call gets another instance.
//
//     bench_load [--json [FILE]] [--quick]
#include "bench/clp_load.h"
#include "bench/grasp_like_actuation.h"
#include "bench/options.h"
#include "bench/timings.h"
#include "quality/load_margin.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <vector>

#include <Eigen/Cholesky>
#include <fmt/core.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using bench::quantile;
using bench::Timings;
using nlohmann::ordered_json;

constexpr double kNormalLimit = 30;  // N
const WrenchModel kModel{{0, 0, 0}, 0.09, 0.5, 8};

/// The same normal equations, factored as a dense matrix.
class DenseFactor : public SymmetricFactor {
 public:
  explicit DenseFactor(const SymmetricPattern& pattern) : pattern_(pattern), matrix_(pattern.size, pattern.size) {}

  bool factorise(const std::vector<double>& values) override {
    matrix_.setZero();
    for (int column = 0; column < pattern_.size; ++column) {
      for (int i = pattern_.start[column]; i < pattern_.start[column + 1]; ++i) {
        matrix_(pattern_.row[i], column) = values[i];
      }
    }
    cholesky_.compute(matrix_);
    return cholesky_.info() == Eigen::Success;
  }
  void solve(double* rhs) override {
    Eigen::Map<Eigen::VectorXd> x(rhs, pattern_.size);
    cholesky_.solveInPlace(x);
  }

 private:
  SymmetricPattern pattern_;
  Eigen::MatrixXd matrix_;
  Eigen::LLT<Eigen::MatrixXd> cholesky_;
};

struct Case {
  int contacts, tasks;
  bool normalLimits;
};
constexpr Case kCases[] = {{16, 6, false}, {16, 12, false}, {16, 50, false}, {16, 6, true},
                           {16, 12, true}, {16, 50, true},  {8, 14, false},  {16, 14, false}};

struct Sizes {
  int repeats = 5;
  int programs = 40;  // instances a repeat
  int dense = 4;      // of these by the dense factor
};

/// The value of a call; its processor time goes to the timings, which other programs on the machine disturb less.
template <class Call>
auto processorTimed(Timings& timings, const Call& call) {
  const auto now = [] {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return 1e6 * static_cast<double>(time.tv_sec) + 1e-3 * static_cast<double>(time.tv_nsec);
  };
  const double before = now();
  const auto value = call();
  timings.add(now() - before);
  return value;
}

/// |a - b| / b of two loads, 1 when one is a load and the other not.
double disagreement(double a, double b) {
  if (std::isinf(a) && std::isinf(b)) return 0;
  if (!std::isfinite(a) || !std::isfinite(b)) return 1;
  constexpr double kNoLoad = 1e-3;  // N; a difference between less is relative to this
  return std::abs(a - b) / std::max(b, kNoLoad);
}

ordered_json benchOne(const Case& some, const Sizes& sizes) {
  const TaskWrenches tasks = weightDirections(some.tasks);
  LoadMarginSolver sparse(kModel), each(kModel);
  LoadMarginSolver dense(kModel, [](const SymmetricPattern& p) { return std::make_unique<DenseFactor>(p); });
  bench::ClpLoad clp;
  Timings bySparse, byDense, byTask, byClp;
  std::vector<double> iterations;
  long nOptimal = 0, nZero = 0, nUnbounded = 0, nFailed = 0, clpGaveUp = 0;
  double fromClp = 0, fromDense = 0;
  int rows = 0, columns = 0;
  for (int repeat = 0; repeat < sizes.repeats; ++repeat) {
    for (Timings* timings : {&bySparse, &byDense, &byTask, &byClp}) timings->startRepeat();
    for (int i = 0; i < sizes.programs; ++i) {
      const std::uint64_t seed = static_cast<std::uint64_t>(repeat) << 32 | static_cast<std::uint64_t>(i);
      const std::vector<Contact> contacts = bench::graspLikeContacts(seed, some.contacts);
      Actuation actuation = bench::graspLikeActuation(contacts, seed);
      if (some.normalLimits) actuation = bench::withNormalLimits(actuation, contacts, kNormalLimit);
      const LoadMargin margin = processorTimed(bySparse, [&] { return sparse.solve(contacts, actuation, tasks); });
      nOptimal += margin.verdict == LoadVerdict::optimal;
      nZero += margin.verdict == LoadVerdict::zero;
      nUnbounded += margin.verdict == LoadVerdict::unbounded;
      nFailed += margin.verdict == LoadVerdict::failed;
      iterations.push_back(margin.iterations);
      processorTimed(byTask, [&] {
        double least = HUGE_VAL;
        for (Eigen::Index t = 0; t < tasks.cols(); ++t) {
          least = std::min(least, each.solve(contacts, actuation, tasks.col(t)).load);
        }
        return least;
      });
      const testing::TaskProgram program = testing::taskProgram(contacts, actuation, tasks, kModel);
      rows = program.rows;
      columns = program.columns();
      const double load = processorTimed(byClp, [&] { return clp(program); });
      clpGaveUp += std::isnan(load);
      if (!std::isnan(load)) fromClp = std::max(fromClp, disagreement(margin.load, load));
      if (i >= sizes.dense) continue;
      const double other = processorTimed(byDense, [&] { return dense.solve(contacts, actuation, tasks).load; });
      fromDense = std::max(fromDense, disagreement(margin.load, other));
    }
  }
  const double median = bySparse.median();
  return {{"contacts", some.contacts},
          {"tasks", some.tasks},
          {"normal_limits", some.normalLimits},
          {"clp_rows", rows},
          {"clp_columns", columns},
          {"programs", sizes.repeats * sizes.programs},
          {"optimal", nOptimal},
          {"zero", nZero},
          {"unbounded", nUnbounded},
          {"failed", nFailed},
          {"iterations_median", quantile(iterations, 0.5)},
          {"cholmod", bySparse.json()},
          {"dense", byDense.json()},
          {"dense_ratio", byDense.median() / median},
          {"task_by_task", byTask.json()},
          {"task_by_task_ratio", byTask.median() / median},
          {"clp", byClp.json()},
          {"clp_ratio", byClp.median() / median},
          {"clp_gave_up", clpGaveUp},
          {"largest_disagreement_clp", fromClp},
          {"largest_disagreement_dense", fromDense}};
}

std::string milliseconds(const ordered_json& timing) {
  return fmt::format("{:.2f} ({:.2f})", timing["median_us"].get<double>() / 1e3, timing["p90_us"].get<double>() / 1e3);
}

void printTable(const ordered_json& report) {
  fmt::print("{}\n", report["machine"].dump());
  fmt::print(
      "ms of the processor a load margin: median (p90) over different instances, 8 joints. lim: the normal forces have "
      "limits too;\n"
      "by task: the same method on one task after another; differ: the largest relative difference of the loads\n\n");
  fmt::print("{:>3} {:>5} {:>4} {:>6} {:>6} {:>14} {:>16} {:>6} {:>18} {:>6} {:>14} {:>6} {:>9} {:>9} {:>20}\n", "n",
             "tasks", "lim", "rows", "iter", "CHOLMOD", "CLP", "ratio", "dense", "ratio", "by task", "ratio", "differ",
             "(dense)", "opt/zero/inf/failed");
  for (const ordered_json& row : report["results"]) {
    fmt::print(
        "{:>3} {:>5} {:>4} {:>6} {:>6.0f} {:>14} {:>16} {:>6.2f} {:>18} {:>6.1f} {:>14} {:>6.2f} {:>9.0e} {:>9.0e} "
        "{:>20}"
        "\n",
        row["contacts"].get<int>(), row["tasks"].get<int>(), row["normal_limits"].get<bool>() ? "yes" : "no",
        row["clp_rows"].get<int>(), row["iterations_median"].get<double>(), milliseconds(row["cholmod"]),
        milliseconds(row["clp"]), row["clp_ratio"].get<double>(), milliseconds(row["dense"]),
        row["dense_ratio"].get<double>(), milliseconds(row["task_by_task"]), row["task_by_task_ratio"].get<double>(),
        row["largest_disagreement_clp"].get<double>(), row["largest_disagreement_dense"].get<double>(),
        fmt::format("{}/{}/{}/{}", row["optimal"].get<long>(), row["zero"].get<long>(), row["unbounded"].get<long>(),
                    row["failed"].get<long>()));
  }
}

int run(int argc, char** argv) {
  const auto options = bench::parseOptions(argc, argv, "bench_load");
  if (!options) return 2;
  const Sizes sizes = options->quick ? Sizes{3, 10, 1} : Sizes{};
  ordered_json report = {{"machine",
                          {{"cpu", bench::cpuModel()},
                           {"compiler", __VERSION__},
                           {"build_type", HANDHOLD_BUILD_TYPE},
                           {"threads", 1},
                           {"cone_edges", kModel.coneEdges},
                           {"friction", kModel.friction},
                           {"repeats", sizes.repeats}}},
                         {"results", ordered_json::array()}};
  for (const Case& some : kCases) report["results"].push_back(benchOne(some, sizes));
  if (bench::writeReport(report, *options)) printTable(report);
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) { return handhold::run(argc, argv); }
