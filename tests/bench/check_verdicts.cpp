#include "bench/check_verdicts.h"

#include "bench/clp_margin.h"
#include "bench/grasp_like_contacts.h"
#include "quality/references.h"
#include "quality/true_cone.h"
#include "store/database.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/LU>

namespace handhold::bench {
namespace {

using Real = long double;
using RealVector = Eigen::Matrix<Real, 6, 1>;
using RealMatrix = Eigen::Matrix<Real, 6, 6>;

/// Is w0 the strictly positive mixture of all columns that src/quality/README.md says, for one of the leading wrenches?
bool isStrictMixture(const WrenchMatrix& wrenches, const RealVector& w0, Real radius) {
  const Eigen::Index n = wrenches.cols();
  RealVector mean = RealVector::Zero();
  Real total = 0, fraction = 0;
  for (Eigen::Index j = 0; j < n; ++j) {
    if (j % 64 == 0) fraction = 0;
    fraction += 0.6180339887498949L;
    fraction -= fraction >= 1 ? 1 : 0;
    mean += (0.5L + fraction) * wrenches.col(j).cast<Real>();
    total += 0.5L + fraction;
  }
  mean /= total;
  for (Eigen::Index j = 0; j < n; ++j) {
    if ((0.7L * wrenches.col(j).cast<Real>() + 0.3L * mean - w0).norm() < 1e-13L * radius) return true;
  }
  return false;
}

/// Radius of the largest ball about the origin in the simplex of six columns and w0; not positive when it is outside.
/// Each facet's plane is solved for on its own.
Real inradius(const WrenchMatrix& wrenches, const ForceClosureResult& result) {
  Eigen::Matrix<Real, 6, 7> corners;
  for (int k = 0; k < 6; ++k) corners.col(k) = wrenches.col(result.basis[k]).cast<Real>();
  corners.col(6) = result.interiorPoint.cast<Real>();
  Real least = HUGE_VALL;
  for (int missed = 0; missed < 7; ++missed) {
    RealMatrix facet;
    for (int k = 0, row = 0; k < 7; ++k) {
      if (k != missed) facet.row(row++) = corners.col(k).transpose();
    }
    const Eigen::FullPivLU<RealMatrix> lu(facet);
    if (!lu.isInvertible()) return 0;
    const RealVector n = lu.solve(RealVector::Ones());  // n . v = 1 on the facet, so that the origin is below it
    if (!(n.dot(corners.col(missed)) < 1)) return 0;    // and the simplex has to be below it too
    least = std::min(least, 1 / n.norm());
  }
  return least;
}

class Checker {
 public:
  void check(const WrenchMatrix& wrenches, VerdictCounts& counts) {
    const ForceClosureResult result = testForceClosure(wrenches);
    const bool closed = result.verdict == ForceClosure::closed;
    ++counts.sets;
    counts.failed += result.verdict == ForceClosure::failed;
    const Real radius = wrenches.size() == 0 ? 0 : wrenches.colwise().norm().maxCoeff();
    if (closed) {
      ++counts.closed;
      const Real ball = inradius(wrenches, result);
      const bool proved = ball > 0 && isStrictMixture(wrenches, result.interiorPoint.cast<Real>(), radius);
      counts.wrongClosed += !proved;
      counts.leastInradius = std::min(counts.leastInradius, static_cast<double>(ball / radius));
    } else if (result.verdict == ForceClosure::notClosed) {
      ++counts.notClosed;
      const RealVector d = result.separatingDirection.cast<Real>();
      const Real beyond = wrenches.size() == 0 ? 0 : (d.transpose() * wrenches.cast<Real>()).maxCoeff() / d.norm();
      counts.wrongNotClosed += !(beyond <= kProofMargin * radius);
    }
    checkByClp(wrenches, result.verdict, counts);
  }

 private:
  void checkByClp(const WrenchMatrix& wrenches, ForceClosure verdict, VerdictCounts& counts) {
    const bool closed = verdict == ForceClosure::closed, failed = verdict == ForceClosure::failed;
    const double margin = wrenches.cols() < 7 ? -HUGE_VAL : clpMargin_(wrenches);
    const bool decided = std::abs(margin) > kClpMargin;  // not when NaN
    const bool clpClosed = margin > 0 && testing::hasFullRank(wrenches);
    counts.clpUndecided += !decided;
    counts.clpDisagrees += decided && (failed || clpClosed != closed);
  }

