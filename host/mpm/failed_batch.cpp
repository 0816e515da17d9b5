#include "mpm/failed_batch.hpp"

#include "common/error.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <fstream>
#include <limits>

namespace cleave::mpm {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* format = "cleave failed batch 1";
constexpr const char* status_names[] = {"ok", "unreliable", "retry", "fatal"};

const FieldName* find_field(const std::string& name) {
  for (const auto& field : field_names)
    if (name == field.name) return &field;
  return nullptr;
}

/// Puts text and numbers without allocating.
class Text {
 public:
  Text(Put put, void* sink, bool single) : put_(put), sink_(sink), single_(single) {}
  Text& operator<<(const char* text) {
    put_(sink_, text, std::strlen(text));
    return *this;
  }
  void number(double value) {
    if (!std::isfinite(value)) {
      *this << (std::isnan(value) ? "\"nan\"" : value > 0 ? "\"inf\"" : "\"-inf\"");
      return;
    }
    char digits[40];
    const auto end = single_ ? std::to_chars(digits, digits + sizeof digits, float(value)).ptr
                             : std::to_chars(digits, digits + sizeof digits, value).ptr;
    put_(sink_, digits, std::size_t(end - digits));
  }
  void number(std::int64_t value) {
    char digits[24];
    put_(sink_, digits, std::size_t(std::to_chars(digits, digits + sizeof digits, value).ptr - digits));
  }

 private:
  Put put_;
  void* sink_;
  bool single_;
};

void write_fields(Text& text, const BatchSnapshot& batch, bool outputs) {
  const char* before_field = "";
  for (const auto& field : field_names) {
    if (field.output != outputs) continue;
    bool first = true;
    for (int r = 0; r < batch.rows; r++) {
      if (batch.row[r].field != field.id) continue;
      if (first)
        text << before_field << "\n    \"" << field.name << "\": [";
      else
        text << ",";
      text << "\n      [";
      for (std::uint32_t k = 0; k < batch.count; k++) {
        if (k > 0) text << ", ";
        text.number(batch.row[r].value[k]);
      }
      text << "]";
      first = false;
    }
    if (first) continue;
    text << "]";
    before_field = ",";
  }
}

/// A file that cannot be used: `what` says where and why.
[[noreturn]] void refuse(const std::string& what) { throw InputError(what); }

const Json& member(const Json& object, const char* name) {
  const auto at = object.find(name);
  if (at == object.end()) refuse(std::string("\"") + name + "\" is missing");
  return *at;
}

double number(const Json& value, const char* what) {
  if (value.is_number()) return value.get<double>();
  if (value == "nan") return std::numeric_limits<double>::quiet_NaN();
  if (value == "inf") return std::numeric_limits<double>::infinity();
  if (value == "-inf") return -std::numeric_limits<double>::infinity();
  refuse(std::string("\"") + what + "\" must be numbers, has " + value.dump());
}

/// Numbers of single precision have its digits, and are rounded as they were.
FailedBatch::Fields read_fields(const Json& object, bool outputs, bool single, std::size_t count) {
  FailedBatch::Fields fields;
  for (const auto& [name, rows] : object.items()) {
    const FieldName* field = find_field(name);
    if (!field || field->output != outputs)
      refuse("there is no field \"" + name + "\" among the " + (outputs ? "outputs" : "inputs"));
    auto& values = fields[field->id];
    for (const auto& row : rows) {
      if (!row.is_array() || row.size() != count) refuse("\"" + name + "\" must have lists of one number per point");
      auto& component = values.emplace_back();
      for (const auto& value : row) {
        const double x = number(value, field->name);
        component.push_back(single ? double(float(x)) : x);
      }
    }
    const auto most = field->components ? std::size_t(field->components) : std::size_t(CLEAVE_MAX_STATE);
    if (values.size() > most || (field->components && values.size() != most))
      refuse("\"" + name + "\" has " + std::to_string(values.size()) + " components, not " + std::to_string(most));
  }
  return fields;
}

Json json_value(const plugins::Value& value) {
  return std::visit([](const auto& v) { return Json(v); }, value);
}

plugins::Value value_of(const Json& json) {
  if (json.is_boolean()) return json.get<bool>();
  if (json.is_number_integer()) return json.get<std::int64_t>();
  if (json.is_string()) return json.get<std::string>();
  if (json.is_array()) return json.get<std::vector<double>>();
  return json.get<double>();
}

FailedBatch read(const Json& file) {
  FailedBatch batch;
  if (!file.is_object() || file.value("format", "") != format)
    refuse(std::string("is not the batch of a law that failed (\"format\": \"") + format + "\")");
  batch.cleave = member(file, "cleave").get<std::string>();
  batch.material = member(file, "material").get<std::string>();
  batch.failed = member(file, "failed").get<std::string>();
  batch.single = member(file, "precision").get<std::string>() == "single";
  batch.dimension = member(file, "dimension").get<int>();
  batch.cell_size = member(file, "cell_size").get<double>();
  batch.density = member(file, "density").get<double>();
  for (const auto& law : member(file, "laws")) {
    FailedBatch::Law read{member(law, "id").get<std::string>(), member(law, "version").get<std::string>(), {}};
    for (const auto& [key, value] : member(law, "parameters").items()) read.parameters.emplace(key, value_of(value));
    batch.laws.push_back(std::move(read));
  }
  for (const auto& name : member(file, "wanted")) {
    const FieldName* field = find_field(name.get<std::string>());
    if (!field || !field->output) refuse("there is no output " + name.dump());
    batch.wanted.push_back(field->id);
  }
  batch.reason = member(file, "reason").get<std::string>();
  batch.time_step = member(file, "time_step").get<double>();
  batch.count = member(file, "points").get<std::size_t>();
  if (batch.count < 1 || batch.count > std::size_t(chunk_points))
    refuse("\"points\" must be in [1, " + std::to_string(chunk_points) + "]");
  if (file.contains("particles")) batch.particles = file["particles"].get<std::vector<std::int64_t>>();
  if (!batch.particles.empty() && batch.particles.size() != batch.count) refuse("\"particles\" must have one number per point");
  batch.inputs = read_fields(member(file, "inputs"), false, batch.single, batch.count);
  batch.returned = file.contains("status");
  if (!batch.returned) return batch;
  batch.result = member(file, "result").get<cleave_result>();
  for (const auto& word : member(file, "status")) {
    const auto known = std::find(std::begin(status_names), std::end(status_names), word.get<std::string>());
    if (known == std::end(status_names)) refuse("there is no status " + word.dump());
    batch.status.push_back(cleave_status(known - std::begin(status_names)));
  }
  if (batch.status.size() != batch.count) refuse("\"status\" must have one word per point");
  batch.outputs = read_fields(member(file, "outputs"), true, batch.single, batch.count);
  return batch;
}

}  // namespace

