// SPDX-License-Identifier: Apache-2.0
// What a loader gives to an API layer and gets from it (openxr/loader_interfaces.h).
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include "api.hpp"

namespace sim2vr::openxr::test {

struct CreateInfo;
using Create = XrResult (*)(const XrInstanceCreateInfo*, const CreateInfo*, XrInstance*);
struct NextInfo {
  std::uint32_t type = 5, version = 1;
  std::size_t size = sizeof(NextInfo);
  char layer_name[XR_MAX_API_LAYER_NAME_SIZE]{};
  PFN_xrGetInstanceProcAddr get = nullptr;
  Create create = nullptr;
  NextInfo* next = nullptr;
};
struct CreateInfo {
  std::uint32_t type = 4, version = 1;
  std::size_t size = sizeof(CreateInfo);
  void* loader_instance = nullptr;
  char settings[512]{};
  NextInfo* next = nullptr;
};
struct LoaderInfo {
  std::uint32_t type = 1, version = 1;
  std::size_t size = sizeof(LoaderInfo);
  std::uint32_t min_interface = 1, max_interface = 1;
  XrVersion min_api = kVersion10, max_api = kNewestVersion;
};
struct LayerRequest {
  std::uint32_t type = 2, version = 1;
  std::size_t size = sizeof(LayerRequest);
  std::uint32_t interface = 0;
  XrVersion api = 0;
  PFN_xrGetInstanceProcAddr get = nullptr;
  Create create = nullptr;
};

/// The recording layer, as loaders open it.
inline LayerRequest openLayer() {
  void* library = ::dlopen(SIM2VR_OPENXR_LAYER, RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(library, nullptr) << ::dlerror();
  const auto negotiate =
      reinterpret_cast<XrResult (*)(const LoaderInfo*, const char*, LayerRequest*)>(
          ::dlsym(library, "xrNegotiateLoaderApiLayerInterface"));
  const LoaderInfo loader;
  LayerRequest layer;
  EXPECT_EQ(negotiate(&loader, "layer", &layer), XR_SUCCESS);
  return layer;
}

}  // namespace sim2vr::openxr::test
