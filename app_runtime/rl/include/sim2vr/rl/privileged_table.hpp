// SPDX-License-Identifier: Apache-2.0
// A game's privileged observations: one table of names and getters.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::rl {

/// Name and getter of each privileged observation, in their order. `Source` is what the getters
/// read; what several of them need is computed once, when it is made.
template <typename Source>
class PrivilegedTable {
 public:
  void number(std::string name, std::function<double(const Source&)> value) {
    names_.push_back(std::move(name));
    values_.push_back(std::move(value));
  }

  /// Three numbers: `prefix` + "x" + `unit`, and so on.
  void vector(const std::string& prefix, const std::string& unit,
              const std::function<Vec3(const Source&)>& value) {
    for (int axis = 0; axis < 3; ++axis) {
      number(prefix + "xyz"[axis] + unit,
             [value, axis](const Source& source) { return value(source)[axis]; });
    }
  }

  const std::vector<std::string>& names() const { return names_; }

  /// Writes all values. Throws InvalidArgument when `row` has another size than names().
  void fill(const Source& source, std::span<float> row) const {
    if (row.size() != values_.size()) {
      throw InvalidArgument("values", std::to_string(row.size()) + " numbers",
                            std::to_string(values_.size()));
    }
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<float>(values_[i](source));
  }

 private:
  std::vector<std::string> names_;
  std::vector<std::function<double(const Source&)>> values_;
};

}  // namespace sim2vr::rl
