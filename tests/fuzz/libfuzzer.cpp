// SPDX-License-Identifier: Apache-2.0
// The entry of one libFuzzer program; SIM2VR_FUZZ_TARGET names its target.
#include <cstddef>
#include <cstdint>

#include "targets.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  sim2vr::fuzz::SIM2VR_FUZZ_TARGET({reinterpret_cast<const char*>(data), size});
  return 0;
}
