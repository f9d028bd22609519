// SPDX-License-Identifier: Apache-2.0
// Which of a level's boxes, mines or walls are done with.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::beats {

class Track {
 public:
  explicit Track(std::size_t count) : done_(count, 0) {}

  void finish(std::size_t i) {
    done_.at(i) = 1;
    while (first_ < done_.size() && done_[first_] != 0) ++first_;
  }

  /// Indices of `things`, which are in order of time, that are not done and not later than
  /// `latest_s`.
  template <class T>
  std::vector<std::size_t> out(const std::vector<T>& things, double latest_s) const {
    std::vector<std::size_t> indices;
    for (std::size_t i = first_; i < done_.size() && things[i].time_s <= latest_s; ++i) {
      if (done_[i] == 0) indices.push_back(i);
    }
    return indices;
  }

  void fields(Archive& archive) {
    const std::size_t count = done_.size();
    archive.field("done", done_);
    archive.field("first", first_);
    if (done_.size() != count || first_ > count) {
      throw EngineError("saved state: a level with another number of things");
    }
  }

 private:
  std::vector<std::uint8_t> done_;
  /// None before it is left.
  std::uint64_t first_ = 0;
};

}  // namespace sim2vr::games::beats
