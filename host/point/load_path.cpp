#include "point/load_path.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace cleave::point {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr int bisections = 8;
constexpr int confining_increments = 10;

struct Entry {
  int i, j;
};

/// The entries of F that are solved for, and the Cauchy stress they have to bring about.
struct Control {
  std::vector<Entry> unknowns;
  Matrix3 deformation = Matrix3::Identity();  ///< prescribed entries; the unknown ones do not count
  double pressure = 0;                        ///< the normal stress at unknown entries is -pressure, the shear stress 0
};

/// Prescribed values at a fraction in [0,1] of a stage of the path.
using Stage = std::function<Control(double)>;

/// A converged state of the path.
struct Converged {
  Matrix3 deformation = Matrix3::Identity();  ///< total F
  Matrix3 elastic = Matrix3::Identity();
  double damage = 0;
  std::vector<double> variables;
  Response response;
};

class Driver {
 public:
  Driver(const Laws& laws, Evaluator& evaluator) : laws_(laws), evaluator_(evaluator) {
    current_.variables = initial_variables(laws);
  }

  const Converged& current() const { return current_; }
  void settle() { current_ = trial(current_.deformation); }

  /// From fraction `from` to `to` of a stage. If there is no state, the attempt that failed is left in failed().
  bool advance(const Stage& stage, double from, double to, int depth = 0) {
    const Control control = stage(to);
    Converged found = control.unknowns.empty() ? trial(control.deformation) : solve(control);
    if (found.response.usable()) {
      current_ = std::move(found);
      return true;
    }
    // Where nothing is solved for, only a law that asks for it gains from smaller increments.
    const bool may_help = !control.unknowns.empty() || found.response.status == CLEAVE_STATUS_RETRY;
    if (!may_help || depth == bisections) {
      failed_ = std::move(found);
      for (const Entry e : control.unknowns) failed_.deformation(e.i, e.j) = nan;
      failed_.damage = nan;
      return false;
    }
    const double middle = (from + to) / 2;
    return advance(stage, from, middle, depth + 1) && advance(stage, middle, to, depth + 1);
  }
  const Converged& failed() const { return failed_; }

 private:
  Response evaluate(const State& state) {
    Response response;
    evaluator_.evaluate({&state, 1}, {&response, 1});
    return response;
  }

  /// The state after an increment from the current state to a total deformation.
  Converged trial(const Matrix3& deformation) {
    Converged next;
    next.deformation = deformation;
    State state;
    // Without flow F_e is F; taking it directly keeps rounding from piling up.
    state.deformation =
        laws_.plasticity ? Matrix3(deformation * current_.deformation.inverse() * current_.elastic) : deformation;
    state.variables = current_.variables;
    state.damage = state.degrading_damage = next.damage = current_.damage;
    next.response = evaluate(state);
    if (laws_.damage) equilibrate_damage(state, next);
    if (!next.response.usable()) return next;
    next.elastic = next.response.deformation;
    next.variables = next.response.variables;
    return next;
  }

  void equilibrate_damage(State& state, Converged& next) {
    constexpr int iterations = 200;
    for (int i = 0; i < iterations; ++i) {
      if (!next.response.usable()) return;
      const double D = next.response.driving_force;
      const double wanted = laws_.damage_is_local ? next.response.damage : D / (1 + D);
      const double damage = std::clamp(wanted, current_.damage, 1.0);
      if (std::abs(damage - state.degrading_damage) <= evaluator_.epsilon()) return;
      next.damage = state.degrading_damage = damage;
      // A local law starts each increment from the damage before it; the others are asked for their equilibrium.
      if (!laws_.damage_is_local) state.damage = damage;
      next.response = evaluate(state);
    }
    next.response.status = std::max<cleave_status>(next.response.status, CLEAVE_STATUS_RETRY);
  }

  Eigen::VectorXd residual(const Control& control, const Response& response) const {
    const Matrix3 cauchy = response.kirchhoff / response.volume_ratio;
    Eigen::VectorXd r(Eigen::Index(control.unknowns.size()));
    for (Eigen::Index k = 0; k < r.size(); ++k) {
      const auto [i, j] = control.unknowns[std::size_t(k)];
      r[k] = cauchy(i, j) + (i == j ? control.pressure : 0);
    }
    return r;
  }

  static Matrix3 with(const Control& control, const Eigen::VectorXd& unknowns) {
    Matrix3 deformation = control.deformation;
    for (Eigen::Index k = 0; k < unknowns.size(); ++k) {
      const auto [i, j] = control.unknowns[std::size_t(k)];
      deformation(i, j) = unknowns[k];
    }
    return deformation;
  }

