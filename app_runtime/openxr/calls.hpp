// SPDX-License-Identifier: Apache-2.0
// The functions of the specification that this runtime has, found by name in dispatch.cpp.
#pragma once

#include <time.h>

#include <type_traits>

#include "api.hpp"

#define SIM2VR_CORE_CALLS(X)                \
  X(xrGetInstanceProcAddr)                  \
  X(xrEnumerateInstanceExtensionProperties) \
  X(xrCreateInstance)                       \
  X(xrDestroyInstance)                      \
  X(xrGetInstanceProperties)                \
  X(xrPollEvent)                            \
  X(xrResultToString)                       \
  X(xrStructureTypeToString)                \
  X(xrGetSystem)                            \
  X(xrGetSystemProperties)                  \
  X(xrEnumerateEnvironmentBlendModes)       \
  X(xrCreateSession)                        \
  X(xrDestroySession)                       \
  X(xrEnumerateReferenceSpaces)             \
  X(xrCreateReferenceSpace)                 \
  X(xrGetReferenceSpaceBoundsRect)          \
  X(xrCreateActionSpace)                    \
  X(xrLocateSpace)                          \
  X(xrDestroySpace)                         \
  X(xrEnumerateViewConfigurations)          \
  X(xrGetViewConfigurationProperties)       \
  X(xrEnumerateViewConfigurationViews)      \
  X(xrEnumerateSwapchainFormats)            \
  X(xrCreateSwapchain)                      \
  X(xrDestroySwapchain)                     \
  X(xrEnumerateSwapchainImages)             \
  X(xrAcquireSwapchainImage)                \
  X(xrWaitSwapchainImage)                   \
  X(xrReleaseSwapchainImage)                \
  X(xrBeginSession)                         \
  X(xrEndSession)                           \
  X(xrRequestExitSession)                   \
  X(xrWaitFrame)                            \
  X(xrBeginFrame)                           \
  X(xrEndFrame)                             \
  X(xrLocateViews)                          \
  X(xrStringToPath)                         \
  X(xrPathToString)                         \
  X(xrCreateActionSet)                      \
  X(xrDestroyActionSet)                     \
  X(xrCreateAction)                         \
  X(xrDestroyAction)                        \
  X(xrSuggestInteractionProfileBindings)    \
  X(xrAttachSessionActionSets)              \
  X(xrGetCurrentInteractionProfile)         \
  X(xrGetActionStateBoolean)                \
  X(xrGetActionStateFloat)                  \
  X(xrGetActionStateVector2f)               \
  X(xrGetActionStatePose)                   \
  X(xrSyncActions)                          \
  X(xrEnumerateBoundSourcesForAction)       \
  X(xrGetInputSourceLocalizedName)          \
  X(xrApplyHapticFeedback)                  \
  X(xrStopHapticFeedback)

/// Of XR_EXT_debug_utils.
#define SIM2VR_DEBUG_CALLS(X)               \
  X(xrSetDebugUtilsObjectNameEXT)           \
  X(xrCreateDebugUtilsMessengerEXT)         \
  X(xrDestroyDebugUtilsMessengerEXT)        \
  X(xrSubmitDebugUtilsMessageEXT)           \
  X(xrSessionBeginDebugUtilsLabelRegionEXT) \
  X(xrSessionEndDebugUtilsLabelRegionEXT)   \
  X(xrSessionInsertDebugUtilsLabelEXT)

namespace sim2vr::openxr::calls {

#define SIM2VR_DECLARE(name) std::remove_pointer_t<PFN_##name> name;
SIM2VR_CORE_CALLS(SIM2VR_DECLARE)
SIM2VR_DEBUG_CALLS(SIM2VR_DECLARE)
#undef SIM2VR_DECLARE

// What headers of 1.0 lack, and what needs a header of the platform.
XrResult XRAPI_CALL xrLocateSpaces(XrSession session, const SpacesLocateInfo* locateInfo,
                                   SpaceLocations* spaceLocations);
XrResult XRAPI_CALL xrConvertTimespecTimeToTimeKHR(XrInstance instance,
                                                   const struct timespec* timespecTime,
                                                   XrTime* time);
XrResult XRAPI_CALL xrConvertTimeToTimespecTimeKHR(XrInstance instance, XrTime time,
                                                   struct timespec* timespecTime);

}  // namespace sim2vr::openxr::calls