  ClpMargin clpMargin_;
};

/// The friction at which a set becomes force closed, to 1e-14 of itself; 1 when it is not closed even then.
double borderFriction(const std::vector<Contact>& contacts, WrenchModel model) {
  double open = 0, closed = 1;
  while (closed - open > 1e-14 * closed) {
    model.friction = 0.5 * (open + closed);
    const bool isClosed = testForceClosure(frictionConeWrenches(contacts, model)).verdict == ForceClosure::closed;
    (isClosed ? closed : open) = model.friction;
    if (!(open < model.friction || closed > model.friction)) break;
  }
  return closed;
}

}  // namespace

VerdictCounts checkRandomVerdicts(int nSets) {
  VerdictCounts counts;
  Checker checker;
  for (int i = 0; i < nSets; ++i) {
    const RandomStream stream = RandomStream(static_cast<std::uint64_t>(i)).child(977);
    const int nContacts = 2 + static_cast<int>(15 * stream.uniform(0));
    const std::uint64_t seed = std::uint64_t{1} << 40 | static_cast<std::uint64_t>(i);
    const bool graspLike = i % 4 == 1 || i % 8 == 2;
    const std::vector<Contact> contacts = graspLike ? graspLikeContacts(seed, nContacts)
                                                    : testing::randomContacts(seed, nContacts, 0.5 * stream.uniform(1));
    WrenchModel model{{0, 0, 0}, graspLike ? 0.09 : 1.0, 0.2 + 0.6 * stream.uniform(2), 8};
    if (i % 4 >= 2) {
      const double off = std::pow(10.0, -2 - 10 * stream.uniform(3));
      model.friction = borderFriction(contacts, model) * (stream.uniform(4) < 0.5 ? 1 - off : 1 + off);
    }
    checker.check(frictionConeWrenches(contacts, model), counts);
  }
  return counts;
}

namespace {

std::vector<Contact> contactsOf(const GraspSet& set, std::size_t grasp) {
  std::vector<Contact> contacts;
  for (std::size_t c = set.contactBegin[grasp]; c < set.contactBegin[grasp + 1]; ++c) {
    const auto at = [&](const std::vector<float>& v) { return Eigen::Vector3d(v[3 * c], v[3 * c + 1], v[3 * c + 2]); };
    contacts.push_back({at(set.contactPosition), at(set.contactNormal), set.contactLink[c]});
  }
  return contacts;
}

/// visit(set, grasp) for up to `nGrasps` grasps, as many of each set as can be, spread over its ranks.
template <class Visit>
void forEachStoredGrasp(const std::filesystem::path& database, int nGrasps, const Visit& visit) {
  std::size_t missing = static_cast<std::size_t>(nGrasps);
  const std::vector<std::filesystem::path> files = Database(database).files();
  for (std::size_t f = 0; f < files.size(); ++f) {
    const GraspSet set = readGraspSet(files[f]);
    const std::size_t setsLeft = files.size() - f;
    const std::size_t n = std::min(set.graspCount(), (missing + setsLeft - 1) / setsLeft);
    for (std::size_t i = 0; i < n; ++i) visit(set, i * set.graspCount() / n);
    missing -= n;
  }
}

/// Epsilon on the cone of many edges; 0 when not closed.
double manyEdgeEpsilon(const std::vector<Contact>& contacts, const WrenchModel& model) {
  const WrenchMatrix w = frictionConeWrenches(contacts, model);
  const ForceClosureResult closure = testForceClosure(w);
  return closure.verdict == ForceClosure::closed ? epsilonMetric(w, closure) : 0;
}

}  // namespace

StoredVerdicts checkStoredVerdicts(const std::filesystem::path& database, int nGrasps) {
  StoredVerdicts verdicts;
  Checker checker;
  forEachStoredGrasp(database, nGrasps, [&](const GraspSet& set, std::size_t grasp) {
    const WrenchModel model{set.centerOfMass, set.torqueScale, set.friction, set.coneEdges, set.torsionRadius};
    std::vector<Contact> contacts = contactsOf(set, grasp);
    checker.check(frictionConeWrenches(contacts, model), verdicts.whole);
    const std::uint16_t link = contacts[grasp % contacts.size()].link;
    std::erase_if(contacts, [&](const Contact& contact) { return contact.link == link; });
    checker.check(frictionConeWrenches(contacts, model), verdicts.withoutOneLink);
  });
  return verdicts;
}

BoundCounts checkStoredBounds(const std::filesystem::path& database, int nGrasps) {
  constexpr double kRounding = 4 * kEpsilonTolerance;
  const double circumscribed = 1 / std::cos(std::numbers::pi / kManyEdges);
  BoundCounts counts;
  forEachStoredGrasp(database, nGrasps, [&](const GraspSet& set, std::size_t grasp) {
    if (set.torsionRadius > 0) return;
    const std::vector<Contact> contacts = contactsOf(set, grasp);
    const auto model = [&](double friction) {
      return WrenchModel{set.centerOfMass, set.torqueScale, friction, kManyEdges};
    };
    const double lower = set.epsilonLower[grasp], upper = set.epsilonUpper[grasp];
    if (std::isnan(lower)) {
      ++counts.unknown;
    } else {
      const double slack = kBoundsGap * upper + kRounding;
      ++counts.sets;
      counts.outOfBracket += !(lower >= manyEdgeEpsilon(contacts, model(set.friction)) - slack) ||
                             !(upper <= manyEdgeEpsilon(contacts, model(circumscribed * set.friction)) + slack);
    }
    const double critical = set.criticalFriction[grasp];
    if (!(critical > kLeastFriction)) return;
    const auto isClosed = [&](double friction) {
      return testForceClosure(frictionConeWrenches(contacts, model(friction))).verdict == ForceClosure::closed;
    };
    ++counts.frictions;
    counts.notConfirmed += !isClosed(1.01 * critical) || isClosed(0.99 * critical * circumscribed);
  });
  return counts;
}

}  // namespace handhold::bench