void write_batch(Put put, void* sink, const char* header, const char* reason, const BatchSnapshot& batch, bool single,
                 const std::int64_t* particles) {
  Text text(put, sink, single);
  text << header << ",\n  \"reason\": \"" << reason << "\",\n  \"time_step\": ";
  Text(put, sink, false).number(batch.time_step);
  text << ",\n  \"points\": ";
  text.number(std::int64_t(batch.count));
  const auto list = [&](const char* name, auto&& write) {
    text << ",\n  \"" << name << "\": [";
    for (std::uint32_t k = 0; k < batch.count; k++) {
      if (k > 0) text << ", ";
      write(k);
    }
    text << "]";
  };
  if (particles) list("particles", [&](std::uint32_t k) { text.number(particles[k]); });
  text << ",\n  \"inputs\": {";
  write_fields(text, batch, false);
  text << "}";
  if (batch.returned) {
    text << ",\n  \"result\": ";
    text.number(std::int64_t(batch.result));
    list("status",
         [&](std::uint32_t k) { text << "\"" << status_names[std::min<int>(batch.status[k], CLEAVE_STATUS_FATAL)] << "\""; });
    text << ",\n  \"outputs\": {";
    write_fields(text, batch, true);
    text << "}";
  }
  text << "\n}\n";
}

FailedBatch read_batch(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path.string() + ": error: cannot be read; is there such a file?");
  try {
    return read(Json::parse(stream));
  } catch (const Json::exception& e) {
    throw InputError(path.string() + ": error: is not the batch of a law that failed: " + e.what());
  } catch (const InputError& e) {
    throw InputError(path.string() + ": error: " + e.what());
  }
}

std::string batch_header(const BatchOrigin& origin) {
  Json header;
  header["format"] = format;
  header["cleave"] = CLEAVE_VERSION;
  header["material"] = origin.material;
  header["failed"] = origin.failed;
  header["precision"] = origin.single ? "single" : "double";
  header["dimension"] = origin.dimension;
  header["cell_size"] = origin.cell_size;
  header["density"] = origin.density;
  header["laws"] = Json::array();
  for (const auto& law : origin.laws) {
    Json parameters = Json::object();
    for (const auto& [key, value] : law.parameters) parameters[key] = json_value(value);
    header["laws"].push_back({{"id", law.id}, {"version", law.version}, {"parameters", parameters}});
  }
  header["wanted"] = Json::array();
  for (const auto id : origin.wanted)
    for (const auto& field : field_names)
      if (field.id == id) header["wanted"].push_back(field.name);
  std::string text = header.dump(2, ' ', false, Json::error_handler_t::replace);
  text.resize(text.rfind('\n'));  // without the closing brace
  return text;
}

}  // namespace cleave::mpm
