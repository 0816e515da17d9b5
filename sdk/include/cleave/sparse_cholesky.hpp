/// Cholesky factors of sparse symmetric matrices whose rows have a place in space, as constraints on a grid have.
///
/// Mostly of use to precondition iterations: single precision, or a matrix of a while ago, then does no harm.
#ifndef CLEAVE_SPARSE_CHOLESKY_HPP
#define CLEAVE_SPARSE_CHOLESKY_HPP

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

namespace cleave {

/// The lower triangle of a symmetric matrix, row by row with ascending columns, the diagonal last.
template <class S>
struct SymmetricRows {
  std::vector<std::size_t> begin;  ///< of each row, and the end of the last
  std::vector<std::uint32_t> column;
  std::vector<S> value;

  std::size_t size() const { return begin.empty() ? 0 : begin.size() - 1; }
  bool is_lower_triangle() const {
    if (begin.empty() || begin.front() != 0 || begin.back() != column.size()) return false;
    for (std::size_t i = 0; i < size(); ++i) {
      if (begin[i] >= begin[i + 1] || begin[i + 1] > column.size() || column[begin[i + 1] - 1] != i) return false;
      for (std::size_t e = begin[i]; e + 1 < begin[i + 1]; ++e)
        if (column[e] >= column[e + 1]) return false;
    }
    return true;
  }
};

namespace detail {

#if defined(__AVX512F__)
inline constexpr std::size_t dense_vector_bytes = 64;
#elif defined(__AVX__)
inline constexpr std::size_t dense_vector_bytes = 32;
#else
inline constexpr std::size_t dense_vector_bytes = 16;
#endif
template <class S>
inline constexpr std::size_t dense_vector_width = dense_vector_bytes / sizeof(S);
template <class S>
struct DenseVector;
template <>
struct DenseVector<float> {
  typedef float type __attribute__((vector_size(dense_vector_bytes), aligned(4), may_alias));
};
template <>
struct DenseVector<double> {
  typedef double type __attribute__((vector_size(dense_vector_bytes), aligned(8), may_alias));
};

template <class S>
S dot(const S* a, const S* b, std::size_t n) {
  using Vector = typename DenseVector<S>::type;
  constexpr std::size_t width = dense_vector_width<S>;
  Vector sums[2] = {};
  std::size_t i = 0;
  for (; i + 2 * width <= n; i += 2 * width)
    for (std::size_t s = 0; s < 2; ++s)
      sums[s] += *reinterpret_cast<const Vector*>(a + i + s * width) * *reinterpret_cast<const Vector*>(b + i + s * width);
  sums[0] += sums[1];
  S sum = 0;
  for (std::size_t s = 0; s < width; ++s) sum += sums[0][s];
  for (; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/// Dense Cholesky of the leading columns of a symmetric matrix, blocked, its products in registers.
template <class S>
class DenseCholesky {
 public:
  /// Of a(0..m)(0..m), column-major with leading dimension m, lower triangle: factors the first k columns and leaves the Schur
  /// complement of the rest. A pivot that rounding has left below `smallest` is replaced by it.
  void factor(S* a, std::size_t m, std::size_t k, S smallest) {
    for (std::size_t j = 0; j < k; j += panel) {
      const std::size_t n = std::min(panel, k - j);
      factor_panel(a + j * m + j, m, m - j, n, smallest);
      if (j + n < m) update(a + (j + n) * m + j + n, m, m - j - n, a + j * m + j + n, n);
    }
  }

 private:
  static constexpr std::size_t panel = 64, width = dense_vector_width<S>, tile_rows = 2 * width, tile_columns = 6;
  using Vector = typename DenseVector<S>::type;

  /// Columns 0..n of a matrix of m rows.
  static void factor_panel(S* a, std::size_t stride, std::size_t m, std::size_t n, S smallest) {
    for (std::size_t j = 0; j < n; ++j) {
      S* column = a + j * stride;
      for (std::size_t p = 0; p < j; ++p) {
        const S* earlier = a + p * stride;
        const S factor = earlier[j];
        for (std::size_t i = j; i < m; ++i) column[i] -= factor * earlier[i];
      }
      const S pivot = std::sqrt(std::max(column[j], smallest)), inverse = 1 / pivot;
      column[j] = pivot;
      for (std::size_t i = j + 1; i < m; ++i) column[i] *= inverse;
    }
  }

  /// c -= p p^T, lower triangle of m rows; p has n columns.
  void update(S* c, std::size_t stride, std::size_t m, const S* p, std::size_t n) {
    const std::size_t row_tiles = (m + tile_rows - 1) / tile_rows, column_tiles = (m + tile_columns - 1) / tile_columns;
    pack(rows_, p, stride, m, n, tile_rows, row_tiles);
    pack(columns_, p, stride, m, n, tile_columns, column_tiles);
    for (std::size_t jt = 0; jt < column_tiles; ++jt) {
      const std::size_t j = jt * tile_columns, count = std::min(tile_columns, m - j);
      for (std::size_t it = j / tile_rows; it < row_tiles; ++it) {
        const std::size_t i = it * tile_rows;
        Vector sum[tile_columns][2] = {};
        const S *a = rows_.data() + it * n * tile_rows, *b = columns_.data() + jt * n * tile_columns;
        for (std::size_t q = 0; q < n; ++q, a += tile_rows, b += tile_columns) {
          const Vector low = *reinterpret_cast<const Vector*>(a), high = *reinterpret_cast<const Vector*>(a + width);
          for (std::size_t s = 0; s < tile_columns; ++s) {
            sum[s][0] += low * b[s];
            sum[s][1] += high * b[s];
          }
        }
        if (i + tile_rows <= m) {
          for (std::size_t s = 0; s < count; ++s) {
            Vector* to = reinterpret_cast<Vector*>(c + (j + s) * stride + i);
            to[0] -= sum[s][0];
            to[1] -= sum[s][1];
          }
        } else {
          S rest[tile_rows];
          for (std::size_t s = 0; s < count; ++s) {
            std::memcpy(rest, sum[s], sizeof rest);
            for (std::size_t r = 0; i + r < m; ++r) c[(j + s) * stride + i + r] -= rest[r];
          }
        }
      }
    }
  }

  /// Tiles of `tile` rows, in each of them one column after another; the last one is filled up with zeros.
  static void pack(std::vector<S>& to, const S* p, std::size_t stride, std::size_t m, std::size_t n, std::size_t tile,
                   std::size_t tiles) {
    to.resize(std::max(to.size(), tiles * tile * n));
    for (std::size_t t = 0; t < tiles; ++t) {
      const std::size_t begin = t * tile, count = std::min(tile, m - begin);
      for (std::size_t q = 0; q < n; ++q) {
        S* at = to.data() + (t * n + q) * tile;
        for (std::size_t r = 0; r < tile; ++r) at[r] = r < count ? p[q * stride + begin + r] : 0;
      }
    }
  }

  std::vector<S> rows_, columns_;
};

}  // namespace detail

/// A = L L^T by a multifrontal method with nested dissection of the places of the rows: the work grows with the square of the
/// number of rows in a solid block, and in proportion to it along a rope.
template <class S>
class SparseCholesky {
 public:
  /// Finds the order of elimination and the pattern of L. `place` has one point for each row.
  void analyze(const SymmetricRows<S>& A, const std::vector<std::array<float, 3>>& place) {
    const std::size_t n = A.size();
    fronts_.clear();
    build_graph(A);
    order_.resize(n);
    std::iota(order_.begin(), order_.end(), 0u);
    side_.assign(n, 0);
    next_ = 0;
    number_.assign(n, 0);
    dissect(0, n, place);
    for (std::size_t i = 0; i < n; ++i) number_[order_[i]] = std::uint32_t(i);
    find_patterns();
    find_trees();
    neighbours_ = {};
    neighbours_begin_ = {};
  }

  /// Multiplications in factor(), and numbers in L.
  double work() const { return work_; }
  std::size_t entries() const { return entries_; }
  std::size_t size() const { return order_.size(); }

  /// Of A + shift I, with the pattern analyzed. `run(count, task)` calls task(0) ... task(count - 1), in any order and on as
  /// many threads as it likes.
  template <class Run>
  void factor(const SymmetricRows<S>& A, S shift, Run run) {
    const std::size_t n = order_.size();
    if (factor_.size() < entries_) factor_.resize(entries_);
    // Where an entry belongs: the column that is eliminated first. Entries of each column, as rows in the order of elimination.
    std::vector<std::size_t> column_begin(n + 1, 0);
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t e = A.begin[i]; e < A.begin[i + 1]; ++e) ++column_begin[std::min(number_[i], number_[A.column[e]]) + 1];
    for (std::size_t i = 0; i < n; ++i) column_begin[i + 1] += column_begin[i];
    std::vector<std::pair<std::uint32_t, S>> entries(column_begin[n]);
    std::vector<std::size_t> at(column_begin.begin(), column_begin.end() - 1);
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t e = A.begin[i]; e < A.begin[i + 1]; ++e) {
        const auto [low, high] = std::minmax(number_[i], number_[A.column[e]]);
        entries[at[low]++] = {high, A.value[e] + (low == high ? shift : 0)};
      }

    std::vector<std::vector<S>> matrices(fronts_.size());  // of the fronts whose updates are still to be taken
    const auto factor_front = [&](std::size_t f, Scratch& scratch) {
      std::vector<std::uint32_t>&position = scratch.position, &target = scratch.target;
      position.resize(n);
      const Front& front = fronts_[f];
      const std::size_t k = front.count, m = k + front.border.size();
      std::vector<S> matrix = scratch.take(m * m);
      for (std::size_t c = 0; c < m; ++c) std::fill_n(matrix.data() + c * m + c, m - c, S(0));
      for (std::size_t i = 0; i < front.border.size(); ++i) position[front.border[i]] = std::uint32_t(k + i);
      const auto row_of = [&](std::uint32_t number) -> std::size_t {
        return number < front.first + k ? number - front.first : position[number];
      };
      for (std::size_t c = 0; c < k; ++c)
        for (std::size_t e = column_begin[front.first + c]; e < column_begin[front.first + c + 1]; ++e)
          matrix[c * m + row_of(entries[e].first)] = entries[e].second;
      for (const std::uint32_t child : front.children) {
        const auto& border = fronts_[child].border;
        const std::size_t size = border.size(), done = fronts_[child].count, stride = done + size;
        target.resize(size);
        for (std::size_t i = 0; i < size; ++i) target[i] = std::uint32_t(row_of(border[i]));
        for (std::size_t c = 0; c < size; ++c) {
          const S* from = matrices[child].data() + (done + c) * stride + done;
          S* column = matrix.data() + target[c] * m;
          for (std::size_t i = c; i < size; ++i) column[target[i]] += from[i];
        }
        scratch.give(std::move(matrices[child]));
      }
      scratch.dense.factor(matrix.data(), m, k, shift);
      for (std::size_t c = 0; c < k; ++c)
        std::copy_n(matrix.data() + c * m + c, m - c, factor_.data() + front.entries + c * m - c * (c - 1) / 2);
      if (front.border.empty())
        scratch.give(std::move(matrix));
      else
        matrices[f] = std::move(matrix);
    };
    scratch_.resize(trees_.size() + 1);
    run(trees_.size(), [&](std::size_t t) {
      for (std::size_t f = trees_[t].first; f <= trees_[t].root; ++f) factor_front(f, scratch_[t]);
    });
    Scratch& of_trunk = scratch_.back();
    for (const std::uint32_t f : trunk_) factor_front(f, of_trunk);
    for (std::size_t t = 0; t < trees_.size() && of_trunk.free.size() > 1; ++t) scratch_[t].give(of_trunk.take(0));
  }

