#pragma once

#include <algorithm>

namespace cleave::mpm {

/// When the factors of the coarse space are made, and made anew: as soon as the products with the Hessian that they would have
/// saved have cost as much. So the cost is at most twice that of knowing beforehand. It hangs on counts alone, never on a
/// clock. Costs are in symplectic steps (see solve_cost).
class CoarseChoice {
 public:
  /// `price`: what making them takes as far as it is known.
  explicit CoarseChoice(double price = 0) : price_(price) {}
  void set_price(double price) { price_ = price; }

  /// Whether they are due, after so many products for the present direction.
  bool due(int products, double product_cost) const {
    return counted_ == none && rent_ + (products - usual_) * product_cost > price_;
  }
  /// They are made, in the middle of a direction if that had taken products.
  void made(int products) {
    if (alone_ < products) alone_ = products;
    rent_ = sum_ = 0;
    counted_ = 0;
  }
  /// A direction, or what was left of it, took so many products, with factors or without them. Returns false if these save
  /// nothing.
  bool took(int products, bool with_factors, double product_cost, double cost_without) {
    if (!with_factors) alone_ = alone_ == 0 ? products : 0.75 * alone_ + 0.25 * products;
    if (counted_ == none) {
      rent_ = std::max(0.0, rent_ + (products - usual_) * product_cost);
      return true;
    }
    sum_ += products;
    if (++counted_ < enough) return true;
    usual_ = sum_ / counted_;
    counted_ = none;
    return usual_ * product_cost < alone_ * cost_without;
  }

  /// To be saved and restored.
  template <class Self, class Archive>
  static void list(Self& self, Archive& archive) {
    archive(self.price_, self.rent_, self.usual_, self.alone_, self.sum_, self.counted_);
  }

 private:
  static constexpr int none = -1, enough = 8;

  double price_;
  double rent_ = 0;     // of products beyond the usual ones
  double usual_ = 4;    // products for a direction with new factors
  double alone_ = 0;    // and without any
  double sum_ = 0;      // products since the factors were made,
  int counted_ = none;  // for so many directions, until these are enough
};

}  // namespace cleave::mpm
