// SPDX-License-Identifier: Apache-2.0
// Every call with wrong arguments: null, wrong type, destroyed handles, out of order.
#include "calls.hpp"

#include <cstring>
#include <ctime>

#include "program.hpp"

namespace sim2vr::openxr::test {
namespace {

struct Calls : ::testing::Test {
  Program program;

  void start(XrVersion version = kVersion11) {
    ASSERT_EQ(program.create({"XR_MND_headless", "XR_EXT_debug_utils",
                              "XR_KHR_convert_timespec_time", kPixels},
                             version),
              XR_SUCCESS);
    ASSERT_EQ(program.createSession(false), XR_SUCCESS);
  }
};

template <class Handle>
Handle destroyed() {
  return reinterpret_cast<Handle>(std::uint64_t{0x7777000000000101});
}

/// A structure of the wrong type, larger than any.
struct Wrong {
  XrStructureType type = XR_TYPE_UNKNOWN;
  std::uint8_t rest[4096]{};
  template <class T>
  T* as() {
    return reinterpret_cast<T*>(this);
  }
};

/// Handle invalid (null and destroyed), then null and then a wrong structure.
#define SIM2VR_WALK(name, Handle, good, ...)                                              \
  do {                                                                                    \
    const auto call = XR_CALL(program.instance, name);                                    \
    for (const Handle bad : {static_cast<Handle>(XR_NULL_HANDLE), destroyed<Handle>()}) { \
      EXPECT_EQ(walk(call, bad, __VA_ARGS__), XR_ERROR_HANDLE_INVALID) << #name;          \
    }                                                                                     \
    EXPECT_EQ(walkNull(call, good, __VA_ARGS__), XR_ERROR_VALIDATION_FAILURE) << #name;   \
    EXPECT_EQ(walk(call, good, __VA_ARGS__), XR_ERROR_VALIDATION_FAILURE) << #name;       \
  } while (false)

Wrong wrong;
std::uint64_t room[64];

/// Placeholders: a structure of the program, and memory for a result.
struct Structure {};
struct Result {};

template <class T, class Given>
T wrongOf(Given given) {
  if constexpr (std::is_same_v<Given, Structure>) {
    return reinterpret_cast<T>(&wrong);
  } else if constexpr (std::is_same_v<Given, Result>) {
    return reinterpret_cast<T>(room);
  } else {
    return static_cast<T>(given);
  }
}
template <class T, class Given>
T nullOf(Given given) {
  if constexpr (std::is_same_v<Given, Structure> || std::is_same_v<Given, Result>) {
    return nullptr;
  } else {
    return static_cast<T>(given);
  }
}
template <class Handle, class... Parameters, class... Given>
XrResult walk(XrResult (*call)(Handle, Parameters...), Handle handle, Given... given) {
  return call(handle, wrongOf<Parameters>(given)...);
}
template <class Handle, class... Parameters, class... Given>
XrResult walkNull(XrResult (*call)(Handle, Parameters...), Handle handle, Given... given) {
  return call(handle, nullOf<Parameters>(given)...);
}

TEST_F(Calls, OfAnInstance) {
  start();
  const XrInstance good = program.instance;
  SIM2VR_WALK(xrGetInstanceProperties, XrInstance, good, Structure{});
  SIM2VR_WALK(xrPollEvent, XrInstance, good, Structure{});
  SIM2VR_WALK(xrGetSystem, XrInstance, good, Structure{}, Result{});
  SIM2VR_WALK(xrGetSystemProperties, XrInstance, good, program.system, Structure{});
  SIM2VR_WALK(xrGetViewConfigurationProperties, XrInstance, good, program.system,
              XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO, Structure{});
  SIM2VR_WALK(xrCreateSession, XrInstance, good, Structure{}, Result{});
  SIM2VR_WALK(xrCreateActionSet, XrInstance, good, Structure{}, Result{});
  SIM2VR_WALK(xrSuggestInteractionProfileBindings, XrInstance, good, Structure{});
  SIM2VR_WALK(xrCreateDebugUtilsMessengerEXT, XrInstance, good, Structure{}, Result{});
  SIM2VR_WALK(xrSetDebugUtilsObjectNameEXT, XrInstance, good, Structure{});
}

TEST_F(Calls, OfASession) {
  start();
  const XrSession good = program.session;
  SIM2VR_WALK(xrBeginSession, XrSession, good, Structure{});
  SIM2VR_WALK(xrCreateReferenceSpace, XrSession, good, Structure{}, Result{});
  SIM2VR_WALK(xrCreateActionSpace, XrSession, good, Structure{}, Result{});
  SIM2VR_WALK(xrLocateViews, XrSession, good, Structure{}, Structure{}, 2U, Result{}, Result{});
  SIM2VR_WALK(xrCreateSwapchain, XrSession, good, Structure{}, Result{});
  SIM2VR_WALK(xrAttachSessionActionSets, XrSession, good, Structure{});
  SIM2VR_WALK(xrSyncActions, XrSession, good, Structure{});
  SIM2VR_WALK(xrGetActionStateBoolean, XrSession, good, Structure{}, Structure{});
  SIM2VR_WALK(xrGetActionStateFloat, XrSession, good, Structure{}, Structure{});
  SIM2VR_WALK(xrGetActionStateVector2f, XrSession, good, Structure{}, Structure{});
  SIM2VR_WALK(xrGetActionStatePose, XrSession, good, Structure{}, Structure{});
  SIM2VR_WALK(xrEnumerateBoundSourcesForAction, XrSession, good, Structure{}, 0U, Result{},
              Result{});
  SIM2VR_WALK(xrGetInputSourceLocalizedName, XrSession, good, Structure{}, 0U, Result{}, Result{});
  SIM2VR_WALK(xrGetCurrentInteractionProfile, XrSession, good, program.path("/user/head"),
              Structure{});
  SIM2VR_WALK(xrApplyHapticFeedback, XrSession, good, Structure{}, Structure{});
  SIM2VR_WALK(xrStopHapticFeedback, XrSession, good, Structure{});
  SIM2VR_WALK(xrWaitFrame, XrSession, good, Structure{}, Structure{});
  SIM2VR_WALK(xrEndFrame, XrSession, good, Structure{});
  SIM2VR_WALK(xrSessionInsertDebugUtilsLabelEXT, XrSession, good, Structure{});
}

TEST_F(Calls, OfTheOthers) {
  start();
  const XrSpace space = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  SIM2VR_WALK(xrLocateSpace, XrSpace, space, space, 1, Structure{});
  const XrSwapchain swapchain = program.swapchain(kColorFormat, 2, 2);
  SIM2VR_WALK(xrWaitSwapchainImage, XrSwapchain, swapchain, Structure{});
  const auto acquire = XR_CALL(program.instance, xrAcquireSwapchainImage);
  EXPECT_EQ(acquire(swapchain, nullptr, nullptr), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(acquire(nullptr, nullptr, nullptr), XR_ERROR_HANDLE_INVALID);
  std::uint32_t count = 0;
  std::vector<PixelsImage> images(3, PixelsImage{XR_TYPE_UNKNOWN, nullptr, nullptr});
  const auto enumerate = XR_CALL(program.instance, xrEnumerateSwapchainImages);
  auto* first = reinterpret_cast<XrSwapchainImageBaseHeader*>(images.data());
  EXPECT_EQ(enumerate(swapchain, 3, &count, first), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(enumerate(swapchain, 2, &count, first), XR_ERROR_SIZE_INSUFFICIENT);
  EXPECT_EQ(count, 3U);
}

TEST_F(Calls, HandlesOfAnotherTypeAndDestroyedOnesAreInvalid) {
  start();
  const XrSpace space = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySwapchain)(reinterpret_cast<XrSwapchain>(space)),
            XR_ERROR_HANDLE_INVALID);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(space), XR_SUCCESS);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(space), XR_ERROR_HANDLE_INVALID);
  const XrSpace next = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_VIEW);
  EXPECT_NE(next, space);
  const XrSwapchain swapchain = program.swapchain(kColorFormat, 2, 2);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySession)(program.session), XR_SUCCESS);
  // With their session.
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(next), XR_ERROR_HANDLE_INVALID);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySwapchain)(swapchain), XR_ERROR_HANDLE_INVALID);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySession)(program.session), XR_ERROR_HANDLE_INVALID);
}

