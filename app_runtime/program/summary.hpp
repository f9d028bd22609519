// SPDX-License-Identifier: Apache-2.0
// What is printed about a round that was played here.
#pragma once

#include <cstdint>
#include <ostream>

#include "sim2vr/runtime/app.hpp"

namespace sim2vr::program {

class Summary {
 public:
  /// The result of the reset, then of every step.
  void add(const runtime::StepResult& result);
  bool finished() const { return latest_.finished; }
  void print(std::ostream& out, runtime::App& app) const;

 private:
  std::int64_t frames_ = -1;
  double reward_ = 0.0;
  runtime::StepResult latest_;
};

}  // namespace sim2vr::program
