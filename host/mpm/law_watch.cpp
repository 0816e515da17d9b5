#include "mpm/law_watch.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstring>

namespace cleave::mpm {
namespace {

/// The call a thread is in, for the signal handler.
struct Call {
  const LawWatch* law;
  const cleave_batch* batch;
  const void* saved;
};
constinit thread_local const Call* volatile current_call __attribute__((tls_model("initial-exec"))) = nullptr;

constexpr int crashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
constexpr const char* crash_names[] = {"SIGSEGV", "SIGBUS", "SIGFPE", "SIGILL", "SIGABRT"};
struct sigaction before[std::size(crashes)];
char dump_file[4096];
std::atomic<bool> dumping{false};

void put_file(void* sink, const char* text, std::size_t size) {
  const int file = *static_cast<int*>(sink);
  while (size > 0) {
    const ssize_t written = write(file, text, size);
    if (written <= 0) return;
    text += written;
    size -= std::size_t(written);
  }
}

void say(const char* text) {
  int standard_error = STDERR_FILENO;
  put_file(&standard_error, text, std::strlen(text));
}

/// Only async-signal-safe functions: open, write, close, signal, raise, pause.
extern "C" void on_crash(int number) {
  if (const Call* call = current_call) {
    if (dumping.exchange(true))
      for (;;) pause();  // another thread writes, and ends the program
    std::size_t which = 0;
    while (crashes[which] != number) which++;
    static BatchSnapshot snapshot;
    call->law->read(snapshot, *call->batch, call->saved);
    int file = open(dump_file, O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0644);
    if (file >= 0) {
      write_batch(put_file, &file, call->law->header().c_str(), crash_names[which], snapshot, call->law->single(), nullptr);
      close(file);
      say("\nerror: a plugin crashed (");
      say(crash_names[which]);
      say("); see the points it was given with: cleave point --replay ");
      say(dump_file);
      say("\n");
    }
  }
  signal(number, SIG_DFL);
  raise(number);
}

}  // namespace

// ------------------------------------------------------------------------------------------------- batches kept

void FailedBatches::keep(std::size_t degree, const LawWatch& law, const cleave_batch& batch, const void* saved,
                         cleave_result result, std::uint32_t not_finite) {
  const auto* first = static_cast<const char*>(batch.streams[0]);
  const std::lock_guard lock(mutex_);
  auto& kept = kept_[degree];
  if (kept && kept->first <= first) return;
  if (!kept) kept = std::make_unique<Kept>();
  *kept = Kept{};
  kept->law = &law;
  kept->first = first;
  const std::size_t lanes = CLEAVE_TILE_BYTES / (law.single() ? sizeof(float) : sizeof(double));
  kept->end = first + (batch.count + lanes - 1) / lanes * batch.layout->stride[0];
  kept->batch.returned = true;
  kept->batch.result = result;
  kept->batch.not_finite = not_finite;
  law.read(kept->batch, batch, saved);
}

const FailedBatches::Kept* FailedBatches::find(const char* tile) const {
  for (auto kept = kept_.rbegin(); kept != kept_.rend(); ++kept)
    if (*kept && (*kept)->first <= tile && tile < (*kept)->end) return kept->get();
  return nullptr;
}

// ------------------------------------------------------------------------------------------------- watching

LawWatch::LawWatch(const BoundLaw& law, bool single, std::string header, FailedBatches& failed)
    : LawWatch(law, single, std::move(header)) {
  failed_ = &failed;
}

LawWatch::LawWatch(const BoundLaw& law, bool single, std::string header)
    : law_(law), single_(single), header_(std::move(header)), failed_(nullptr) {
  if (!law_.function) return;
  for (const auto& field : field_names) {
    const cleave_field& range = law_.layout->fields[field.id];
    for (int c = 0; c < range.count; c++)
      (field.output ? outputs_ : inputs_).push_back({field.id, law_.layout->components[range.first + c], -1});
  }
  for (const auto& out : outputs_) results_.push_back(out.at);
  for (auto& in : inputs_)
    if (std::any_of(results_.begin(), results_.end(),
                    [&](const auto& out) { return out.stream == in.at.stream && out.offset == in.at.offset; })) {
      in.saved = int(overwritten_.size());
      overwritten_.push_back(in.at);
    }
}

BoundLaw LawWatch::watched() const {
  if (!law_.function) return {};
  return {reinterpret_cast<const cleave_instance*>(this), single_ ? &call<float> : &call<double>, law_.layout};
}

std::vector<cleave_field_id> LawWatch::outputs_of(const BoundLaw& law) {
  std::vector<cleave_field_id> fields;
  for (const auto& field : field_names)
    if (law.function && field.output && law.layout->fields[field.id].count) fields.push_back(field.id);
  return fields;
}

template <class T>
cleave_result LawWatch::call(const cleave_instance* instance, const cleave_batch* batch) {
  const auto& watch = *reinterpret_cast<const LawWatch*>(instance);
  constexpr std::size_t lanes = CLEAVE_TILE_BYTES / sizeof(T);
  alignas(CLEAVE_TILE_BYTES) T saved[most_saved * chunk_points];
  T* copy = saved;
  for (const auto& component : watch.overwritten_)
    for (std::size_t k = 0; k < chunk_points; k += lanes, copy += lanes)
      if (k < batch->count) std::memcpy(copy, value_at<T>(*batch, component, k), CLEAVE_TILE_BYTES);

  const Call call{&watch, batch, saved};
  std::atomic_signal_fence(std::memory_order_seq_cst);
  current_call = &call;
  const cleave_result result = watch.law_.function(watch.law_.instance, batch);
  current_call = nullptr;
  std::atomic_signal_fence(std::memory_order_seq_cst);

  const std::uint32_t not_finite = refuse_not_finite<T>(*batch, watch.results_.data(), watch.results_.size());
  std::uint64_t statuses[chunk_points / sizeof(std::uint64_t)], raised = 0;  // the kernels have room for a chunk
  static_assert(sizeof statuses == chunk_points * sizeof(cleave_status));
  std::memcpy(statuses, batch->status, sizeof statuses);
  for (const auto s : statuses) raised |= s;
  if (__builtin_expect(raised != 0 || result != CLEAVE_OK, 0)) {
    const cleave_status worst = *std::max_element(batch->status, batch->status + chunk_points);
    if (worst < CLEAVE_STATUS_RETRY && result == CLEAVE_OK) return result;
    const std::size_t degree = worst >= CLEAVE_STATUS_FATAL ? 2 : worst == CLEAVE_STATUS_RETRY ? 1 : 0;
    if (watch.failed_) watch.failed_->keep(degree, watch, *batch, saved, result, not_finite);
  }
  return result;
}

void LawWatch::read(BatchSnapshot& snapshot, const cleave_batch& batch, const void* saved) const {
  if (single_)
    read_as<float>(snapshot, batch, saved);
  else
    read_as<double>(snapshot, batch, saved);
}

template <class T>
void LawWatch::read_as(BatchSnapshot& snapshot, const cleave_batch& batch, const void* saved) const {
  snapshot.count = batch.count;
  snapshot.time_step = batch.time_step;
  const auto take = [&](const Place& place) {
    auto& row = snapshot.row[snapshot.rows++];
    row.field = place.field;
    for (std::uint32_t k = 0; k < batch.count; k++)
      row.value[k] = double(place.saved < 0 ? *value_at<T>(batch, place.at, k)
                                            : static_cast<const T*>(saved)[std::size_t(place.saved) * chunk_points + k]);
  };
  for (const auto& place : inputs_) take(place);
  if (!snapshot.returned) return;
  for (const auto& place : outputs_) take(place);
  std::copy_n(batch.status, batch.count, snapshot.status);
}

// ------------------------------------------------------------------------------------------------- crashes

CrashDump::CrashDump(const std::filesystem::path& file) {
  const std::string name = file.string().substr(0, sizeof dump_file - 1);
  std::copy_n(name.c_str(), name.size() + 1, dump_file);
  struct sigaction action {};
  action.sa_handler = on_crash;
  for (std::size_t i = 0; i < std::size(crashes); i++) sigaction(crashes[i], &action, &before[i]);
}

CrashDump::~CrashDump() {
  for (std::size_t i = 0; i < std::size(crashes); i++) sigaction(crashes[i], &before[i], nullptr);
}

}  // namespace cleave::mpm