  /// The numbers of L, to go on with those of another.
  std::vector<S> values() const { return {factor_.begin(), factor_.begin() + std::ptrdiff_t(entries_)}; }
  /// After the same analysis. False if they are not as many as L has.
  bool take(std::vector<S> values) {
    if (values.size() != entries_) return false;
    factor_ = std::move(values);
    return true;
  }

  /// x becomes (A + shift I)^-1 x, nearly.
  template <class Run>
  void solve(std::vector<S>& x, Run run) const {
    const std::size_t n = order_.size();
    std::vector<S> y(n);
    for (std::size_t i = 0; i < n; ++i) y[i] = x[order_[i]];
    std::vector<std::vector<S>> changes(trees_.size());  // of each tree, to what its root borders on
    run(trees_.size(), [&](std::size_t t) {
      std::vector<S> own(n, 0), local;
      const Tree& tree = trees_[t];
      const std::size_t begin = tree.first_row, end = fronts_[tree.root].first + fronts_[tree.root].count;
      std::copy(y.begin() + std::ptrdiff_t(begin), y.begin() + std::ptrdiff_t(end), own.begin() + std::ptrdiff_t(begin));
      for (std::size_t f = tree.first; f <= tree.root; ++f) eliminate(fronts_[f], own, local);
      std::copy(own.begin() + std::ptrdiff_t(begin), own.begin() + std::ptrdiff_t(end), y.begin() + std::ptrdiff_t(begin));
      for (const std::uint32_t i : fronts_[tree.root].border) changes[t].push_back(own[i]);
    });
    for (std::size_t t = 0; t < trees_.size(); ++t) {
      const auto& border = fronts_[trees_[t].root].border;
      for (std::size_t i = 0; i < border.size(); ++i) y[border[i]] += changes[t][i];
    }
    std::vector<S> local;
    for (const std::uint32_t f : trunk_) eliminate(fronts_[f], y, local);
    for (auto f = trunk_.rbegin(); f != trunk_.rend(); ++f) substitute(fronts_[*f], y, local);
    run(trees_.size(), [&](std::size_t t) {
      std::vector<S> of_tree;
      for (std::size_t f = trees_[t].root + 1; f-- > trees_[t].first;) substitute(fronts_[f], y, of_tree);
    });
    for (std::size_t i = 0; i < n; ++i) x[order_[i]] = y[i];
  }

