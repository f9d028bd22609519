// SPDX-License-Identifier: Apache-2.0
// The library as a loader opens it: its one symbol, its negotiation, and Khronos' loader itself
// where it is installed.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>

#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

struct LoaderInfo {
  std::uint32_t type = 1;
  std::uint32_t version = 1;
  std::size_t size = sizeof(LoaderInfo);
  std::uint32_t min_interface = 1;
  std::uint32_t max_interface = 1;
  XrVersion min_api = XR_MAKE_VERSION(1, 0, 0);
  XrVersion max_api = XR_MAKE_VERSION(1, 1, 0xffff);
};
struct RuntimeRequest {
  std::uint32_t type = 3;
  std::uint32_t version = 1;
  std::size_t size = sizeof(RuntimeRequest);
  std::uint32_t interface = 0;
  XrVersion api = 0;
  PFN_xrGetInstanceProcAddr get = nullptr;
};
using Negotiate = XrResult (*)(const LoaderInfo*, RuntimeRequest*);

struct Library : ::testing::Test {
  void* library = ::dlopen(SIM2VR_OPENXR_LIBRARY, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  Negotiate negotiate =
      reinterpret_cast<Negotiate>(::dlsym(library, "xrNegotiateLoaderRuntimeInterface"));
};

TEST_F(Library, ExportsItsOneDoor) {
  ASSERT_NE(library, nullptr) << ::dlerror();
  ASSERT_NE(negotiate, nullptr);
  EXPECT_EQ(::dlsym(library, "xrCreateInstance"), nullptr);
  EXPECT_EQ(::dlsym(library, "_ZN6sim2vr7versionEv"), nullptr);
}

TEST_F(Library, NegotiatesInterfaceOne) {
  RuntimeRequest request;
  EXPECT_EQ(negotiate(nullptr, &request), XR_ERROR_INITIALIZATION_FAILED);
  LoaderInfo info;
  EXPECT_EQ(negotiate(&info, nullptr), XR_ERROR_INITIALIZATION_FAILED);
  info.min_interface = 2;
  EXPECT_EQ(negotiate(&info, &request), XR_ERROR_INITIALIZATION_FAILED);
  info.min_interface = 1;
  info.size = 8;
  EXPECT_EQ(negotiate(&info, &request), XR_ERROR_INITIALIZATION_FAILED);
  info.size = sizeof info;
  ASSERT_EQ(negotiate(&info, &request), XR_SUCCESS);
  EXPECT_EQ(request.interface, 1U);
  EXPECT_EQ(XR_VERSION_MINOR(request.api), 1U);
  PFN_xrVoidFunction found = nullptr;
  EXPECT_EQ(request.get(XR_NULL_HANDLE, "xrCreateInstance", &found), XR_SUCCESS);
}

/// Khronos' loader finds the library by its manifest, and a headless program plays through it.
TEST(Loader, PlaysThroughTheManifest) {
  ::setenv("XR_RUNTIME_JSON", SIM2VR_OPENXR_MANIFEST, 1);
  void* loader = ::dlopen("libopenxr_loader.so.1", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (loader == nullptr) GTEST_SKIP() << "no OpenXR loader here (libopenxr-loader1)";
  const auto get =
      reinterpret_cast<PFN_xrGetInstanceProcAddr>(::dlsym(loader, "xrGetInstanceProcAddr"));
  ASSERT_NE(get, nullptr);
  FakeHarness harness;
  harness.sendConfig();
  harness.send(MessageKind::accepted);
  harness.sendStep();
  XrInstance instance = XR_NULL_HANDLE;
  const auto call = [&]<class F>(F, const char* name) {
    PFN_xrVoidFunction found = nullptr;
    EXPECT_EQ(get(instance, name, &found), XR_SUCCESS) << name;
    return reinterpret_cast<F>(found);
  };
  XrInstanceCreateInfo info{};
  info.type = XR_TYPE_INSTANCE_CREATE_INFO;
  std::strcpy(info.applicationInfo.applicationName, "loaded");
  info.applicationInfo.apiVersion = XR_MAKE_VERSION(1, 0, 0);
  const char* extensions[]{"XR_MND_headless"};
  info.enabledExtensionCount = 1;
  info.enabledExtensionNames = extensions;
  ASSERT_EQ(call(PFN_xrCreateInstance{}, "xrCreateInstance")(&info, &instance), XR_SUCCESS);
  const XrSystemGetInfo form{XR_TYPE_SYSTEM_GET_INFO, nullptr, XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY};
  XrSystemId system = 0;
  ASSERT_EQ(call(PFN_xrGetSystem{}, "xrGetSystem")(instance, &form, &system), XR_SUCCESS);
  const XrSessionCreateInfo session_info{XR_TYPE_SESSION_CREATE_INFO, nullptr, 0, system};
  XrSession session = XR_NULL_HANDLE;
  ASSERT_EQ(call(PFN_xrCreateSession{}, "xrCreateSession")(instance, &session_info, &session),
            XR_SUCCESS);
  const XrSessionBeginInfo begin{XR_TYPE_SESSION_BEGIN_INFO, nullptr,
                                 XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO};
  ASSERT_EQ(call(PFN_xrBeginSession{}, "xrBeginSession")(session, &begin), XR_SUCCESS);
  XrFrameState state{XR_TYPE_FRAME_STATE, nullptr, 0, 0, 0};
  ASSERT_EQ(call(PFN_xrWaitFrame{}, "xrWaitFrame")(session, nullptr, &state), XR_SUCCESS);
  EXPECT_EQ(state.predictedDisplayTime, harness.latest());
  ASSERT_EQ(call(PFN_xrDestroyInstance{}, "xrDestroyInstance")(instance), XR_SUCCESS);
  EXPECT_EQ(harness.receiveJson(MessageKind::hello)["application"], "loaded");
  // The loader has closed the runtime, whose code and state between instances stay. The loader
  // itself stays open, as in programs, which are linked with it.
  EXPECT_NE(::dlopen(SIM2VR_OPENXR_LIBRARY, RTLD_NOW | RTLD_NOLOAD), nullptr);
}

}  // namespace
}  // namespace sim2vr::openxr::test