  std::optional<Eigen::MatrixXd> tangent(const Control& control, const Eigen::VectorXd& unknowns) {
    const double step = std::cbrt(evaluator_.epsilon());
    Eigen::MatrixXd slope(unknowns.size(), unknowns.size());
    for (Eigen::Index k = 0; k < unknowns.size(); ++k) {
      Eigen::VectorXd before = unknowns, after = unknowns;
      before[k] -= step;
      after[k] += step;
      const Response low = trial(with(control, before)).response, high = trial(with(control, after)).response;
      if (!low.usable() || !high.usable()) return std::nullopt;
      slope.col(k) = (residual(control, high) - residual(control, low)) / (2 * step);
    }
    return slope;
  }

  Converged solve(const Control& control) {
    constexpr int iterations = 60;
    constexpr double shortest = 1.0 / 1024;
    const double small = std::pow(evaluator_.epsilon(), 2.0 / 3.0) * laws_.stiffness;
    Eigen::VectorXd unknowns(Eigen::Index(control.unknowns.size()));
    for (Eigen::Index k = 0; k < unknowns.size(); ++k) {
      const auto [i, j] = control.unknowns[std::size_t(k)];
      unknowns[k] = current_.deformation(i, j);
    }
    Converged best = trial(with(control, unknowns));
    if (!best.response.usable()) return best;
    Eigen::VectorXd r = residual(control, best.response);
    for (int iteration = 0; iteration < iterations && r.norm() > 0; ++iteration) {
      const auto slope = tangent(control, unknowns);
      if (!slope) break;
      const Eigen::VectorXd newton = slope->fullPivLu().solve(-r);
      if (!newton.allFinite()) break;
      const double before = r.norm();
      for (double length = 1; length >= shortest; length /= 2) {
        const Eigen::VectorXd attempt = unknowns + length * newton;
        Converged next = trial(with(control, attempt));
        if (!next.response.usable()) continue;
        const Eigen::VectorXd there = residual(control, next.response);
        if (!(there.norm() < before)) continue;
        best = std::move(next);
        unknowns = attempt;
        r = there;
        break;
      }
      // Newton's steps are taken for as long as they gain: the last ones bring the residual down to rounding.
      if (r.norm() == before || (before <= small && r.norm() > before / 2)) break;
    }
    if (r.norm() > small) best.response.status = CLEAVE_STATUS_RETRY;
    return best;
  }

  const Laws& laws_;
  Evaluator& evaluator_;
  Converged current_, failed_;
};

const std::vector<Entry> lateral = {{1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
const std::vector<Entry> all_entries = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};

Stage loading(const LoadPath& path, const Matrix3& start) {
  return [path, start](double fraction) {
    const double strain = path.amplitude * fraction;
    Control control;
    switch (path.kind) {
      case PathKind::uniaxial_strain:
        control.deformation(0, 0) += strain;
        break;
      case PathKind::simple_shear:
        control.deformation(0, 1) = strain;
        break;
      case PathKind::hydrostatic:
        control.deformation *= 1 + strain;
        break;
      case PathKind::uniaxial_stress:
      case PathKind::triaxial:
        control.deformation(0, 0) = start(0, 0) * (1 + strain);
        control.pressure = path.confinement;
        control.unknowns = lateral;
        break;
    }
    return control;
  };
}

Stage confining(const LoadPath& path) {
  return [path](double fraction) { return Control{all_entries, Matrix3::Identity(), path.confinement * fraction}; };
}

}  // namespace

const std::vector<std::string>& path_names() {
  static const std::vector<std::string> names = {"uniaxial-strain", "uniaxial-stress", "simple-shear", "hydrostatic",
                                                 "triaxial"};
  return names;
}

bool drive(const Laws& laws, Evaluator& evaluator, const LoadPath& path, const std::function<void(const PathPoint&)>& report) {
  Driver driver(laws, evaluator);
  const auto tell = [&](int step, const Converged& at) { report({step, at.deformation, at.damage, at.response}); };
  const auto run = [&](const Stage& stage, int increments, const std::function<void(int)>& reached) {
    for (int k = 1; k <= increments; ++k) {
      if (!driver.advance(stage, double(k - 1) / increments, double(k) / increments)) return k;
      if (reached) reached(k);
    }
    return 0;
  };

  driver.settle();
  const bool confined = path.kind == PathKind::triaxial && path.confinement != 0;
  if (confined && run(confining(path), confining_increments, {}) != 0) {
    tell(0, driver.failed());
    return false;
  }
  tell(0, driver.current());
  if (!driver.current().response.usable()) return false;
  const int failed = run(loading(path, driver.current().deformation), path.steps, [&](int k) { tell(k, driver.current()); });
  if (failed != 0) tell(failed, driver.failed());
  return failed == 0;
}

}  // namespace cleave::point