 private:
  /// Rows that are eliminated together, with all that they are connected with by then.
  struct Front {
    std::uint32_t first, count;           // in the order of elimination
    std::vector<std::uint32_t> border;    // what they change, ascending
    std::vector<std::uint32_t> children;  // of which they take the updates
    std::size_t entries = 0;              // where their columns of L begin
  };
  static constexpr std::size_t leaf = 96;
  /// What a task works with, kept for the next factors.
  struct Scratch {
    detail::DenseCholesky<S> dense;
    std::vector<std::uint32_t> position, target;
    std::vector<std::vector<S>> free;

    /// At least so many numbers, of any value.
    std::vector<S> take(std::size_t size) {
      std::vector<S> found;
      if (!free.empty()) {
        found = std::move(free.back());
        free.pop_back();
      }
      if (found.size() < size) found.resize(size);
      return found;
    }
    void give(std::vector<S> no_longer_needed) { free.push_back(std::move(no_longer_needed)); }
  };
  /// Fronts first..root and what is below them, independent of all others up to the root.
  struct Tree {
    std::size_t first, root;
    std::size_t first_row;
  };

  void eliminate(const Front& front, std::vector<S>& y, std::vector<S>& local) const {
    const std::size_t k = front.count, m = k + front.border.size();
    local.assign(m, 0);
    std::copy_n(y.data() + front.first, k, local.data());
    const S* column = factor_.data() + front.entries;
    for (std::size_t c = 0; c < k; column += m - c, ++c) {
      const S value = local[c] /= column[0];
      S* rest = local.data() + c;
      for (std::size_t i = 1; i < m - c; ++i) rest[i] -= column[i] * value;
    }
    std::copy_n(local.data(), k, y.data() + front.first);
    for (std::size_t i = k; i < m; ++i) y[front.border[i - k]] += local[i];
  }
  void substitute(const Front& front, std::vector<S>& y, std::vector<S>& local) const {
    const std::size_t k = front.count, m = k + front.border.size();
    local.resize(m);
    std::copy_n(y.data() + front.first, k, local.data());
    for (std::size_t i = k; i < m; ++i) local[i] = y[front.border[i - k]];
    const S* column = factor_.data() + front.entries + (k * m - k * (k - 1) / 2);
    for (std::size_t c = k; c-- > 0;) {
      column -= m - c;
      local[c] = (local[c] - detail::dot(column + 1, local.data() + c + 1, m - c - 1)) / column[0];
    }
    std::copy_n(local.data(), k, y.data() + front.first);
  }

