#include "call_watch.hpp"

#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <limits>
#include <thread>

namespace cleave::testkit {
namespace {

/// `body(instance, precision, measure, random)` for everything the law may be called with.
template <class Body>
void for_each_form(Context& context, Body body) {
  for (const Settings& settings : context.settings()) {
    const Instance instance(context.plugin(), settings);
    for (const auto precision : precisions(context.plugin()))
      for (const auto& measure : measures(instance)) {
        Random random(context.seed());
        const std::string form = std::string(name(precision)) + (measure.empty() ? "" : " of " + measure);
        context.doing("evaluating in " + form + " with " + text(settings));
        try {
          body(instance, precision, measure, random);
        } catch (const Failed& failed) {
          throw Failed{form + ": " + failed.reason + ", with " + text(settings)};
        }
      }
  }
}

void deterministic(Context& context) {
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    const Request request = random_request(instance, random, 100, measure);
    const Answer first = evaluated(instance, precision, request);
    for (unsigned char fill : {0x00, 0x3C}) {
      const Answer again = evaluated(instance, precision, request, {.fill = fill});
      if (const auto where = first_difference(first, again); !where.empty())
        context.fail("a second call with the same input changes " + where);
    }
  });
}

void inputs_unchanged(Context& context) {
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    context.doing(std::string("given inputs in read-only memory, in ") + name(precision));
    evaluated(instance, precision, random_request(instance, random, 37, measure), {.read_only = true});
  });
}

double rounding(Precision precision) { return precision == Precision::single_precision ? 1e-5 : 1e-12; }

/// Compares point `order[k]` of `all` with point k of `some`.
void expect_same_points(Context& context, const Answer& all, const Answer& some, const std::vector<std::uint32_t>& order,
                        double tolerance, const std::string& what) {
  Answer part;
  for (std::uint32_t k : order) part.status.push_back(all.status[k]);
  for (const auto& [field, values] : all.outputs) {
    if (!some.outputs.contains(field)) continue;
    for (std::uint32_t k : order) part.outputs[field].push_back(values[k]);
    if (const double apart = difference(part, some, field); !(apart <= tolerance)) {
      char number[32];
      std::snprintf(number, sizeof number, "%.2g", apart);
      context.fail(what + " changes " + name(field) + " by " + number + " of its size");
    }
  }
  if (part.status != some.status) context.fail(what + " changes a status");
}

void batch_sizes(Context& context) {
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    constexpr std::uint32_t count = 1000;
    const Request request = random_request(instance, random, count, measure);
    const Answer all = evaluated(instance, precision, request);
    for (std::uint32_t size : {1u, 7u, 8u, 16u, 64u})
      for (std::uint32_t first = 0; first + size <= (size == 1 ? 64 : count); first += size == 1 ? 1 : 3 * size) {
        std::vector<std::uint32_t> order(size);
        for (std::uint32_t k = 0; k < size; ++k) order[k] = first + k;
        expect_same_points(context, all, evaluated(instance, precision, request.points(order)), order, rounding(precision),
                           "a batch of " + std::to_string(size) + " in place of 1000");
      }
    std::vector<std::uint32_t> order(count);
    for (std::uint32_t k = 0; k < count; ++k) order[k] = (k * 7 + 3) % count;
    expect_same_points(context, all, evaluated(instance, precision, request.points(order)), order, rounding(precision),
                       "another order of the points");
  });
}

void padding(Context& context) {
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    const Request request = random_request(instance, random, 37, measure);
    const Answer dense = evaluated(instance, precision, request);
    for (const auto order : {Placement::padded, Placement::scattered})
      if (const auto where = first_difference(dense, evaluated_alone(instance, precision, request, {.order = order}));
          !where.empty())
        context.fail("another layout in memory changes " + where);
    Request nothing = request.points(0, 0);
    context.doing(std::string("given no points at all, in ") + name(precision));
    evaluated_alone(instance, precision, nothing);
  });
}