TEST_F(Calls, SessionsKeepTheirOrder) {
  start();
  XrFrameState state{};
  state.type = XR_TYPE_FRAME_STATE;
  const auto wait = XR_CALL(program.instance, xrWaitFrame);
  EXPECT_EQ(wait(program.session, nullptr, &state), XR_ERROR_SESSION_NOT_RUNNING);
  EXPECT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr),
            XR_ERROR_SESSION_NOT_RUNNING);
  EXPECT_EQ(program.end(1), XR_ERROR_SESSION_NOT_RUNNING);
  EXPECT_EQ(XR_CALL(program.instance, xrEndSession)(program.session), XR_ERROR_SESSION_NOT_RUNNING);
  const auto leave = XR_CALL(program.instance, xrRequestExitSession);
  EXPECT_EQ(leave(program.session), XR_ERROR_SESSION_NOT_RUNNING);
  XrSessionBeginInfo mono{XR_TYPE_SESSION_BEGIN_INFO, nullptr,
                          XR_VIEW_CONFIGURATION_TYPE_PRIMARY_MONO};
  EXPECT_EQ(XR_CALL(program.instance, xrBeginSession)(program.session, &mono),
            XR_ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  EXPECT_EQ(program.begin(), XR_ERROR_SESSION_RUNNING);
  EXPECT_EQ(XR_CALL(program.instance, xrEndSession)(program.session),
            XR_ERROR_SESSION_NOT_STOPPING);
  ASSERT_EQ(program.frame(), XR_SUCCESS);
  // A frame that begins before the last one ended discards it.
  for (const XrResult expected : {XR_SUCCESS, XR_FRAME_DISCARDED}) {
    ASSERT_EQ(wait(program.session, nullptr, &state), XR_SUCCESS);
    EXPECT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), expected);
  }
  EXPECT_EQ(program.end(state.predictedDisplayTime), XR_SUCCESS);
  EXPECT_EQ(leave(program.session), XR_SUCCESS);
  EXPECT_EQ(program.states().back(), XR_SESSION_STATE_STOPPING);
  EXPECT_EQ(XR_CALL(program.instance, xrEndSession)(program.session), XR_SUCCESS);
  EXPECT_EQ(program.states().back(), XR_SESSION_STATE_EXITING);
  EXPECT_EQ(program.begin(), XR_ERROR_SESSION_NOT_READY);
}

