// SPDX-License-Identifier: Apache-2.0
#include "summary.hpp"

#include <cmath>

namespace sim2vr::program {

void Summary::add(const runtime::StepResult& result) {
  ++frames_;
  // The reset's reward belongs to no step.
  if (frames_ > 0) reward_ += static_cast<double>(result.reward);
  latest_ = result;
}

void Summary::print(std::ostream& out, runtime::App& app) const {
  out << "frames " << frames_ << ", reward " << reward_ << ", "
      << (latest_.finished ? "round over" : "round not over") << ", state hash " << std::hex
      << app.stateHash() << std::dec << "\n";
  for (const auto& [name, value] : latest_.log) {
    // NaN: there is no such number in this round.
    if (!std::isnan(value)) out << "  " << name << " " << value << "\n";
  }
}

}  // namespace sim2vr::program