void bad_lanes(Context& context) {
  constexpr int bad = 13;
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    const Request request = random_request(instance, random, 37, measure);
    const Answer sound = evaluated(instance, precision, request);
    const auto expect_neighbours = [&](const Answer& answer, const std::string& what) {
      if (const auto where = first_difference(sound, answer, bad); !where.empty())
        context.fail(what + " at point " + std::to_string(bad) + " changes " + where);
    };
    Request broken = request;
    for (auto field : {CLEAVE_FIELD_B, CLEAVE_FIELD_F, CLEAVE_FIELD_TENSILE_ENERGY_IN, CLEAVE_FIELD_EFFECTIVE_STRESS_IN})
      if (broken.inputs.contains(field)) broken.inputs[field][bad][0] = std::numeric_limits<double>::quiet_NaN();
    const Answer undefined = evaluated(instance, precision, broken);
    if (undefined.status[bad] < CLEAVE_STATUS_RETRY) context.fail("a strain or stress that is not a number has no status");
    expect_neighbours(undefined, "a strain or stress that is not a number");

    if (measure != "F" || instance.plugin().kind() == damage_kind) return;
    Request inverted = request;
    for (int i = 0; i < 3; ++i) inverted.inputs[CLEAVE_FIELD_F][bad][std::size_t(i)] *= -1;
    const Answer answer = evaluated(instance, precision, inverted);
    if (!instance.can(CLEAVE_INVERSION_SAFE) && answer.status[bad] < CLEAVE_STATUS_RETRY)
      context.fail("an inverted point has no status, and the law is not declared inversion safe");
    if (instance.can(CLEAVE_INVERSION_SAFE))
      for (const auto& [field, values] : answer.outputs)
        for (double value : values[bad])
          if (answer.status[bad] >= CLEAVE_STATUS_RETRY || !std::isfinite(value))
            context.fail("an inverted point gives no finite " + std::string(name(field)) +
                         ", and the law is declared inversion safe");
    expect_neighbours(answer, "an inverted strain");
  });
}

void requested_outputs(Context& context) {
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    const Request request = random_request(instance, random, 37, measure);
    const Answer all = evaluated(instance, precision, request);
    std::vector<std::uint32_t> order(request.count);
    for (std::uint32_t k = 0; k < request.count; ++k) order[k] = k;
    for (const auto& [field, components] : request.outputs) {
      Request one = request;
      one.outputs = {{field, components}};
      if (field != CLEAVE_FIELD_DELTA_P) one.inputs.erase(CLEAVE_FIELD_DELTA_F);
      const std::string what = std::string("asking for ") + name(field) + " alone";
      context.doing(what + ", in " + name(precision));
      // The status may say less: what is not asked for cannot fail.
      Answer answer = evaluated_alone(instance, precision, one);
      answer.status = all.status;
      expect_same_points(context, all, answer, order, rounding(precision), what);
    }
  });
}

void threads(Context& context) {
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    constexpr int count = 8;
    std::vector<Request> requests;
    std::vector<Answer> serial;
    for (int i = 0; i < count; ++i) {
      requests.push_back(random_request(instance, random, 200, measure));
      serial.push_back(evaluated(instance, precision, requests.back()));
    }
    std::vector<std::string> differences(count);
    std::vector<std::thread> workers;
    for (int i = 0; i < count; ++i)
      workers.emplace_back([&, i] {
        PreparedCall call(instance, precision, requests[std::size_t(i)]);
        for (int round = 0; round < 20 && differences[std::size_t(i)].empty(); ++round) {
          if (call.call() != CLEAVE_OK)
            differences[std::size_t(i)] = "the result of the call";
          else
            differences[std::size_t(i)] = first_difference(serial[std::size_t(i)], call.answer());
        }
      });
    for (auto& worker : workers) worker.join();
    for (const auto& where : differences)
      if (!where.empty()) context.fail("other threads that share the instance change " + where);
  });
}

