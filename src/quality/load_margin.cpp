#include "quality/load_margin.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

namespace handhold {
namespace {

using Eigen::MatrixXd;

constexpr int kMostIterations = 60;
constexpr double kResidualTolerance = 1e-7;  // of a row or column, relative to the largest variable
constexpr double kGapTolerance = 1e-7;       // relative to the load
constexpr double kSmallLoad = 0.02;          // in units of force: the gap of a smaller one is that of this
constexpr double kZeroLoad = 1e-7;           // in units of force: less is none
constexpr double kRayTolerance = 1e-5;     // of a ray, for each unit of load: beyond 1e5 units of force no limit counts
constexpr double kNoLever = 1e-12;         // of a lever: rounding, which would be a joint without limit
constexpr double kStepShare = 0.9995;      // of the way to the nearest bound
constexpr double kRegularisation = 1e-15;  // of the diagonal, which lacks rank where contacts do

/// How many there are of what in a scaled program.
struct Sizes {
  int generators = 0, limits = 0, tasks = 0;

  int rows() const { return 6 + 2 * limits + 1; }                // of a task: balance, limits, ranges, link
  int variables() const { return generators + 2 * limits + 1; }  // x, a, b, load
  int block() const { return 6 + limits + 1; }                   // rows when the ranges are eliminated
};

/// Contacts that load the same joints: their columns have no other entries below the balance.
struct Group {
  std::vector<int> rows;         // of the limits
  int first = 0, count = 0;      // generators
  MatrixXd limits;               // (rows, count)
  MatrixXd products;             // (pairs, count): of a limit row with the balance rows, then with limit rows up to it
  std::vector<int> productSlot;  // where each goes in a task's block
};

struct Analysis {
  std::unique_ptr<SymmetricFactor> factor;
  std::vector<std::vector<int>> slot;  // of entry (row, column <= row) in a task's block, -1: none
  int blockEntries = 0;
};

/// The largest -dv / v: one over the longest step that keeps v + step dv >= 0.
double steepest(const MatrixXd& v, const MatrixXd& dv) { return -(dv.array() / v.array()).minCoeff(); }

double largest(const Eigen::Ref<const MatrixXd, 0, Eigen::Stride<Eigen::Dynamic, Eigen::Dynamic>>& m) {
  return m.cwiseAbs().maxCoeff();
}

}  // namespace

/// The program in standard form, min c . z : A z = b, z >= 0, one column a task:
///
///     W x + load w = 0,    L x + a = 1,    a + b = 2,    load_t - load_(t+1) = 0
///
/// and the homogeneous self-dual method on it. Names follow src/quality/README.md.
class LoadMarginSolver::Method {
 public:
  Method(const WrenchModel& model, MakeSymmetricFactor makeFactor)
      : torqueScale_(model.torqueScale), cones_(model), makeFactor_(std::move(makeFactor)) {}

  LoadMargin solve(std::span<const Contact> contacts, const Actuation& actuation, const TaskWrenches& tasks);

 private:
  bool makeProgram(std::span<const Contact> contacts, const Actuation& actuation, const TaskWrenches& tasks);
  void makeGroups(const MatrixXd& wrenches, const MatrixXd& limits);
  void analyse();
  SymmetricPattern patternOf(const Analysis& analysis) const;
  void makeProducts();

  LoadMargin iterate();
  void setResiduals();
  bool isDecided(LoadMargin& result) const;
  bool factorise();
  void solveForCost();
  void solveFor(double eta, double complementTau);
  double longestStep() const;

  void multiply(const MatrixXd& z, MatrixXd& rows) const;
  void multiplyTransposed(const MatrixXd& y, MatrixXd& z) const;
  void solveNormal(MatrixXd& rows);
  double rightSideDot(const MatrixXd& y) const;
  double costDot(const MatrixXd& z) const { return -z.bottomRows(1).sum() / sizes_.tasks; }

  double torqueScale_;
  FrictionCones cones_;
  MakeSymmetricFactor makeFactor_;
  std::map<std::vector<bool>, Analysis> analyses_;

  // the program
  Sizes sizes_;
  std::vector<Group> groups_;
  MatrixXd wrenches_;  // (6, G) W, ordered by groups
  MatrixXd products_;  // (21, G) of pairs of its rows
  MatrixXd tasks_;     // (6, T) w
  double unit_ = 1;    // N, of the load
  Analysis* analysis_ = nullptr;

