// SPDX-License-Identifier: Apache-2.0
// The one system: a headset with two eyes that nothing shines through.
#include <array>

#include "calls.hpp"
#include "check.hpp"
#include "objects.hpp"
#include "system.hpp"

namespace sim2vr::openxr {
namespace {

std::shared_ptr<Instance> withSystem(XrInstance instance, XrSystemId system) {
  auto owner = get<Instance>(instance, "instance");
  if (system != kSystem || !owner->system_asked) {
    throw Failure(XR_ERROR_SYSTEM_INVALID, fmt::format("no system {}", system));
  }
  return owner;
}

}  // namespace

void requireStereo(XrViewConfigurationType type) {
  if (type == XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO) return;
  throw Failure(
      XR_ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED,
      fmt::format("view configuration {}, expected PRIMARY_STEREO (2)", static_cast<int>(type)));
}

XrResult XRAPI_CALL calls::xrGetSystem(XrInstance instance, const XrSystemGetInfo* getInfo,
                                       XrSystemId* systemId) {
  return guarded("xrGetSystem", [&](Lock&) {
    const auto owner = get<Instance>(instance, "instance");
    const auto& info = structure(getInfo, XR_TYPE_SYSTEM_GET_INFO, "getInfo");
    requirePointer(systemId, "systemId");
    if (info.formFactor == XR_FORM_FACTOR_HANDHELD_DISPLAY) {
      throw Failure(XR_ERROR_FORM_FACTOR_UNSUPPORTED, "there is only a head-mounted display");
    }
    if (info.formFactor != XR_FORM_FACTOR_HEAD_MOUNTED_DISPLAY) {
      invalid(fmt::format("getInfo->formFactor is {}", static_cast<int>(info.formFactor)));
    }
    owner->system_asked = true;
    *systemId = kSystem;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetSystemProperties(XrInstance instance, XrSystemId systemId,
                                                 XrSystemProperties* properties) {
  return guarded("xrGetSystemProperties", [&](Lock&) {
    withSystem(instance, systemId);
    auto& to = structure(properties, XR_TYPE_SYSTEM_PROPERTIES, "properties");
    to.systemId = kSystem;
    to.vendorId = 0;
    copyText(to.systemName, "SIM2VR simulated headset");
    to.graphicsProperties = {kMaximumImageSize, kMaximumImageSize, kMaximumLayers};
    to.trackingProperties = {XR_TRUE, XR_TRUE};
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEnumerateEnvironmentBlendModes(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    uint32_t environmentBlendModeCapacityInput, uint32_t* environmentBlendModeCountOutput,
    XrEnvironmentBlendMode* environmentBlendModes) {
  return guarded("xrEnumerateEnvironmentBlendModes", [&](Lock&) {
    withSystem(instance, systemId);
    requireStereo(viewConfigurationType);
    const std::array modes{XR_ENVIRONMENT_BLEND_MODE_OPAQUE};
    return fillItems(std::span<const XrEnvironmentBlendMode>(modes),
                     environmentBlendModeCapacityInput, environmentBlendModeCountOutput,
                     environmentBlendModes, "environmentBlendModes");
  });
}

XrResult XRAPI_CALL calls::xrEnumerateViewConfigurations(
    XrInstance instance, XrSystemId systemId, uint32_t viewConfigurationTypeCapacityInput,
    uint32_t* viewConfigurationTypeCountOutput, XrViewConfigurationType* viewConfigurationTypes) {
  return guarded("xrEnumerateViewConfigurations", [&](Lock&) {
    withSystem(instance, systemId);
    const std::array types{XR_VIEW_CONFIGURATION_TYPE_PRIMARY_STEREO};
    return fillItems(std::span<const XrViewConfigurationType>(types),
                     viewConfigurationTypeCapacityInput, viewConfigurationTypeCountOutput,
                     viewConfigurationTypes, "viewConfigurationTypes");
  });
}

XrResult XRAPI_CALL calls::xrGetViewConfigurationProperties(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    XrViewConfigurationProperties* configurationProperties) {
  return guarded("xrGetViewConfigurationProperties", [&](Lock&) {
    withSystem(instance, systemId);
    auto& to = structure(configurationProperties, XR_TYPE_VIEW_CONFIGURATION_PROPERTIES,
                         "configurationProperties");
    requireStereo(viewConfigurationType);
    to.viewConfigurationType = viewConfigurationType;
    to.fovMutable = XR_FALSE;
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrEnumerateViewConfigurationViews(
    XrInstance instance, XrSystemId systemId, XrViewConfigurationType viewConfigurationType,
    uint32_t viewCapacityInput, uint32_t* viewCountOutput, XrViewConfigurationView* views) {
  return guarded("xrEnumerateViewConfigurationViews", [&](Lock&) {
    const auto owner = withSystem(instance, systemId);
    requireStereo(viewConfigurationType);
    if (!wantsItems(kEyes, viewCapacityInput, viewCountOutput, views, "views")) return XR_SUCCESS;
    requireTypes(views, kEyes, XR_TYPE_VIEW_CONFIGURATION_VIEW, "views");
    for (std::uint32_t i = 0; i < kEyes; ++i) {
      views[i].recommendedImageRectWidth = owner->config.width;
      views[i].recommendedImageRectHeight = owner->config.height;
      views[i].maxImageRectWidth = kMaximumImageSize;
      views[i].maxImageRectHeight = kMaximumImageSize;
      views[i].recommendedSwapchainSampleCount = 1;
      views[i].maxSwapchainSampleCount = kMaximumSamples;
    }
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr
