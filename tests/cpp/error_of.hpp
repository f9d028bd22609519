// SPDX-License-Identifier: Apache-2.0
// The message of an error that is expected.
#pragma once

#include <string>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {

/// What an Error that `call` throws says; "none" if it throws none.
template <class Error = InvalidArgument>
std::string errorOf(const auto& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "none";
}

}  // namespace sim2vr
