#include "output/pieces.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <stdexcept>
#include <tuple>

namespace cleave::output {
namespace {

/// Particles by the cells they are in.
class CellList {
 public:
  CellList(const std::vector<Vector3>& positions, std::size_t begin, std::size_t end, double cell)
      : positions_(positions), cell_(cell), low_(Vector3::Constant(std::numeric_limits<double>::infinity())) {
    for (std::size_t i = begin; i < end; i++) low_ = low_.cwiseMin(positions[i]);
    entries_.resize(end - begin);
    tbb::parallel_for(begin, end, [&](std::size_t i) { entries_[i - begin] = {key(cell_of(i)), std::uint32_t(i)}; });
    tbb::parallel_sort(entries_.begin(), entries_.end());
  }

  /// each(j) for the particles in the cells up to `reach` cells from that of particle i, itself among them.
  template <class Each>
  void for_near(std::size_t i, std::int64_t reach, const Each& each) const {
    const Cell c = cell_of(i);
    for (std::int64_t z = std::max<std::int64_t>(c[2] - reach, 0); z <= c[2] + reach; z++)
      for (std::int64_t y = std::max<std::int64_t>(c[1] - reach, 0); y <= c[1] + reach; y++) {
        const std::uint64_t first = key({std::max<std::int64_t>(c[0] - reach, 0), y, z}), last = key({c[0] + reach, y, z});
        for (auto e = std::lower_bound(entries_.begin(), entries_.end(), std::pair(first, std::uint32_t(0)));
             e != entries_.end() && e->first <= last; ++e)
          each(e->second);
      }
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  static constexpr std::int64_t most = (1 << 21) - 1;

  Cell cell_of(std::size_t i) const {
    const Vector3 x = (positions_[i] - low_) / cell_;
    Cell c;
    for (int a = 0; a < 3; a++) c[std::size_t(a)] = std::int64_t(std::min(x[a], double(most)));
    return c;
  }
  static std::uint64_t key(const Cell& c) {
    return std::uint64_t(std::min(c[2], most)) << 42 | std::uint64_t(std::min(c[1], most)) << 21 |
           std::uint64_t(std::min(c[0], most));
  }

  const std::vector<Vector3>& positions_;
  double cell_;
  Vector3 low_;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> entries_;
};

/// Disjoint sets of particles; the root of one is its first particle.
class Sets {
 public:
  explicit Sets(std::size_t particles) : above_(particles) { std::iota(above_.begin(), above_.end(), 0u); }
  std::uint32_t root(std::uint32_t i) {
    while (above_[i] != i) i = above_[i] = above_[above_[i]];
    return i;
  }
  void join(std::uint32_t i, std::uint32_t j) {
    const std::uint32_t a = root(i), b = root(j);
    above_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> above_;
};

}  // namespace

Pieces::Pieces(const ParticleFrame& rest, std::vector<bool> counted)
    : counted_(std::move(counted)), particles_(rest.particles()) {
  if (counted_.size() != rest.bodies.size()) throw std::invalid_argument("Pieces: one mark per body is needed");
  first_.reserve(particles_ + 1);
  first_.push_back(0);
  for (std::size_t b = 0; b < rest.bodies.size(); b++)
    if (counted_[b])
      connect(rest, rest.body_begin(b), rest.body_ends[b]);
    else
      first_.resize(rest.body_ends[b] + 1, others_.size());
  others_.shrink_to_fit();
}

void Pieces::connect(const ParticleFrame& rest, std::size_t begin, std::size_t end) {
  if (begin == end) return;
  double volume = 0;
  for (std::size_t i = begin; i < end; i++) volume += double(rest.volumes[i]);
  const double spacing = std::pow(volume / double(end - begin), 1.0 / rest.dimension), radius = 1.5 * spacing;
  const auto& x = rest.positions;
  const CellList cells(x, begin, end, radius);
  const auto squared = [&x](std::size_t i, std::size_t j) { return (x[i] - x[j]).squaredNorm(); };
  std::vector<std::vector<std::uint32_t>> larger(end - begin);
  std::vector<std::int64_t> nearest(end - begin, -1);  // of particles without neighbours
  tbb::parallel_for(begin, end, [&](std::size_t i) {
    bool any = false;
    auto& own = larger[i - begin];
    cells.for_near(i, 1, [&](std::uint32_t j) {
      if (j == i || squared(i, j) > radius * radius) return;
      any = true;
      if (j > i) own.push_back(j);
    });
    if (any) return;
    std::pair<double, std::int64_t> best{std::numeric_limits<double>::infinity(), -1};
    cells.for_near(i, 3, [&](std::uint32_t j) {
      if (j != i) best = std::min(best, {squared(i, j), std::int64_t(j)});
    });
    nearest[i - begin] = best.second;
  });
  for (std::size_t i = begin; i < end; i++)
    if (const std::int64_t j = nearest[i - begin]; j >= 0)
      larger[std::min(i, std::size_t(j)) - begin].push_back(std::uint32_t(std::max(i, std::size_t(j))));
  for (std::size_t i = begin; i < end; i++) {
    auto& own = larger[i - begin];
    std::sort(own.begin(), own.end());
    own.erase(std::unique(own.begin(), own.end()), own.end());
    others_.insert(others_.end(), own.begin(), own.end());
    first_.push_back(others_.size());
    std::vector<std::uint32_t>().swap(own);
  }
}

template <class Each>
void Pieces::for_neighbours(const Each& each) const {
  for (std::uint32_t i = 0; i < particles_; i++)
    for (std::uint64_t k = first_[i]; k < first_[i + 1]; k++) each(i, others_[k]);
}

Pieces::Count Pieces::find(const ParticleFrame& frame) {
  if (frame.particles() != particles_) throw std::invalid_argument("Pieces: a frame of other particles");
  const auto damage = std::find_if(frame.attributes.begin(), frame.attributes.end(),
                                   [](const Attribute& a) { return a.name == "damage" && a.components == 1; });
  const bool damaged = damage != frame.attributes.end();
  const auto intact = [&](std::uint32_t i) { return !damaged || damage->values[i] < broken; };
  const double reach = 3 * frame.cell_size, cell_volume = std::pow(frame.cell_size, frame.dimension);
  const auto squared = [&](std::uint32_t i, std::uint32_t j) {
    return (frame.positions[i] - frame.positions[j]).squaredNorm();
  };

  Sets sets(particles_);
  for_neighbours([&](std::uint32_t i, std::uint32_t j) {
    if (intact(i) && intact(j) && squared(i, j) <= reach * reach) sets.join(i, j);
  });
  std::vector<float> volumes(particles_, 0.f);
  {
    std::vector<double> sums(particles_, 0.);
    for (std::uint32_t i = 0; i < particles_; i++)
      if (intact(i)) sums[sets.root(i)] += double(frame.volumes[i]);
    std::copy(sums.begin(), sums.end(), volumes.begin());
  }
  std::vector<std::int32_t> found(particles_, -1);
  std::int32_t pieces = 0;
  for (std::size_t b = 0; b < counted_.size(); b++)
    for (std::size_t i = frame.body_begin(b); counted_[b] && i < frame.body_ends[b]; i++) {
      const auto particle = std::uint32_t(i);
      if (!intact(particle)) continue;
      const std::uint32_t root = sets.root(particle);
      // a hair less: volumes of whole cells are sums of rounded parts
      if (root == particle && double(volumes[i]) >= cell_volume * (1 - 1e-4)) found[i] = pieces++;
      found[i] = found[root];
    }

  struct Neighbours {
    std::uint32_t from, to;
    float distance;
  };
  std::vector<Neighbours> open;
  for_neighbours([&](std::uint32_t i, std::uint32_t j) {
    if (found[i] >= 0 && found[j] >= 0) return;
    if (const double d = squared(i, j); d <= reach * reach) open.push_back({i, j, float(d)});
  });
  using Offer = std::pair<float, std::int32_t>;  // of a neighbour that has a piece: distance squared, piece
  const Offer none{std::numeric_limits<float>::infinity(), -1};
  std::vector<Offer> offers(open.empty() ? 0 : particles_, none);
  std::vector<std::uint32_t> layer;
  do {
    layer.clear();
    for (const Neighbours& n : open) {
      const bool first = found[n.from] >= 0, second = found[n.to] >= 0;
      if (first == second) continue;
      const std::uint32_t to = first ? n.to : n.from;
      if (offers[to].second < 0) layer.push_back(to);
      offers[to] = std::min(offers[to], {n.distance, found[first ? n.from : n.to]});
    }
    for (const std::uint32_t i : layer) found[i] = offers[i].second;
    std::erase_if(open, [&](const Neighbours& n) { return found[n.from] >= 0 && found[n.to] >= 0; });
  } while (!layer.empty());

  keep_numbers(frame, found, pieces);
  Count count{pieces, 0};
  double all = 0;
  for (std::size_t b = 0; b < counted_.size(); b++)
    for (std::size_t i = frame.body_begin(b); counted_[b] && i < frame.body_ends[b]; i++) {
      all += double(frame.volumes[i]);
      if (found[i] < 0) count.debris += double(frame.volumes[i]);
    }
  if (all > 0) count.debris /= all;
  labels_ = std::move(found);
  return count;
}

void Pieces::keep_numbers(const ParticleFrame& frame, std::vector<std::int32_t>& found, std::int32_t pieces) {
  std::map<std::pair<std::int32_t, std::int32_t>, double> shared;  // rest volume, by piece found and number before
  for (std::size_t i = 0; i < labels_.size(); i++)
    if (found[i] >= 0 && labels_[i] >= 0) shared[{found[i], labels_[i]}] += double(frame.volumes[i]);
  std::vector<std::tuple<double, std::int32_t, std::int32_t>> largest;  // largest first
  for (const auto& [pair, volume] : shared) largest.emplace_back(-volume, pair.first, pair.second);
  std::sort(largest.begin(), largest.end());
  std::vector<std::int32_t> number(std::size_t(pieces), -1);
  std::vector<bool> taken(std::size_t(next_), false);
  for (const auto& [volume, piece, before] : largest) {
    if (number[std::size_t(piece)] >= 0 || taken[std::size_t(before)]) continue;
    number[std::size_t(piece)] = before;
    taken[std::size_t(before)] = true;
  }
  for (std::int32_t& n : number)
    if (n < 0) n = next_++;
  for (std::int32_t& piece : found)
    if (piece >= 0) piece = number[std::size_t(piece)];
}

bool Pieces::consistent() const {
  return next_ >= 0 && (labels_.empty() || labels_.size() == particles_) &&
         std::all_of(labels_.begin(), labels_.end(), [this](std::int32_t label) { return label >= -1 && label < next_; });
}

std::size_t Pieces::bytes() const {
  return first_.capacity() * sizeof first_[0] + others_.capacity() * sizeof others_[0] + labels_.capacity() * sizeof labels_[0];
}

}  // namespace cleave::output
