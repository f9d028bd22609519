// SPDX-License-Identifier: Apache-2.0
// Calls of the runtime where memory runs out: they return, and nothing is thrown through them.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <string>

#include "failing_memory.hpp"
#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

TEST(NoMemory, FailingCallsReturnTheirCodes) {
  FakeHarness harness;
  harness.sendConfig();
  Program program;
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  const auto get_system = XR_CALL(program.instance, xrGetSystem);
  const auto to_path = XR_CALL(program.instance, xrStringToPath);
  XrSystemGetInfo form{XR_TYPE_SYSTEM_GET_INFO, nullptr, XR_FORM_FACTOR_HANDHELD_DISPLAY};
  int out_of_memory = 0;
  int told = 0;
  for (long after = 0; after < 40; ++after) {
    XrSystemId system = 0;
    XrPath path = XR_NULL_PATH;
    XrResult unsupported = XR_SUCCESS;
    XrResult new_path = XR_SUCCESS;
    const std::string text = "/user/a_path_longer_than_a_short_string/" + std::to_string(after);
    {
      const FailingMemory memory(after);
      unsupported = get_system(program.instance, &form, &system);
    }
    {
      const FailingMemory memory(after);
      new_path = to_path(program.instance, text.c_str(), &path);
    }
    EXPECT_TRUE(unsupported == XR_ERROR_OUT_OF_MEMORY ||
                unsupported == XR_ERROR_FORM_FACTOR_UNSUPPORTED)
        << unsupported;
    EXPECT_TRUE(new_path == XR_ERROR_OUT_OF_MEMORY || new_path == XR_SUCCESS) << new_path;
    if (new_path == XR_ERROR_OUT_OF_MEMORY) ++out_of_memory;
    if (unsupported == XR_ERROR_FORM_FACTOR_UNSUPPORTED) ++told;
    // With memory again, the call does what it does.
    EXPECT_EQ(to_path(program.instance, text.c_str(), &path), XR_SUCCESS);
  }
  EXPECT_GT(out_of_memory, 0);
  EXPECT_LT(out_of_memory, 40);
  EXPECT_GT(told, 0);
}

TEST(NoMemory, TheLoadersDoorReturnsItsCode) {
  void* library = ::dlopen(SIM2VR_OPENXR_LIBRARY, RTLD_NOW | RTLD_LOCAL);
  ASSERT_NE(library, nullptr) << ::dlerror();
  const auto negotiate = reinterpret_cast<XrResult (*)(const void*, void*)>(
      ::dlsym(library, "xrNegotiateLoaderRuntimeInterface"));
  for (long after = 0; after < 20; ++after) {
    XrResult result = XR_SUCCESS;
    {
      const FailingMemory memory(after);
      result = negotiate(nullptr, nullptr);
    }
    EXPECT_EQ(result, XR_ERROR_INITIALIZATION_FAILED);
  }
}

}  // namespace
}  // namespace sim2vr::openxr::test
