// SPDX-License-Identifier: Apache-2.0
// OpenXR's types. Distributions ship headers of 1.0; what 1.1 added to the core is declared here
// where they lack it, with the registry's numbers.
#pragma once

#include <openxr/openxr.h>

#include <cstdint>

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

}  // namespace sim2vr::openxr
