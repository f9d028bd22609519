// The functions of the specification that this runtime has, found by name in dispatch.cpp.
#pragma once

#include <time.h>

#include "api.hpp"

namespace sim2vr::openxr::calls {

XrResult XRAPI_CALL xrGetInstanceProcAddr(XrInstance instance, const char* name,
                                          PFN_xrVoidFunction* function);
XrResult XRAPI_CALL xrEnumerateInstanceExtensionProperties(const char* layerName,
                                                           uint32_t propertyCapacityInput,
                                                           uint32_t* propertyCountOutput,
                                                           XrExtensionProperties* properties);
XrResult XRAPI_CALL xrCreateInstance(const XrInstanceCreateInfo* createInfo, XrInstance* instance);
XrResult XRAPI_CALL xrDestroyInstance(XrInstance instance);
XrResult XRAPI_CALL xrGetInstanceProperties(XrInstance instance,
                                            XrInstanceProperties* instanceProperties);
XrResult XRAPI_CALL xrPollEvent(XrInstance instance, XrEventDataBuffer* eventData);
XrResult XRAPI_CALL xrResultToString(XrInstance instance, XrResult value,
                                     char buffer[XR_MAX_RESULT_STRING_SIZE]);
XrResult XRAPI_CALL xrStructureTypeToString(XrInstance instance, XrStructureType value,
                                            char buffer[XR_MAX_STRUCTURE_NAME_SIZE]);
XrResult XRAPI_CALL xrGetSystem(XrInstance instance, const XrSystemGetInfo* getInfo,
                                XrSystemId* systemId);
XrResult XRAPI_CALL xrGetSystemProperties(XrInstance instance, XrSystemId systemId,
                                          XrSystemProperties* properties);
XrResult XRAPI_CALL xrEnumerateEnvironmentBlendModes(XrInstance instance, XrSystemId systemId,
                                                     XrViewConfigurationType viewConfigurationType,
                                                     uint32_t environmentBlendModeCapacityInput,
                                                     uint32_t* environmentBlendModeCountOutput,
                                                     XrEnvironmentBlendMode* environmentBlendModes);
XrResult XRAPI_CALL xrCreateSession(XrInstance instance, const XrSessionCreateInfo* createInfo,
                                    XrSession* session);
XrResult XRAPI_CALL xrDestroySession(XrSession session);
XrResult XRAPI_CALL xrEnumerateReferenceSpaces(XrSession session, uint32_t spaceCapacityInput,
                                               uint32_t* spaceCountOutput,
                                               XrReferenceSpaceType* spaces);
XrResult XRAPI_CALL xrCreateReferenceSpace(XrSession session,
                                           const XrReferenceSpaceCreateInfo* createInfo,
                                           XrSpace* space);
XrResult XRAPI_CALL xrGetReferenceSpaceBoundsRect(XrSession session,
                                                  XrReferenceSpaceType referenceSpaceType,
                                                  XrExtent2Df* bounds);
XrResult XRAPI_CALL xrCreateActionSpace(XrSession session,
                                        const XrActionSpaceCreateInfo* createInfo, XrSpace* space);
XrResult XRAPI_CALL xrLocateSpace(XrSpace space, XrSpace baseSpace, XrTime time,
                                  XrSpaceLocation* location);
XrResult XRAPI_CALL xrDestroySpace(XrSpace space);
XrResult XRAPI_CALL xrEnumerateViewConfigurations(XrInstance instance, XrSystemId systemId,
                                                  uint32_t viewConfigurationTypeCapacityInput,
                                                  uint32_t* viewConfigurationTypeCountOutput,
                                                  XrViewConfigurationType* viewConfigurationTypes);
XrResult XRAPI_CALL xrGetViewConfigurationProperties(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    XrViewConfigurationProperties* configurationProperties);
XrResult XRAPI_CALL xrEnumerateViewConfigurationViews(XrInstance instance, XrSystemId systemId,
                                                      XrViewConfigurationType viewConfigurationType,
                                                      uint32_t viewCapacityInput,
                                                      uint32_t* viewCountOutput,
                                                      XrViewConfigurationView* views);
XrResult XRAPI_CALL xrEnumerateSwapchainFormats(XrSession session, uint32_t formatCapacityInput,
                                                uint32_t* formatCountOutput, int64_t* formats);
XrResult XRAPI_CALL xrCreateSwapchain(XrSession session, const XrSwapchainCreateInfo* createInfo,
                                      XrSwapchain* swapchain);
XrResult XRAPI_CALL xrDestroySwapchain(XrSwapchain swapchain);
XrResult XRAPI_CALL xrEnumerateSwapchainImages(XrSwapchain swapchain, uint32_t imageCapacityInput,
                                               uint32_t* imageCountOutput,
                                               XrSwapchainImageBaseHeader* images);
XrResult XRAPI_CALL xrAcquireSwapchainImage(XrSwapchain swapchain,
                                            const XrSwapchainImageAcquireInfo* acquireInfo,
                                            uint32_t* index);
XrResult XRAPI_CALL xrWaitSwapchainImage(XrSwapchain swapchain,
                                         const XrSwapchainImageWaitInfo* waitInfo);
XrResult XRAPI_CALL xrReleaseSwapchainImage(XrSwapchain swapchain,
                                            const XrSwapchainImageReleaseInfo* releaseInfo);
XrResult XRAPI_CALL xrBeginSession(XrSession session, const XrSessionBeginInfo* beginInfo);
XrResult XRAPI_CALL xrEndSession(XrSession session);
XrResult XRAPI_CALL xrRequestExitSession(XrSession session);
XrResult XRAPI_CALL xrWaitFrame(XrSession session, const XrFrameWaitInfo* frameWaitInfo,
                                XrFrameState* frameState);
XrResult XRAPI_CALL xrBeginFrame(XrSession session, const XrFrameBeginInfo* frameBeginInfo);
XrResult XRAPI_CALL xrEndFrame(XrSession session, const XrFrameEndInfo* frameEndInfo);
XrResult XRAPI_CALL xrLocateViews(XrSession session, const XrViewLocateInfo* viewLocateInfo,
                                  XrViewState* viewState, uint32_t viewCapacityInput,
                                  uint32_t* viewCountOutput, XrView* views);
XrResult XRAPI_CALL xrStringToPath(XrInstance instance, const char* pathString, XrPath* path);
XrResult XRAPI_CALL xrPathToString(XrInstance instance, XrPath path, uint32_t bufferCapacityInput,
                                   uint32_t* bufferCountOutput, char* buffer);
XrResult XRAPI_CALL xrCreateActionSet(XrInstance instance, const XrActionSetCreateInfo* createInfo,
                                      XrActionSet* actionSet);
XrResult XRAPI_CALL xrDestroyActionSet(XrActionSet actionSet);
XrResult XRAPI_CALL xrCreateAction(XrActionSet actionSet, const XrActionCreateInfo* createInfo,
                                   XrAction* action);
XrResult XRAPI_CALL xrDestroyAction(XrAction action);
XrResult XRAPI_CALL xrSuggestInteractionProfileBindings(
    XrInstance instance, const XrInteractionProfileSuggestedBinding* suggestedBindings);
XrResult XRAPI_CALL xrAttachSessionActionSets(XrSession session,
                                              const XrSessionActionSetsAttachInfo* attachInfo);
XrResult XRAPI_CALL xrGetCurrentInteractionProfile(XrSession session, XrPath topLevelUserPath,
                                                   XrInteractionProfileState* interactionProfile);
XrResult XRAPI_CALL xrGetActionStateBoolean(XrSession session, const XrActionStateGetInfo* getInfo,
                                            XrActionStateBoolean* state);
XrResult XRAPI_CALL xrGetActionStateFloat(XrSession session, const XrActionStateGetInfo* getInfo,
                                          XrActionStateFloat* state);
XrResult XRAPI_CALL xrGetActionStateVector2f(XrSession session, const XrActionStateGetInfo* getInfo,
                                             XrActionStateVector2f* state);
XrResult XRAPI_CALL xrGetActionStatePose(XrSession session, const XrActionStateGetInfo* getInfo,
                                         XrActionStatePose* state);
XrResult XRAPI_CALL xrSyncActions(XrSession session, const XrActionsSyncInfo* syncInfo);
XrResult XRAPI_CALL xrEnumerateBoundSourcesForAction(
    XrSession session, const XrBoundSourcesForActionEnumerateInfo* enumerateInfo,
    uint32_t sourceCapacityInput, uint32_t* sourceCountOutput, XrPath* sources);
XrResult XRAPI_CALL xrGetInputSourceLocalizedName(XrSession session,
                                                  const XrInputSourceLocalizedNameGetInfo* getInfo,
                                                  uint32_t bufferCapacityInput,
                                                  uint32_t* bufferCountOutput, char* buffer);
XrResult XRAPI_CALL xrApplyHapticFeedback(XrSession session,
                                          const XrHapticActionInfo* hapticActionInfo,
                                          const XrHapticBaseHeader* hapticFeedback);
XrResult XRAPI_CALL xrStopHapticFeedback(XrSession session,
                                         const XrHapticActionInfo* hapticActionInfo);
XrResult XRAPI_CALL xrSetDebugUtilsObjectNameEXT(XrInstance instance,
                                                 const XrDebugUtilsObjectNameInfoEXT* nameInfo);
XrResult XRAPI_CALL xrCreateDebugUtilsMessengerEXT(
    XrInstance instance, const XrDebugUtilsMessengerCreateInfoEXT* createInfo,
    XrDebugUtilsMessengerEXT* messenger);
XrResult XRAPI_CALL xrDestroyDebugUtilsMessengerEXT(XrDebugUtilsMessengerEXT messenger);
XrResult XRAPI_CALL xrSessionBeginDebugUtilsLabelRegionEXT(XrSession session,
                                                           const XrDebugUtilsLabelEXT* labelInfo);
XrResult XRAPI_CALL xrSessionEndDebugUtilsLabelRegionEXT(XrSession session);
XrResult XRAPI_CALL xrSessionInsertDebugUtilsLabelEXT(XrSession session,
                                                      const XrDebugUtilsLabelEXT* labelInfo);
XrResult XRAPI_CALL xrLocateSpaces(XrSession session, const SpacesLocateInfo* locateInfo,
                                   SpaceLocations* spaceLocations);
XrResult XRAPI_CALL xrConvertTimespecTimeToTimeKHR(XrInstance instance,
                                                   const struct timespec* timespecTime,
                                                   XrTime* time);
XrResult XRAPI_CALL xrConvertTimeToTimespecTimeKHR(XrInstance instance, XrTime time,
                                                   struct timespec* timespecTime);
XrResult XRAPI_CALL xrSubmitDebugUtilsMessageEXT(
    XrInstance instance, XrDebugUtilsMessageSeverityFlagsEXT messageSeverity,
    XrDebugUtilsMessageTypeFlagsEXT messageTypes,
    const XrDebugUtilsMessengerCallbackDataEXT* callbackData);

}  // namespace sim2vr::openxr::calls
