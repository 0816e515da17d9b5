#include <cleave/dual.hpp>
#include <cleave/tensor.hpp>
#include <cleave/testkit/lent.hpp>
#include <cleave/testkit/plugin.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <thread>
#include <vector>

namespace cleave::testkit {
namespace {

constexpr double mu = Material::shear_modulus, kappa = Material::bulk_modulus;

Matrix3<double> matrix(const double* values) {
  Matrix3<double> m;
  for (int c = 0; c < 9; ++c) m[c] = values[c];
  return m;
}

template <class T>
Matrix3<T> stress(const Matrix3<T>& F) {
  const T J = determinant(F);
  const Matrix3<T> inverse_transpose = cofactor(F) / J;
  return mu * exp(T(-2.0 / 3) * log(J)) * (F - squared_norm(F) / T(3) * inverse_transpose) +
         T(kappa / 2) * (J * J - T(1)) * inverse_transpose;
}

double energy(const Matrix3<double>& F) {
  const double J = determinant(F);
  return mu / 2 * (std::pow(J, -2.0 / 3) * squared_norm(F) - 3) + kappa / 2 * ((J * J - 1) / 2 - std::log(J));
}

Matrix3<double> change_of_stress(const Matrix3<double>& F, const Matrix3<double>& dF) {
  using D = Dual<double, 1>;
  Matrix3<D> moved;
  for (int c = 0; c < 9; ++c) {
    moved[c] = D(F[c]);
    moved[c].derivative[0] = dF[c];
  }
  const Matrix3<D> P = stress(moved);
  Matrix3<double> change;
  for (int c = 0; c < 9; ++c) change[c] = P[c].derivative[0];
  return change;
}

void write(const std::string& text, cleave_message* message) {
  if (!message || !message->text || !message->text_capacity) return;
  const std::size_t length = std::min<std::size_t>(text.size(), message->text_capacity - 1);
  std::memcpy(message->text, text.data(), length);
  message->text[length] = 0;
}

}  // namespace

LentElasticity::LentElasticity(std::uint64_t points)
    : points_(points), table_{sizeof table_, 0, this, &evaluate, &differential, &wave_modulus} {}

std::string LentElasticity::misuse() const {
  const std::lock_guard lock(mutex_);
  return misuse_;
}

template <class Each>
cleave_result LentElasticity::evaluated(void* self, std::uint64_t first, std::uint64_t count, const double* F, bool complete,
                                        cleave_message* message, const Each& each) {
  auto& law = *static_cast<LentElasticity*>(self);
  const bool there = first <= law.points_ && count <= law.points_ - first;
  if (!there || (count && !complete)) {
    const std::lock_guard lock(law.mutex_);
    if (law.misuse_.empty())
      law.misuse_ = "asks the elastic law for points " + std::to_string(first) + " to " + std::to_string(first + count) +
                    " of a body that has " + std::to_string(law.points_) + (complete ? "" : ", with null arrays");
  }
  if (count && !complete) {
    write("arrays are missing", message);
    return CLEAVE_ERROR_INTERNAL;
  }
  law.evaluations_ += count;
  for (std::uint64_t i = 0; i < count; ++i) {
    const Matrix3<double> f = matrix(F + 9 * i);
    if (law.fails) {
      write(reason, message);
      return CLEAVE_ERROR_INTERNAL;
    }
    if (const double J = determinant(f); !(J > 0)) {
      write("point " + std::to_string(first + i) + ": det F = " + std::to_string(J) + ", where the law is not defined",
            message);
      return CLEAVE_ERROR_INTERNAL;
    }
    each(law, i, f);
  }
  return CLEAVE_OK;
}

cleave_result LentElasticity::evaluate(void* self, std::uint64_t first, std::uint64_t count, const double* F, double* psi,
                                       double* P, cleave_message* message) {
  return evaluated(self, first, count, F, F && (psi || P), message, [&](const auto& law, std::uint64_t i, const auto& f) {
    if (psi) psi[i] = law.stiffness * energy(f);
    if (!P) return;
    const Matrix3<double> p = stress(f);
    for (int c = 0; c < 9; ++c) P[9 * i + std::uint64_t(c)] = law.stiffness * p[c];
  });
}

cleave_result LentElasticity::differential(void* self, std::uint64_t first, std::uint64_t count, const double* F,
                                           const double* dF, double* dP, cleave_message* message) {
  return evaluated(self, first, count, F, F && dF && dP, message, [&](const auto& law, std::uint64_t i, const auto& f) {
    const Matrix3<double> change = change_of_stress(f, matrix(dF + 9 * i));
    for (int c = 0; c < 9; ++c) dP[9 * i + std::uint64_t(c)] = law.stiffness * change[c];
  });
}

/// The norm of dP/dF bounds what any wave sees of it.
cleave_result LentElasticity::wave_modulus(void* self, std::uint64_t first, std::uint64_t count, const double* F,
                                           double* modulus, cleave_message* message) {
  return evaluated(self, first, count, F, F && modulus, message, [&](const auto& law, std::uint64_t i, const auto& f) {
    double squares = 0;
    for (int c = 0; c < 9; ++c) {
      double direction[9] = {};
      direction[c] = 1;
      squares += squared_norm(change_of_stress(f, matrix(direction)));
    }
    modulus[i] = law.stiffness * std::sqrt(squares);
  });
}

LentThreads::LentThreads(Order order)
    : order_(order), table_{sizeof table_, order == side_by_side ? 4u : 2u, this, &for_ranges} {}

const char* LentThreads::name(Order order) {
  constexpr const char* names[] = {"threads that take ranges in turn", "threads that take the last range first",
                                   "threads that take ranges at the same time"};
  return names[order];
}

void LentThreads::for_ranges(void* self, std::uint64_t size, std::uint64_t grain,
                             void (*work)(void*, std::uint64_t, std::uint64_t), void* data) {
  auto& threads = *static_cast<LentThreads*>(self);
  if (grain == 0) threads.misuse_ = "asks for ranges of no size";
  grain = std::max<std::uint64_t>(grain, 1);
  if (threads.working_.exchange(true)) {
    threads.misuse_ = "asks for threads from within work that it has given to threads";
    for (std::uint64_t first = 0; first < size; first += grain) work(data, first, std::min(first + grain, size));
    return;
  }
  threads.used_ = true;
  const std::uint64_t count = (size + grain - 1) / grain;
  const auto range = [&](std::uint64_t k) { work(data, k * grain, std::min((k + 1) * grain, size)); };
  if (threads.order_ == side_by_side) {
    std::atomic<std::uint64_t> next{0};
    std::vector<std::thread> workers;
    for (std::uint32_t t = 0; t < threads.table_.count; ++t)
      workers.emplace_back([&] {
        for (std::uint64_t k = next++; k < count; k = next++) range(k);
      });
    for (auto& worker : workers) worker.join();
  } else {
    for (std::uint64_t k = 0; k < count; ++k) range(threads.order_ == backwards ? count - 1 - k : k);
  }
  threads.working_ = false;
}

}  // namespace cleave::testkit