  /// Trees of less than half of all work, and the trunk above them.
  void find_trees() {
    const std::size_t count = fronts_.size();
    std::vector<double> work(count);
    std::vector<std::size_t> first(count);
    std::vector<bool> in_tree(count, false), below(count, false);
    for (std::size_t f = 0; f < count; ++f) {
      const double k = fronts_[f].count, m = k + double(fronts_[f].border.size());
      work[f] = m * m * m - (m - k) * (m - k) * (m - k);
      first[f] = f;
      for (const std::uint32_t child : fronts_[f].children) {
        work[f] += work[child];
        first[f] = std::min(first[f], first[child]);
        below[child] = true;
      }
    }
    double whole = 0;
    for (std::size_t f = 0; f < count; ++f) whole += below[f] ? 0 : work[f];
    trees_.clear();
    trunk_.clear();
    for (std::size_t f = count; f-- > 0;) {
      if (in_tree[f]) continue;
      if (work[f] > 0.5 * whole) {
        trunk_.insert(trunk_.begin(), std::uint32_t(f));
        continue;
      }
      for (std::size_t i = first[f]; i <= f; ++i) in_tree[i] = true;
      trees_.push_back({first[f], f, fronts_[first[f]].first});
    }
  }

  void build_graph(const SymmetricRows<S>& A) {
    const std::size_t n = A.size();
    neighbours_begin_.assign(n + 1, 0);
    const auto for_pairs = [&](auto visit) {
      for (std::uint32_t i = 0; i < n; ++i)
        for (std::size_t e = A.begin[i]; e < A.begin[i + 1]; ++e)
          if (A.column[e] != i) visit(i, A.column[e]);
    };
    for_pairs([&](std::uint32_t i, std::uint32_t j) { ++neighbours_begin_[i + 1], ++neighbours_begin_[j + 1]; });
    for (std::size_t i = 0; i < n; ++i) neighbours_begin_[i + 1] += neighbours_begin_[i];
    neighbours_.resize(neighbours_begin_[n]);
    std::vector<std::size_t> at(neighbours_begin_.begin(), neighbours_begin_.end() - 1);
    for_pairs([&](std::uint32_t i, std::uint32_t j) { neighbours_[at[i]++] = j, neighbours_[at[j]++] = i; });
  }