TEST_F(Calls, InstancesAreChecked) {
  EXPECT_EQ(program.create({"XR_NO_such"}), XR_ERROR_EXTENSION_NOT_PRESENT);
  EXPECT_EQ(program.create({}, XR_MAKE_VERSION(2, 0, 0)), XR_ERROR_API_VERSION_UNSUPPORTED);
  EXPECT_EQ(program.create({}, XR_MAKE_VERSION(1, 2, 0)), XR_ERROR_API_VERSION_UNSUPPORTED);
  EXPECT_EQ(program.create({}, 0), XR_ERROR_API_VERSION_UNSUPPORTED);
  XrInstanceCreateInfo info{};
  info.type = XR_TYPE_INSTANCE_CREATE_INFO;
  info.applicationInfo.apiVersion = kVersion10;
  XrInstance made = XR_NULL_HANDLE;
  const auto create = XR_CALL(XR_NULL_HANDLE, xrCreateInstance);
  EXPECT_EQ(create(&info, &made), XR_ERROR_NAME_INVALID);
  std::memset(info.applicationInfo.applicationName, 'a', XR_MAX_APPLICATION_NAME_SIZE);
  EXPECT_EQ(create(&info, &made), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(create(nullptr, &made), XR_ERROR_VALIDATION_FAILURE);
  PFN_xrVoidFunction found = nullptr;
  EXPECT_EQ(calls::xrGetInstanceProcAddr(nullptr, "xrGetSystem", &found), XR_ERROR_HANDLE_INVALID);
  ASSERT_EQ(program.create({}), XR_SUCCESS);
  EXPECT_EQ(calls::xrGetInstanceProcAddr(program.instance, "xrNone", &found),
            XR_ERROR_FUNCTION_UNSUPPORTED);
  EXPECT_EQ(program.createSession(), XR_ERROR_GRAPHICS_DEVICE_INVALID);
  // Not enabled.
  EXPECT_EQ(calls::xrGetInstanceProcAddr(program.instance, "xrSubmitDebugUtilsMessageEXT", &found),
            XR_ERROR_FUNCTION_UNSUPPORTED);
}

TEST_F(Calls, SystemsAreChecked) {
  ASSERT_EQ(program.create({}), XR_SUCCESS);
  XrSystemGetInfo info{XR_TYPE_SYSTEM_GET_INFO, nullptr, XR_FORM_FACTOR_HANDHELD_DISPLAY};
  XrSystemId system = 0;
  const auto get = XR_CALL(program.instance, xrGetSystem);
  EXPECT_EQ(get(program.instance, &info, &system), XR_ERROR_FORM_FACTOR_UNSUPPORTED);
  info.formFactor = static_cast<XrFormFactor>(9);
  EXPECT_EQ(get(program.instance, &info, &system), XR_ERROR_VALIDATION_FAILURE);
  XrSystemProperties properties{};
  properties.type = XR_TYPE_SYSTEM_PROPERTIES;
  EXPECT_EQ(XR_CALL(program.instance, xrGetSystemProperties)(program.instance, 99, &properties),
            XR_ERROR_SYSTEM_INVALID);
  std::uint32_t count = 0;
  XrEnvironmentBlendMode mode{};
  const auto modes = XR_CALL(program.instance, xrEnumerateEnvironmentBlendModes);
  EXPECT_EQ(modes(program.instance, program.system, XR_VIEW_CONFIGURATION_TYPE_PRIMARY_MONO, 1,
                  &count, &mode),
            XR_ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED);
  EXPECT_EQ(modes(program.instance, program.system, XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO, 1,
                  nullptr, &mode),
            XR_ERROR_VALIDATION_FAILURE);
}

TEST_F(Calls, PathsAreChecked) {
  ASSERT_EQ(program.create({}), XR_SUCCESS);
  const auto make = XR_CALL(program.instance, xrStringToPath);
  XrPath path = XR_NULL_PATH;
  for (const char* bad : {"", "/", "user", "/user/", "/User", "/a//b", "/..", "/a b"}) {
    EXPECT_EQ(make(program.instance, bad, &path), XR_ERROR_PATH_FORMAT_INVALID) << bad;
  }
  EXPECT_EQ(make(program.instance, ("/" + std::string(254, 'a')).c_str(), &path), XR_SUCCESS);
  EXPECT_EQ(make(program.instance, ("/" + std::string(255, 'a')).c_str(), &path),
            XR_ERROR_PATH_FORMAT_INVALID);
  const XrPath left = program.path("/user/hand/left");
  EXPECT_EQ(program.path("/user/hand/left"), left);
  char text[32];
  std::uint32_t count = 0;
  const auto read = XR_CALL(program.instance, xrPathToString);
  EXPECT_EQ(read(program.instance, left, 32, &count, text), XR_SUCCESS);
  EXPECT_STREQ(text, "/user/hand/left");
  EXPECT_EQ(count, 16U);
  EXPECT_EQ(read(program.instance, left, 15, &count, text), XR_ERROR_SIZE_INSUFFICIENT);
  EXPECT_EQ(read(program.instance, XR_NULL_PATH, 32, &count, text), XR_ERROR_PATH_INVALID);
  EXPECT_EQ(read(program.instance, 4711, 32, &count, text), XR_ERROR_PATH_INVALID);
}

TEST_F(Calls, NamesOfNumbers) {
  ASSERT_EQ(program.create({}), XR_SUCCESS);
  char text[XR_MAX_RESULT_STRING_SIZE];
  const auto name = XR_CALL(program.instance, xrResultToString);
  EXPECT_EQ(name(program.instance, XR_ERROR_POSE_INVALID, text), XR_SUCCESS);
  EXPECT_STREQ(text, "XR_ERROR_POSE_INVALID");
  EXPECT_EQ(name(program.instance, static_cast<XrResult>(-77777), text), XR_SUCCESS);
  EXPECT_STREQ(text, "XR_UNKNOWN_FAILURE_-77777");
  EXPECT_EQ(name(program.instance, static_cast<XrResult>(77777), text), XR_SUCCESS);
  EXPECT_STREQ(text, "XR_UNKNOWN_SUCCESS_77777");
  EXPECT_EQ(XR_CALL(program.instance, xrStructureTypeToString)(program.instance, XR_TYPE_VIEW_STATE,
                                                               text),
            XR_SUCCESS);
  EXPECT_STREQ(text, "XR_TYPE_VIEW_STATE");
  // Since 1.1; distributions' headers do not know them.
  EXPECT_EQ(name(program.instance, static_cast<XrResult>(-1000710001), text), XR_SUCCESS);
  EXPECT_STREQ(text, "XR_ERROR_EXTENSION_DEPENDENCY_NOT_ENABLED");
  EXPECT_EQ(XR_CALL(program.instance, xrStructureTypeToString)(
                program.instance, static_cast<XrStructureType>(1000471001), text),
            XR_SUCCESS);
  EXPECT_STREQ(text, "XR_TYPE_SPACE_LOCATIONS");
}

TEST_F(Calls, AHeadlessSessionNeedsNoFrames) {
  ASSERT_EQ(program.create({"XR_MND_headless"}), XR_SUCCESS);
  // What is no graphics binding is passed over.
  const XrBaseInStructure unknown{static_cast<XrStructureType>(1999009999), nullptr};
  const XrSessionCreateInfo info{XR_TYPE_SESSION_CREATE_INFO, &unknown, 0, program.system};
  ASSERT_EQ(XR_CALL(program.instance, xrCreateSession)(program.instance, &info, &program.session),
            XR_SUCCESS);
  const XrSessionBeginInfo begin{XR_TYPE_SESSION_BEGIN_INFO, nullptr,
                                 XR_VIEW_CONFIGURATION_TYPE_PRIMARY_MONO};
  ASSERT_EQ(XR_CALL(program.instance, xrBeginSession)(program.session, &begin), XR_SUCCESS);
  EXPECT_EQ(program.states().back(), XR_SESSION_STATE_FOCUSED);
  std::uint32_t count = 7;
  EXPECT_EQ(
      XR_CALL(program.instance, xrEnumerateSwapchainFormats)(program.session, 0, &count, nullptr),
      XR_SUCCESS);
  EXPECT_EQ(count, 0U);
}

TEST_F(Calls, ChildrenOfAnotherSessionAreInvalid) {
  start();
  Program other;
  ASSERT_EQ(other.create({kPixels}), XR_SUCCESS);
  ASSERT_EQ(other.createSession(false), XR_SUCCESS);
  const XrSpace stage = program.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  const XrSpace foreign = other.referenceSpace(XR_REFERENCE_SPACE_TYPE_STAGE);
  XrSpaceLocation location{XR_TYPE_SPACE_LOCATION, nullptr, 0, {}};
  EXPECT_EQ(XR_CALL(program.instance, xrLocateSpace)(stage, foreign, 1, &location),
            XR_ERROR_VALIDATION_FAILURE);
  ASSERT_EQ(program.begin(), XR_SUCCESS);
  XrFrameState state{};
  state.type = XR_TYPE_FRAME_STATE;
  ASSERT_EQ(XR_CALL(program.instance, xrWaitFrame)(program.session, nullptr, &state), XR_SUCCESS);
  ASSERT_EQ(XR_CALL(program.instance, xrBeginFrame)(program.session, nullptr), XR_SUCCESS);
  const XrSwapchain own = program.swapchain(kColorFormat, 4, 2);
  const XrSwapchain swapchain = other.swapchain(kColorFormat, 4, 2);
  program.show(own, 1);
  other.show(swapchain, 1);
  XrCompositionLayerQuad quad{};
  quad.type = XR_TYPE_COMPOSITION_LAYER_QUAD;
  quad.pose.orientation.w = 1.0F;
  quad.size = {1.0F, 1.0F};
  const auto submit = [&](XrSpace space, XrSwapchain image) {
    quad.space = space;
    quad.subImage = {image, {{0, 0}, {4, 2}}, 0};
    return program.end(state.predictedDisplayTime,
                       {reinterpret_cast<const XrCompositionLayerBaseHeader*>(&quad)});
  };
  EXPECT_EQ(submit(foreign, own), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(submit(stage, swapchain), XR_ERROR_VALIDATION_FAILURE);
  EXPECT_EQ(submit(stage, own), XR_SUCCESS);
}

TEST_F(Calls, TimesOfTheMonotonicClock) {
  start();
  struct timespec now{12, 34};
  XrTime time = 0;
  const auto to = reinterpret_cast<decltype(&calls::xrConvertTimespecTimeToTimeKHR)>(
      function(program.instance, "xrConvertTimespecTimeToTimeKHR"));
  const auto from = reinterpret_cast<decltype(&calls::xrConvertTimeToTimespecTimeKHR)>(
      function(program.instance, "xrConvertTimeToTimespecTimeKHR"));
  EXPECT_EQ(to(program.instance, &now, &time), XR_SUCCESS);
  EXPECT_EQ(time, 12'000'000'034);  // real time: as it is
  EXPECT_EQ(from(program.instance, time, &now), XR_SUCCESS);
  EXPECT_EQ(now.tv_nsec, 34);
  EXPECT_EQ(from(program.instance, 0, &now), XR_ERROR_TIME_INVALID);
  now.tv_nsec = 1'000'000'000;
  EXPECT_EQ(to(program.instance, &now, &time), XR_ERROR_TIME_INVALID);
  EXPECT_EQ(to(program.instance, nullptr, &time), XR_ERROR_VALIDATION_FAILURE);
}

XrBool32 XRAPI_CALL hear(XrDebugUtilsMessageSeverityFlagsEXT, XrDebugUtilsMessageTypeFlagsEXT,
                         const XrDebugUtilsMessengerCallbackDataEXT* data, void* heard) {
  *static_cast<std::string*>(heard) = std::string(data->functionName) + ": " + data->message;
  return XR_FALSE;
}

TEST_F(Calls, MessengersHearOfErrors) {
  start();
  std::string heard;
  XrDebugUtilsMessengerCreateInfoEXT info{};
  info.type = XR_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
  info.messageSeverities = XR_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
  info.messageTypes = XR_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
  info.userCallback = &hear;
  info.userData = &heard;
  XrDebugUtilsMessengerEXT messenger = XR_NULL_HANDLE;
  ASSERT_EQ(XR_CALL(program.instance, xrCreateDebugUtilsMessengerEXT)(program.instance, &info,
                                                                      &messenger),
            XR_SUCCESS);
  EXPECT_EQ(XR_CALL(program.instance, xrDestroySpace)(nullptr), XR_ERROR_HANDLE_INVALID);
  EXPECT_EQ(heard, "xrDestroySpace: space is XR_NULL_HANDLE");
  EXPECT_EQ(XR_CALL(program.instance, xrDestroyDebugUtilsMessengerEXT)(messenger), XR_SUCCESS);
}

}  // namespace
}  // namespace sim2vr::openxr::test