  // the iterate; z, s, dz, ds and what has their shape are (variables, T), y and what has its shape (rows, T)
  MatrixXd z_, s_, y_;
  double tau_ = 1, kappa_ = 1;
  MatrixXd primalResidual_, dualResidual_;
  double gapResidual_ = 0, mu_ = 0;
  MatrixXd theta_, complement_, dz_, ds_, dy_, costZ_, costY_;
  double dTau_ = 0, dKappa_ = 0;
  MatrixXd balance_, blocks_;  // (21, T) and (entries, T) of the normal equations
  std::vector<double> values_, reduced_;
};

bool LoadMarginSolver::Method::makeProgram(std::span<const Contact> contacts, const Actuation& actuation,
                                           const TaskWrenches& tasks) {
  const auto wrenches = cones_.wrenches(contacts);
  const int nContacts = static_cast<int>(contacts.size()), nGenerators = static_cast<int>(wrenches.cols());
  MatrixXd limits = MatrixXd::Zero(actuation.effort.size(), nGenerators);
  for (int i = 0; i < nContacts; ++i) {
    const int edges = nGenerators / nContacts;
    const auto motion = actuation.motion.middleRows<6>(6 * i);
    const auto own = wrenches.middleCols(edges * i, edges);
    auto loads = limits.middleCols(edges * i, edges);
    loads = motion.topRows<3>().transpose() * own.topRows<3>() +
            torqueScale_ * (motion.bottomRows<3>().transpose() * own.bottomRows<3>());
    for (int d = 0; d < loads.rows(); ++d) {
      const double reach = std::hypot(motion.col(d).head<3>().norm(), torqueScale_ * motion.col(d).tail<3>().norm());
      for (double& load : loads.row(d)) load = std::abs(load) <= kNoLever * reach ? 0 : load;
    }
  }
  limits.array().colwise() /= actuation.effort.array();
  // The unit of force: the geometric mean of what loads each joint to its limit.
  double logarithms = 0;
  int nLoaded = 0;
  for (int d = 0; d < limits.rows(); ++d) {
    const double most = nGenerators == 0 ? 0 : largest(limits.row(d));
    if (most == 0) continue;
    logarithms += std::log(most);
    limits.row(nLoaded++) = limits.row(d);
  }
  const double force = nLoaded == 0 ? 1 : std::exp(-logarithms / nLoaded);
  tasks_ = tasks;
  tasks_.bottomRows<3>() /= torqueScale_;
  const double task = tasks_.colwise().norm().maxCoeff();
  tasks_ /= task;
  unit_ = force / task;
  limits = (force * limits.topRows(nLoaded)).eval();
  sizes_ = {nGenerators, nLoaded, static_cast<int>(tasks.cols())};
  if (!wrenches.allFinite() || !limits.allFinite() || !tasks_.allFinite() || !(unit_ > 0) || !std::isfinite(unit_)) {
    return false;
  }
  makeGroups(wrenches, limits);
  return true;
}

void LoadMarginSolver::Method::makeGroups(const MatrixXd& wrenches, const MatrixXd& limits) {
  std::map<std::vector<int>, std::vector<int>> generatorsOf;  // by the rows that they enter
  for (int j = 0; j < sizes_.generators; ++j) {
    std::vector<int> rows;
    for (int d = 0; d < sizes_.limits; ++d) {
      if (limits(d, j) != 0) rows.push_back(d);
    }
    generatorsOf[rows].push_back(j);
  }
  groups_.clear();
  wrenches_.resize(6, sizes_.generators);
  int next = 0;
  for (const auto& [rows, generators] : generatorsOf) {
    Group& group = groups_.emplace_back();
    group.rows = rows;
    group.first = next;
    group.count = static_cast<int>(generators.size());
    group.limits = limits(rows, generators);
    wrenches_.middleCols(next, group.count) = wrenches(Eigen::all, generators);
    next += group.count;
  }
}

void LoadMarginSolver::Method::analyse() {
  const int D = sizes_.limits, nRows = 6 + D;
  std::vector<bool> key(static_cast<std::size_t>(D * D), false);  // limits that share a group
  for (const Group& group : groups_) {
    for (const int a : group.rows) {
      for (const int b : group.rows) key[static_cast<std::size_t>(a) * D + b] = true;
    }
  }
  std::vector<std::vector<int>> slot(static_cast<std::size_t>(nRows), std::vector<int>(nRows, -1));
  int entries = 0;
  for (int column = 0; column < nRows; ++column) {
    for (int row = column; row < nRows; ++row) {
      if (column < 6 || key[static_cast<std::size_t>((row - 6) * D + column - 6)]) slot[row][column] = entries++;
    }
  }
  for (int bit = 0; bit < 32; ++bit) key.push_back((sizes_.tasks >> bit & 1) != 0);
  Analysis& analysis = analyses_[key];
  analysis_ = &analysis;
  if (analysis.factor) return;
  analysis.slot = std::move(slot);
  analysis.blockEntries = entries;
  analysis.factor = makeFactor_(patternOf(analysis));
}

/// Task by task: the block's own entries by columns, each balance column with the link's row below; then the link's
/// column, with the balance and the link of the next task.
SymmetricPattern LoadMarginSolver::Method::patternOf(const Analysis& analysis) const {
  const int nRows = 6 + sizes_.limits, T = sizes_.tasks;
  SymmetricPattern pattern;
  pattern.size = sizes_.block() * T - 1;
  pattern.start = {0};
  for (int t = 0; t < T; ++t) {
    const int first = sizes_.block() * t, link = first + nRows;
    for (int column = 0; column < nRows; ++column) {
      for (int row = column; row < nRows; ++row) {
        if (analysis.slot[row][column] >= 0) pattern.row.push_back(first + row);
      }
      if (column < 6 && t + 1 < T) pattern.row.push_back(link);
      pattern.start.push_back(static_cast<int>(pattern.row.size()));
    }
    if (t + 1 == T) break;
    pattern.row.push_back(link);
    for (int k = 0; k < 6; ++k) pattern.row.push_back(link + 1 + k);
    if (t + 2 < T) pattern.row.push_back(link + sizes_.block());
    pattern.start.push_back(static_cast<int>(pattern.row.size()));
  }
  return pattern;
}

void LoadMarginSolver::Method::makeProducts() {
  products_.resize(21, sizes_.generators);
  for (int column = 0, i = 0; column < 6; ++column) {
    for (int row = column; row < 6; ++row) products_.row(i++) = wrenches_.row(row).cwiseProduct(wrenches_.row(column));
  }
  for (Group& group : groups_) {
    const int n = static_cast<int>(group.rows.size());
    const auto wrenches = wrenches_.middleCols(group.first, group.count);
    group.products.resize(6 * n + n * (n + 1) / 2, group.count);
    group.productSlot.clear();
    for (int a = 0, i = 0; a < n; ++a) {
      const auto& slots = analysis_->slot[6 + static_cast<std::size_t>(group.rows[a])];
      for (int k = 0; k < 6; ++k) {
        group.products.row(i++) = group.limits.row(a).cwiseProduct(wrenches.row(k));
        group.productSlot.push_back(slots[k]);
      }
      for (int b = 0; b <= a; ++b) {
        group.products.row(i++) = group.limits.row(a).cwiseProduct(group.limits.row(b));
        group.productSlot.push_back(slots[6 + group.rows[b]]);
      }
    }
  }
}

void LoadMarginSolver::Method::multiply(const MatrixXd& z, MatrixXd& rows) const {
  const int G = sizes_.generators, D = sizes_.limits, T = sizes_.tasks;
  const auto load = z.row(sizes_.variables() - 1);
  rows.resize(sizes_.rows(), T);
  rows.topRows(6).noalias() = wrenches_ * z.topRows(G);
  rows.topRows(6) += tasks_ * load.asDiagonal();
  rows.middleRows(6, D) = z.middleRows(G, D);
  rows.middleRows(6 + D, D) = z.middleRows(G, D) + z.middleRows(G + D, D);
  rows.row(sizes_.rows() - 1).head(T - 1) = load.head(T - 1) - load.tail(T - 1);
  rows(sizes_.rows() - 1, T - 1) = 0;
  for (const Group& group : groups_) {
    if (group.rows.empty()) continue;
    const MatrixXd part = group.limits * z.middleRows(group.first, group.count);
    for (int t = 0; t < T; ++t) {
      for (std::size_t a = 0; a < group.rows.size(); ++a) rows(6 + group.rows[a], t) += part(static_cast<int>(a), t);
    }
  }
}

void LoadMarginSolver::Method::multiplyTransposed(const MatrixXd& y, MatrixXd& z) const {
  const int G = sizes_.generators, D = sizes_.limits, T = sizes_.tasks;
  const auto link = y.row(sizes_.rows() - 1);
  z.resize(sizes_.variables(), T);
  z.topRows(G).noalias() = wrenches_.transpose() * y.topRows(6);
  z.middleRows(G, D) = y.middleRows(6, D) + y.middleRows(6 + D, D);
  z.middleRows(G + D, D) = y.middleRows(6 + D, D);
  z.bottomRows(1) = (tasks_.cwiseProduct(y.topRows(6))).colwise().sum() + link;
  z.row(sizes_.variables() - 1).tail(T - 1) -= link.head(T - 1);
  for (const Group& group : groups_) {
    if (group.rows.empty()) continue;
    MatrixXd part(group.rows.size(), T);
    for (int t = 0; t < T; ++t) {
      for (std::size_t a = 0; a < group.rows.size(); ++a) part(static_cast<int>(a), t) = y(6 + group.rows[a], t);
    }
    z.middleRows(group.first, group.count).noalias() += group.limits.transpose() * part;
  }
}

bool LoadMarginSolver::Method::factorise() {
  const int G = sizes_.generators, D = sizes_.limits, T = sizes_.tasks, nRows = 6 + D;
  balance_.noalias() = products_ * theta_.topRows(G);
  blocks_.setZero(analysis_->blockEntries, T);
  for (const Group& group : groups_) {
    if (group.rows.empty()) continue;
    const MatrixXd part = group.products * theta_.middleRows(group.first, group.count);
    for (int t = 0; t < T; ++t) {
      for (std::size_t i = 0; i < group.productSlot.size(); ++i) {
        blocks_(group.productSlot[i], t) += part(static_cast<int>(i), t);
      }
    }
  }
  const auto load = theta_.row(sizes_.variables() - 1);
  values_.clear();
  for (int t = 0; t < T; ++t) {
    for (int column = 0, i = 0; column < nRows; ++column) {
      const std::size_t diagonal = values_.size();
      if (column < 6) {
        for (int row = column; row < 6; ++row) {
          values_.push_back(balance_(i++, t) + load[t] * tasks_(row, t) * tasks_(column, t));
        }
      } else {
        const double a = theta_(G + column - 6, t), b = theta_(G + D + column - 6, t);
        values_.push_back(blocks_(analysis_->slot[column][column], t) + a * b / (a + b));
      }
      values_[diagonal] *= 1 + kRegularisation;
      values_[diagonal] += kRegularisation;
      for (int row = std::max(6, column + 1); row < nRows; ++row) {
        const int slot = analysis_->slot[row][column];
        if (slot >= 0) values_.push_back(blocks_(slot, t));
      }
      if (column < 6 && t + 1 < T) values_.push_back(load[t] * tasks_(column, t));
    }
    if (t + 1 == T) break;
    values_.push_back(load[t] + load[t + 1]);
    for (int k = 0; k < 6; ++k) values_.push_back(-load[t + 1] * tasks_(k, t + 1));
    if (t + 2 < T) values_.push_back(-load[t + 1]);
  }
  return analysis_->factor->factorise(values_);
}

/// rows <- (A theta A^T)^-1 rows. The ranges' own block is diagonal: they are eliminated first.
void LoadMarginSolver::Method::solveNormal(MatrixXd& rows) {
  const int G = sizes_.generators, D = sizes_.limits, T = sizes_.tasks;
  reduced_.resize(static_cast<std::size_t>(sizes_.block()) * T);
  Eigen::Map<MatrixXd> reduced(reduced_.data(), sizes_.block(), T);
  const auto a = theta_.middleRows(G, D).array(), b = theta_.middleRows(G + D, D).array();
  auto limit = rows.middleRows(6, D).array(), range = rows.middleRows(6 + D, D).array();
  limit -= a / (a + b) * range;
  reduced.topRows(6 + D) = rows.topRows(6 + D);
  reduced.bottomRows(1) = rows.bottomRows(1);
  analysis_->factor->solve(reduced_.data());  // all but the last link, which does not exist
  rows.topRows(6 + D) = reduced.topRows(6 + D);
  rows.bottomRows(1) = reduced.bottomRows(1);
  range = (range - a * limit) / (a + b);
}

double LoadMarginSolver::Method::rightSideDot(const MatrixXd& y) const {
  const int D = sizes_.limits;
  return y.middleRows(6, D).sum() + 2 * y.middleRows(6 + D, D).sum();
}

void LoadMarginSolver::Method::setResiduals() {
  const int D = sizes_.limits;
  multiply(z_, primalResidual_);
  primalResidual_ *= -1;
  primalResidual_.middleRows(6, D).array() += tau_;
  primalResidual_.middleRows(6 + D, D).array() += 2 * tau_;
  multiplyTransposed(y_, dualResidual_);
  dualResidual_ = -dualResidual_ - s_;
  dualResidual_.bottomRows(1).array() -= tau_ / sizes_.tasks;
  gapResidual_ = kappa_ + costDot(z_) - rightSideDot(y_);
  mu_ = (z_.cwiseProduct(s_).sum() + tau_ * kappa_) / (static_cast<double>(z_.size()) + 1);
}

/// Has the iterate a load that is feasible and meets its bound, or a ray? Both are read off the residuals, which were
/// computed from the iterate itself.
bool LoadMarginSolver::Method::isDecided(LoadMargin& result) const {
  const int D = sizes_.limits;
  const double load = -costDot(z_);  // these two times 1 / tau
  const double bound = -rightSideDot(y_);
  const double primalError = largest(primalResidual_), dualError = largest(dualResidual_);
  const bool feasible = primalError <= kResidualTolerance * std::max(tau_, largest(z_));
  const bool bounded = dualError <= kResidualTolerance * std::max(tau_ / sizes_.tasks, largest(y_));
  if (feasible && bounded && bound <= kZeroLoad * tau_) {
    result.verdict = LoadVerdict::zero;
    result.gap = std::max(0.0, bound / tau_);
    return true;
  }
  // What the residuals can change in the two.
  const double error =
      (y_.cwiseProduct(primalResidual_).cwiseAbs().sum() + z_.cwiseProduct(dualResidual_).cwiseAbs().sum()) / tau_;
  if (feasible && bounded && std::abs(bound - load) + error <= kGapTolerance * std::max(load, kSmallLoad * tau_)) {
    result.verdict = LoadVerdict::optimal;
    result.load = load / tau_;
    result.gap = (std::abs(bound - load) + error) / tau_;
    return true;
  }
  // A z of a ray is zero; b tau is what the residual has beside it.
  const double ray = std::max({largest(primalResidual_.topRows(6)), largest(primalResidual_.bottomRows(1)),
                               D > 0 ? 2 * tau_ + largest(primalResidual_.middleRows(6, 2 * D)) : 0});
  if (ray <= kRayTolerance * load) {
    result.verdict = LoadVerdict::unbounded;
    return true;
  }
  return false;
}

/// (costY, costZ): the direction for one unit of tau.
void LoadMarginSolver::Method::solveForCost() {
  const int D = sizes_.limits, T = sizes_.tasks;
  const double cost = -1.0 / T;
  const auto load = theta_.row(sizes_.variables() - 1);
  costY_.setZero(sizes_.rows(), T);
  costY_.topRows(6) = cost * tasks_ * load.asDiagonal();
  costY_.middleRows(6, D).setConstant(1);
  costY_.middleRows(6 + D, D).setConstant(2);
  costY_.row(sizes_.rows() - 1).head(T - 1) = cost * (load.head(T - 1) - load.tail(T - 1));
  solveNormal(costY_);
  multiplyTransposed(costY_, costZ_);
  costZ_.bottomRows(1).array() -= cost;
  costZ_.array() *= theta_.array();
}

/// The Newton direction that removes the share eta of the residuals; complement_ has (wanted z s - z s) / z.
void LoadMarginSolver::Method::solveFor(double eta, double complementTau) {
  ds_ = eta * dualResidual_ - complement_;
  dz_ = theta_.cwiseProduct(ds_);
  multiply(dz_, dy_);
  dy_ += eta * primalResidual_;
  solveNormal(dy_);
  multiplyTransposed(dy_, dz_);
  dz_ = theta_.cwiseProduct(dz_ - ds_);
  const double own = rightSideDot(costY_) - costDot(costZ_) + kappa_ / tau_;
  dTau_ = (eta * gapResidual_ + complementTau / tau_ - rightSideDot(dy_) + costDot(dz_)) / own;
  dKappa_ = (complementTau - kappa_ * dTau_) / tau_;
  dz_ += dTau_ * costZ_;
  dy_ += dTau_ * costY_;
  ds_ = complement_ - dz_.cwiseQuotient(theta_);
}

double LoadMarginSolver::Method::longestStep() const {
  return 1 / std::max({steepest(z_, dz_), steepest(s_, ds_), -dTau_ / tau_, -dKappa_ / kappa_, 1e-10});
}

LoadMargin LoadMarginSolver::Method::iterate() {
  z_.setOnes(sizes_.variables(), sizes_.tasks);
  s_.setOnes(sizes_.variables(), sizes_.tasks);
  y_.setZero(sizes_.rows(), sizes_.tasks);
  tau_ = kappa_ = 1;
  LoadMargin result;
  for (; result.iterations < kMostIterations; ++result.iterations) {
    setResiduals();
    if (isDecided(result)) return result;
    theta_ = z_.cwiseQuotient(s_);
    if (!factorise()) return result;
    solveForCost();
    complement_ = -s_;
    solveFor(1, -tau_ * kappa_);
    const double gamma = std::max(1e-8, std::pow(1 - std::min(1.0, longestStep()), 3));
    complement_.array() = (gamma * mu_ - dz_.array() * ds_.array()) / z_.array() - s_.array();
    solveFor(1 - gamma, gamma * mu_ - tau_ * kappa_ - dTau_ * dKappa_);
    const double step = std::min(1.0, kStepShare * longestStep());
    if (!(step > 1e-9)) return result;
    z_ += step * dz_;
    s_ += step * ds_;
    y_ += step * dy_;
    tau_ += step * dTau_;
    kappa_ += step * dKappa_;
  }
  return result;
}

LoadMargin LoadMarginSolver::Method::solve(std::span<const Contact> contacts, const Actuation& actuation,
                                           const TaskWrenches& tasks) {
  assert(actuation.motion.rows() == 6 * static_cast<Eigen::Index>(contacts.size()));
  assert(actuation.motion.cols() == actuation.effort.size());
  LoadMargin result;
  result.load = std::numeric_limits<double>::quiet_NaN();
  if (!tasks.allFinite()) return result;
  if (tasks.isZero(0)) {
    result = {LoadVerdict::unbounded, std::numeric_limits<double>::infinity(), 0, 0};
    return result;
  }
  if (!makeProgram(contacts, actuation, tasks)) return result;
  analyse();
  makeProducts();
  result = iterate();
  result.load *= unit_;
  result.gap *= unit_;
  if (result.verdict == LoadVerdict::failed) result.load = std::numeric_limits<double>::quiet_NaN();
  if (result.verdict == LoadVerdict::unbounded) result.load = std::numeric_limits<double>::infinity();
  return result;
}

LoadMarginSolver::LoadMarginSolver(const WrenchModel& model, MakeSymmetricFactor makeFactor)
    : method_(std::make_unique<Method>(model, std::move(makeFactor))) {}
LoadMarginSolver::~LoadMarginSolver() = default;
LoadMarginSolver::LoadMarginSolver(LoadMarginSolver&&) noexcept = default;

LoadMargin LoadMarginSolver::solve(std::span<const Contact> contacts, const Actuation& actuation,
                                   const TaskWrenches& tasks) {
  return method_->solve(contacts, actuation, tasks);
}

TaskWrenches weightDirections(int count) {
  TaskWrenches tasks = TaskWrenches::Zero(6, count);
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count, radius = std::sqrt(1 - z * z);
    tasks.col(i).head<3>() << radius * std::cos(golden * i), radius * std::sin(golden * i), z;
  }
  return tasks;
}

}  // namespace handhold