  /// Orders begin..end of order_: what lies on one side, what lies on the other, and last what separates them. Adds their
  /// fronts and returns those that nothing of begin..end takes updates of.
  std::vector<std::uint32_t> dissect(std::size_t begin, std::size_t end, const std::vector<std::array<float, 3>>& place) {
    const auto first = order_.begin() + std::ptrdiff_t(begin), last = order_.begin() + std::ptrdiff_t(end);
    std::vector<std::uint32_t> children;
    std::size_t separator = begin;
    if (end - begin > leaf) {
      const auto [axis, split] = middle(first, last, place);
      const auto right = std::stable_partition(first, last, [&, a = axis, s = split](auto i) { return place[i][a] < s; });
      if (right != first && right != last) {
        const std::uint32_t mark = ++next_;
        for (auto i = right; i != last; ++i) side_[*i] = mark;
        const auto between = std::stable_partition(first, right, [&](std::uint32_t i) {
          return std::none_of(neighbours_.begin() + std::ptrdiff_t(neighbours_begin_[i]),
                              neighbours_.begin() + std::ptrdiff_t(neighbours_begin_[i + 1]),
                              [&](std::uint32_t j) { return side_[j] == mark; });
        });
        const auto end_of_right = std::rotate(between, right, last);
        const auto index = [&](auto i) { return std::size_t(i - order_.begin()); };
        separator = index(end_of_right);
        for (const auto& [from, to] : {std::pair(begin, index(between)), std::pair(index(between), separator)}) {
          if (from == to) continue;
          const auto roots = dissect(from, to, place);
          children.insert(children.end(), roots.begin(), roots.end());
        }
      }
    }
    if (separator == end) return children;
    fronts_.push_back({std::uint32_t(separator), std::uint32_t(end - separator), {}, std::move(children)});
    return {std::uint32_t(fronts_.size() - 1)};
  }

