#include <cleave/testkit/batch.hpp>
#include <cleave/testkit/context.hpp>

#include <time.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <string>

namespace cleave::testkit {
namespace {

/// So many times the budget are no matter of the processor. Where this is built without optimization or with a sanitizer,
/// plugins most likely are, too.
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
constexpr double failing_factor = 10;
#else
constexpr double failing_factor = 300;
#endif

constexpr std::uint32_t points = 256;

/// What others do on the machine does not count.
double processor_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

double nanoseconds_per_point(PreparedCall& call) {
  constexpr double least_seconds = 2e-4;
  const auto time = [&](int loops) {
    const double start = processor_seconds();
    for (int i = 0; i < loops; ++i) call.call();
    return processor_seconds() - start;
  };
  int loops = 1;
  while (time(loops) < least_seconds) loops *= 2;
  std::array<double, 15> samples;
  for (double& sample : samples) sample = time(loops) / loops;
  const auto median = samples.begin() + samples.size() / 2;
  std::nth_element(samples.begin(), median, samples.end());
  return 1e9 / points * *median;
}

std::string text_of(double number) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", number < 10 ? 1 : 0, number);
  return text;
}

/// Of an elastic law, what every step asks for.
Request stress_alone(Request request) {
  request.inputs.erase(CLEAVE_FIELD_DELTA_F);
  request.outputs = {{CLEAVE_FIELD_TAU, 6}};
  return request;
}

void budget(Context& context) {
  const Plugin& plugin = context.plugin();
  const cleave_about& about = *plugin.table().about;
  const double declared = CLEAVE_HAS(cleave_about, &about, budget_ns) ? about.budget_ns : 0;
  if (!(declared >= 0)) context.fail("about.budget_ns is " + text_of(declared) + ": give nanoseconds, or 0 to say nothing");
  const Instance instance(plugin, context.settings().front());
  const auto offered = precisions(plugin);
  std::string remark;
  double costliest = 0;
  for (const Precision precision : offered)
    for (const auto& measure : measures(instance)) {
      const std::string form = std::string(name(precision)) + (measure.empty() ? "" : " of " + measure);
      context.doing("being timed in " + form);
      Random random(context.seed());
      Request request = random_request(instance, random, points, measure);
      if (plugin.kind() == elasticity_kind) request = stress_alone(request);
      evaluated(instance, precision, request);
      PreparedCall call(instance, precision, request);
      const double cost = nanoseconds_per_point(call);
      remark += (remark.empty() ? "" : ", ") + form + " " + text_of(cost) + " ns";
      if (precision == offered.front()) costliest = std::max(costliest, cost);
    }
  remark += " per point";
  if (declared > 0 && costliest > failing_factor * declared)
    context.fail(remark + ": more than " + text_of(failing_factor) + " times the " + text_of(declared) +
                 " ns of about.budget_ns");
  if (declared > 0 && costliest > declared)
    remark += "; WARNING: more than the " + text_of(declared) + " ns of about.budget_ns";
  context.remark(remark);
}

}  // namespace

std::vector<Check> speed_checks() {
  return {
      {"speed.budget", 52,
       "What a point costs in nanoseconds is reported, with a warning beyond the declared budget; ten times the budget fails.",
       batch_kinds, budget}};
}

}  // namespace cleave::testkit
