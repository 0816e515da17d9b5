/// Batches of material points for the laws of all kinds that are called with them.
#ifndef CLEAVE_TESTKIT_BATCH_HPP
#define CLEAVE_TESTKIT_BATCH_HPP

#include <cleave/testkit/plugin.hpp>
#include <cleave/testkit/random.hpp>

#include <map>
#include <string>
#include <vector>

namespace cleave::testkit {

/// Values of one field, point by point.
using Field = std::vector<std::vector<double>>;

enum class Precision { single_precision, double_precision };
const char* name(Precision);
const char* name(cleave_field_id);

/// What goes into a call and what is asked for.
struct Request {
  std::map<cleave_field_id, Field> inputs;
  std::map<cleave_field_id, int> outputs;  ///< components
  std::uint32_t count = 0;
  double time_step = 0;

  /// The same question about other points, in this order.
  Request points(const std::vector<std::uint32_t>& which) const;
  Request points(std::uint32_t first, std::uint32_t number) const;
};

struct Answer {
  cleave_result result = CLEAVE_OK;
  std::string words;
  std::map<cleave_field_id, Field> outputs;
  std::vector<std::uint8_t> status;
  std::string touched;  ///< memory the call had no business in; empty if there is none
};

struct Placement {
  enum Order {
    dense,     ///< inputs in stream 0, outputs in stream 1, components side by side
    padded,    ///< the same, with unused lines between components and behind them
    scattered  ///< inputs and outputs mixed over three streams, in falling order, with gaps
  } order = dense;
  unsigned char fill = 0xA5;       ///< pattern in all memory that is not input
  bool short_field_table = false;  ///< the layout's table ends with the last field in use
  bool read_only = false;          ///< stream 0 cannot be written: for dense and padded
};

/// Places the request, calls the law, and reads the answer. Streams without components are null; memory beyond the last tile
/// cannot be accessed.
Answer evaluate(const Instance&, Precision, const Request&, const Placement& = {});

/// As evaluate(), but throws Failed unless the call as a whole succeeded.
Answer evaluated(const Instance&, Precision, const Request&, const Placement& = {});
/// As evaluated(), but throws Failed also if the call touched anything else than the outputs.
Answer evaluated_alone(const Instance&, Precision, const Request&, const Placement& = {});

/// Prepared memory of one call, to be called several times.
class PreparedCall {
 public:
  PreparedCall(const Instance&, Precision, const Request&, const Placement& = {});
  ~PreparedCall();
  PreparedCall(const PreparedCall&) = delete;
  PreparedCall& operator=(const PreparedCall&) = delete;

  cleave_result call() noexcept;
  Answer answer() const;
  /// Its status and message are set anew by call().
  cleave_batch& batch();

 private:
  struct Memory;
  Memory* memory_;
};

std::vector<Precision> precisions(const Plugin&);

/// Strain measures a law may be handed: "b", "F", or "" if it reads none.
std::vector<std::string> measures(const Instance&);

/// Random points of moderate strain (stretches of 0.8 to 1.25, compression and tension) with all inputs the law needs and
/// all outputs it offers. `spread` widens the logarithms of the stretches.
Request random_request(const Instance&, Random&, std::uint32_t count, const std::string& measure, double spread = 1);

/// Largest |a - b| over the points, relative to the largest |a| of the field; infinite if one is not finite where the other
/// is. Points whose status is FATAL or RETRY are left out.
double difference(const Answer& a, const Answer& b, cleave_field_id);
/// Name of the first field, and the point, where two answers are not bitwise the same; empty if they are. `skip` is left out.
std::string first_difference(const Answer& a, const Answer& b, int skip = -1);

}  // namespace cleave::testkit

#endif
