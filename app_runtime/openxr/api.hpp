// SPDX-License-Identifier: Apache-2.0
// OpenXR's types. Distributions ship headers of 1.0; what 1.1 added to the core is declared here
// where they lack it, with the registry's numbers.
#pragma once

#include <openxr/openxr.h>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace sim2vr::openxr {

inline constexpr XrVersion kVersion10 = XR_MAKE_VERSION(1, 0, 0);
inline constexpr XrVersion kVersion11 = XR_MAKE_VERSION(1, 1, 0);
/// The newest version that was read when this was written.
inline constexpr XrVersion kNewestVersion = XR_MAKE_VERSION(1, 1, 49);

inline constexpr auto kSpacesLocateInfoType = static_cast<XrStructureType>(1000471000);
inline constexpr auto kSpaceLocationsType = static_cast<XrStructureType>(1000471001);
inline constexpr auto kSpaceVelocitiesType = static_cast<XrStructureType>(1000471002);

/// Results that 1.1 took over from extensions.
inline constexpr auto kDependencyNotEnabled = static_cast<XrResult>(-1000710001);
inline constexpr auto kPermissionInsufficient = static_cast<XrResult>(-1000710000);

struct SpacesLocateInfo {
  XrStructureType type;
  const void* next;
  XrSpace base_space;
  XrTime time;
  std::uint32_t space_count;
  const XrSpace* spaces;
};
struct SpaceLocationData {
  XrSpaceLocationFlags flags;
  XrPosef pose;
};
struct SpaceLocations {
  XrStructureType type;
  void* next;
  std::uint32_t count;
  SpaceLocationData* locations;
};
struct SpaceVelocityData {
  XrSpaceVelocityFlags flags;
  XrVector3f linear;
  XrVector3f angular;
};
struct SpaceVelocities {
  XrStructureType type;
  void* next;
  std::uint32_t count;
  SpaceVelocityData* velocities;
};

// The one exception of this room: the code that a call returns, and why.

/// Ends the call with `result`; the text goes to standard error with the call's name before it.
class Failure : public std::runtime_error {
 public:
  Failure(XrResult result, const std::string& cause) : std::runtime_error(cause), result_(result) {}
  XrResult result() const { return result_; }

 private:
  XrResult result_;
};

// What the simulated headset can do.

inline constexpr std::uint32_t kEyes = 2;
inline constexpr std::uint32_t kMaximumLayers = XR_MIN_COMPOSITION_LAYERS_SUPPORTED;
/// Of a swapchain's image, along each side.
inline constexpr std::uint32_t kMaximumImageSize = 8192;
/// Of a colour image; every device of Vulkan and the OpenGL drivers tried have as many.
inline constexpr std::uint32_t kMaximumSamples = 4;

/// Throws Failure (XR_ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED).
void requireStereo(XrViewConfigurationType type);

}  // namespace sim2vr::openxr
