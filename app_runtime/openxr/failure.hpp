// SPDX-License-Identifier: Apache-2.0
// The one exception of this room: the code that a call returns, and why.
#pragma once

#include <openxr/openxr.h>

#include <stdexcept>
#include <string>

namespace sim2vr::openxr {

/// Ends the call with `result`; the text goes to standard error with the call's name before it.
class Failure : public std::runtime_error {
 public:
  Failure(XrResult result, const std::string& cause) : std::runtime_error(cause), result_(result) {}
  XrResult result() const { return result_; }

 private:
  XrResult result_;
};

}  // namespace sim2vr::openxr