Context* watched_context = nullptr;

int count_threads() {
  return int(std::distance(std::filesystem::directory_iterator("/proc/self/task"), std::filesystem::directory_iterator()));
}

void no_side_effects(Context& context) {
  watched_context = &context;
  for_each_form(context, [&](const Instance& instance, Precision precision, const std::string& measure, Random& random) {
    PreparedCall call(instance, precision, random_request(instance, random, 256, measure));
    const int threads_before = count_threads();
    {
      const CallWatch watch([](const char* function) {
        char reason[128];
        std::snprintf(reason, sizeof reason, "calls %s() during a batch call", function);
        watched_context->fail_at_once(reason);
      });
      call.call();
    }
    if (count_threads() != threads_before) context.fail("starts a thread during a batch call");
  });
}

/// Largest number of a field at a point.
double size_of(const std::vector<double>& values) {
  double largest = 0;
  for (double value : values) largest = std::max(largest, std::abs(value));
  return largest;
}

void single_precision(Context& context) {
  if (precisions(context.plugin()).size() < 2) context.skip("only one precision offered");
  for (const Settings& settings : context.settings()) {
    const Instance instance(context.plugin(), settings);
    for (const auto& measure : measures(instance)) {
      Random random(context.seed());
      Request request = random_request(instance, random, 400, measure);
      // What the single precision law is given, exactly.
      for (auto& [field, values] : request.inputs)
        for (auto& point : values)
          for (double& value : point) value = double(float(value));
      Request moved = request;
      for (auto& [field, values] : moved.inputs)
        for (auto& point : values)
          for (double& value : point) value *= 1 + random.uniform(-1e-6, 1e-6);
      const Answer exact = evaluated(instance, Precision::double_precision, request);
      const Answer narrow = evaluated(instance, Precision::single_precision, request);
      const Answer nearby = evaluated(instance, Precision::double_precision, moved);
      // Near rest energies are differences of larger terms: there the size of the batch's largest counts.
      std::map<cleave_field_id, double> floor;
      for (const auto& [field, values] : exact.outputs)
        for (std::uint32_t k = 0; k < request.count; ++k)
          if (exact.status[k] < CLEAVE_STATUS_RETRY) floor[field] = std::max(floor[field], 0.05 * size_of(values[k]));
      std::uint32_t compared = 0;
      for (std::uint32_t k = 0; k < request.count; ++k) {
        if (exact.status[k] >= CLEAVE_STATUS_RETRY || nearby.status[k] >= CLEAVE_STATUS_RETRY) continue;
        // Where the inputs' own rounding matters, as at a kink or where terms cancel, nothing is to be compared.
        bool smooth = true;
        for (const auto& [field, values] : exact.outputs)
          for (std::size_t i = 0; i < values[k].size(); ++i)
            smooth = smooth && std::abs(values[k][i] - nearby.outputs.at(field)[k][i]) <=
                                   2e-5 * std::max(size_of(values[k]), floor[field]);
        if (!smooth) continue;
        ++compared;
        if (narrow.status[k] >= CLEAVE_STATUS_RETRY) context.fail("f32 has no result where f64 has one");
        for (const auto& [field, values] : exact.outputs) {
          const double size = std::max(size_of(values[k]), floor[field]);
          for (std::size_t i = 0; i < values[k].size(); ++i) {
            const double apart = std::abs(values[k][i] - narrow.outputs.at(field)[k][i]);
            if (apart <= 1e-4 * size) continue;
            char numbers[96];
            std::snprintf(numbers, sizeof numbers, "%.9g in f32, %.9g in f64", narrow.outputs.at(field)[k][i], values[k][i]);
            context.fail(std::string(name(field)) + " is " + numbers + ", with " + text(settings));
          }
        }
      }
      if (compared < request.count / 4) context.skip("three quarters of the points are at kinks, with " + text(settings));
    }
  }
}