  /// Where to cut: across the longest extent, between places, near the median.
  template <class Iterator>
  static std::pair<unsigned, float> middle(Iterator first, Iterator last, const std::vector<std::array<float, 3>>& place) {
    std::array<float, 3> low = place[*first], high = low;
    for (auto i = first; i != last; ++i)
      for (unsigned a = 0; a < 3; ++a) {
        low[a] = std::min(low[a], place[*i][a]);
        high[a] = std::max(high[a], place[*i][a]);
      }
    unsigned axis = 0;
    for (unsigned a = 1; a < 3; ++a)
      if (high[a] - low[a] > high[axis] - low[axis]) axis = a;
    std::vector<float> along;
    for (auto i = first; i != last; ++i) along.push_back(place[*i][axis]);
    const auto half = along.begin() + std::ptrdiff_t(along.size() / 2);
    std::nth_element(along.begin(), half, along.end());
    const float median = *half;
    // Before all that lie at the median, or behind them: whichever is nearer to the middle.
    std::ptrdiff_t before = 0, up_to = 0;
    float next = high[axis];
    for (const float x : along) {
      before += x < median;
      up_to += x <= median;
      if (x > median) next = std::min(next, x);
    }
    const auto whole = std::ptrdiff_t(along.size());
    return {axis, std::abs(2 * before - whole) <= std::abs(2 * up_to - whole) ? median : next};
  }

  void find_patterns() {
    std::vector<std::uint32_t> seen(order_.size(), ~std::uint32_t(0));
    entries_ = 0;
    work_ = 0;
    for (std::uint32_t f = 0; f < fronts_.size(); ++f) {
      Front& front = fronts_[f];
      const std::uint32_t end = front.first + front.count;
      const auto reach = [&](std::uint32_t number) {
        if (number < end || seen[number] == f) return;
        seen[number] = f;
        front.border.push_back(number);
      };
      for (std::uint32_t i = front.first; i < end; ++i)
        for (std::size_t e = neighbours_begin_[order_[i]]; e < neighbours_begin_[order_[i] + 1]; ++e)
          reach(number_[neighbours_[e]]);
      for (const std::uint32_t child : front.children)
        for (const std::uint32_t number : fronts_[child].border) reach(number);
      std::sort(front.border.begin(), front.border.end());
      const double k = front.count, m = k + double(front.border.size());
      front.entries = entries_;
      entries_ += std::size_t(k * m - k * (k - 1) / 2);
      work_ += (m * m * m - (m - k) * (m - k) * (m - k)) / 6;
    }
  }

