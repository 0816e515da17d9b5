#include "app/run_pieces.hpp"

#include <algorithm>

namespace cleave::app {

namespace {
constexpr const char* section = "pieces";
}

RunPieces::RunPieces(const config::Scene& scene) : scene_(scene) {
  const auto material_of = [&](const config::Body& body) {
    return std::find_if(scene.materials.begin(), scene.materials.end(), [&](const auto& m) { return m.name == body.material; });
  };
  bool damage = false;
  for (const auto& body : scene.bodies) damage = damage || material_of(body)->damage;
  auto& asked = scene_.output.attributes;
  const bool named = std::find(asked.begin(), asked.end(), "piece") != asked.end();
  as_attribute_ = named || (asked.empty() && damage);
  any_ = damage || named;
  if (damage && !asked.empty() && std::find(asked.begin(), asked.end(), "damage") == asked.end()) {
    asked.emplace_back("damage");
    keeps_damage_ = false;
  }
}

void RunPieces::rest(const mpm::Simulation& simulation) {
  if (!any_) return;
  const output::ParticleFrame frame = simulation.frame(0);
  counted_.assign(frame.bodies.size(), false);
  for (std::size_t b = 0; b < frame.bodies.size(); b++)
    for (const auto& body : scene_.bodies)
      for (const auto& material : scene_.materials)
        if (body.name == frame.bodies[b] && material.name == body.material) counted_[b] = !material.discretization;
  pieces_.emplace(frame, counted_);
}

void RunPieces::save(checkpoint::StateWriter& writer) const {
  if (pieces_) checkpoint::pack(writer, section, [this](auto& archive) { archive(*pieces_); });
}

void RunPieces::restore(checkpoint::StateReader& reader) {
  if (!pieces_ || !reader.has(section)) return;
  checkpoint::unpack(reader, section, [this](auto& archive) { archive(*pieces_); });
  if (!pieces_->consistent()) reader.refuse(section, "is of other particles");
}

void RunPieces::find(output::ParticleFrame& frame, output::FrameRecord& record) {
  if (!pieces_) return;
  const auto count = pieces_->find(frame);
  record.pieces = record.pieces.value_or(0) + count.pieces;
  record.debris = count.debris;
  auto& attributes = frame.attributes;
  if (!keeps_damage_) std::erase_if(attributes, [](const auto& a) { return a.name == "damage"; });
  if (!as_attribute_) return;
  const auto& found = pieces_->of_particles();
  auto piece =
      std::find_if(attributes.begin(), attributes.end(), [](const auto& a) { return a.name == "piece" && a.components == 1; });
  if (piece == attributes.end())
    piece = attributes.insert(piece, {"piece", 1, "", std::vector<float>(frame.particles(), -1.f)});
  for (std::size_t b = 0; b < counted_.size(); b++)
    if (counted_[b])
      for (std::size_t i = frame.body_begin(b); i < frame.body_ends[b]; i++) piece->values[i] = float(found[i]);
}

}  // namespace cleave::app