/// Sizes, layouts, parameters and strains at random: no crash, nothing touched, nothing silent, and the same again.
void fuzz(Context& context) {
  const double stress = context.plugin().kind() == elasticity_kind ? 0 : 0.01 * Material::youngs_modulus;
  const std::vector<Settings> base = context.settings();
  context.random_cases(400, [&](Random& random) {
    Settings settings = base[std::size_t(random.below(int(base.size())))];
    for (auto& [key, value] : settings)
      if (random.below(2)) value = typical_value(*find(context.plugin().schema(), key), random.uniform(), stress);
    std::unique_ptr<Instance> instance;
    try {
      instance = std::make_unique<Instance>(context.plugin(), settings);
    } catch (const Failed&) {
      return;  // values that do not go together
    }
    const auto all_precisions = precisions(context.plugin());
    const auto all_measures = measures(*instance);
    const Precision precision = all_precisions[std::size_t(random.below(int(all_precisions.size())))];
    const std::string measure = all_measures[std::size_t(random.below(int(all_measures.size())))];
    const auto count = std::uint32_t(random.below(random.below(4) == 0 ? 300 : 40));
    const double spread = std::exp(random.uniform(-6, 3));
    const Request request = random_request(*instance, random, count, measure, spread);
    const Placement placement{.order = Placement::Order(random.below(3)), .short_field_table = random.below(2) == 0};
    char stretch[48];
    std::snprintf(stretch, sizeof stretch, "stretches up to %.3g", std::exp(0.22 * spread));
    const std::string what = std::string(name(precision)) + (measure.empty() ? "" : " of " + measure) + ", " +
                             std::to_string(count) + " points, " + stretch + ", " + text(settings);
    context.doing(what);
    const Answer answer = evaluated_alone(*instance, precision, request, placement);
    for (std::uint32_t k = 0; k < count; ++k) {
      if (answer.status[k] > CLEAVE_STATUS_FATAL) context.fail("a status that does not exist; " + what);
      if (answer.status[k] >= CLEAVE_STATUS_RETRY) continue;
      for (const auto& [field, values] : answer.outputs)
        for (double value : values[k])
          if (!std::isfinite(value))
            context.fail(std::string(name(field)) + " of point " + std::to_string(k) +
                         " is not finite, and no status says so; " + what);
    }
    if (const auto where = first_difference(answer, evaluated(*instance, precision, request, placement)); !where.empty())
      context.fail("a second call changes " + where + "; " + what);
  });
}

}  // namespace

std::vector<Check> call_contract_checks() {
  return {
      {"call.deterministic", 15, "The same input gives the same bits, whatever the output memory held before.", batch_kinds,
       deterministic},
      {"call.inputs-unchanged", 16, "Inputs are only read.", batch_kinds, inputs_unchanged},
      {"call.batch-sizes", 17, "Results do not depend on the size of the batch or on the order of its points.", batch_kinds,
       batch_sizes},
      {"call.padding", 18, "Any layout is followed, memory between components stays untouched, and no points are no problem.",
       batch_kinds, padding},
      {"call.bad-lanes", 19, "A point that is undefined or inverted gets a status, and its neighbours keep their bits.",
       batch_kinds, bad_lanes},
      {"call.requested-outputs", 20, "Each output can be asked for alone; nothing else is written.", batch_kinds,
       requested_outputs},
      {"call.threads", 21, "Eight threads that share one instance get what one thread gets.", batch_kinds, threads},
      {"call.no-side-effects", 22,
       "A batch call allocates nothing, takes no lock, does no input or output and starts no thread.", batch_kinds,
       no_side_effects},
      {"call.single-precision", 23, "Single precision agrees with double to 1e-4, away from kinks.", batch_kinds,
       single_precision},
      {"call.fuzz", 51, "Random parameters, strains, batch sizes and layouts: no crash, nothing silent, nothing stray.",
       batch_kinds, fuzz},
  };
}

}  // namespace cleave::testkit