  std::vector<std::uint32_t> order_;   // row of A by its number in the order of elimination
  std::vector<std::uint32_t> number_;  // and the other way round
  std::vector<Front> fronts_;          // children before parents
  std::vector<S> factor_;
  std::size_t entries_ = 0;
  double work_ = 0;
  std::vector<Scratch> scratch_;
  std::vector<Tree> trees_;
  std::vector<std::uint32_t> trunk_;  // fronts, children before parents
  // while a matrix is analyzed
  std::vector<std::size_t> neighbours_begin_;
  std::vector<std::uint32_t> neighbours_;
  std::vector<std::uint32_t> side_;
  std::uint32_t next_ = 0;
};

/// A = L L^T as far as the pattern of A goes (Meijerink and van der Vorst 1977), with as much added to the diagonal as it takes
/// for pivots to be positive (Manteuffel 1980). Memory and work grow in proportion to the number of rows.
template <class S>
class IncompleteCholesky {
 public:
  /// Of A + shift I.
  void factor(const SymmetricRows<S>& A, S shift) {
    factor_.begin = A.begin;
    factor_.column = A.column;
    factor_.value.resize(A.value.size());
    while (!try_factor(A, shift)) shift = std::max(S(1e-3), 4 * shift);
  }

  /// Multiplications in factor(), nearly.
  double work() const { return work_; }
  std::size_t size() const { return factor_.size(); }

  const std::vector<S>& values() const { return factor_.value; }
  /// False if they are not as many as A has.
  bool take(const SymmetricRows<S>& A, std::vector<S> values) {
    if (values.size() != A.column.size()) return false;
    factor_ = {A.begin, A.column, std::move(values)};
    return true;
  }

  /// x becomes (L L^T)^-1 x.
  void solve(std::vector<S>& x) const {
    const std::size_t n = size();
    const auto& [begin, column, value] = factor_;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t diagonal = begin[i + 1] - 1;
      S sum = x[i];
      for (std::size_t e = begin[i]; e < diagonal; ++e) sum -= value[e] * x[column[e]];
      x[i] = sum / value[diagonal];
    }
    for (std::size_t i = n; i-- > 0;) {
      const std::size_t diagonal = begin[i + 1] - 1;
      const S found = x[i] /= value[diagonal];
      for (std::size_t e = begin[i]; e < diagonal; ++e) x[column[e]] -= value[e] * found;
    }
  }

 private:
  /// Row by row. False if next to nothing of a diagonal is left as the pivot.
  bool try_factor(const SymmetricRows<S>& A, S shift) {
    const auto& [begin, column, value] = factor_;
    std::vector<S> row(A.size(), 0);  // of L, at the columns it has so far
    work_ = 0;
    for (std::size_t i = 0; i < A.size(); ++i) {
      const std::size_t diagonal = begin[i + 1] - 1;
      S pivot = A.value[diagonal] + shift;
      const S least = S(1e-3) * pivot;
      for (std::size_t e = begin[i]; e < diagonal; ++e) {
        const std::size_t j = column[e], diagonal_of_j = begin[j + 1] - 1;
        S sum = A.value[e];
        for (std::size_t k = begin[j]; k < diagonal_of_j; ++k) sum -= value[k] * row[column[k]];
        work_ += double(diagonal_of_j - begin[j]);
        const S found = sum / value[diagonal_of_j];
        row[j] = factor_.value[e] = found;
        pivot -= found * found;
      }
      for (std::size_t e = begin[i]; e < diagonal; ++e) row[column[e]] = 0;
      if (!(pivot > least)) return false;
      factor_.value[diagonal] = std::sqrt(pivot);
    }
    return true;
  }

  SymmetricRows<S> factor_;
  double work_ = 0;
};

}  // namespace cleave

#endif
