// SPDX-License-Identifier: Apache-2.0
// Reference and action spaces, and the eyes' views.
#include <algorithm>
#include <array>

#include "actions.hpp"
#include "api.hpp"
#include "calls.hpp"
#include "check.hpp"
#include "objects.hpp"
#include "session.hpp"

namespace sim2vr::openxr {
namespace {

constexpr XrSpaceLocationFlags kLocated =
    XR_SPACE_LOCATION_ORIENTATION_VALID_BIT | XR_SPACE_LOCATION_POSITION_VALID_BIT |
    XR_SPACE_LOCATION_ORIENTATION_TRACKED_BIT | XR_SPACE_LOCATION_POSITION_TRACKED_BIT;
constexpr XrSpaceVelocityFlags kMoving =
    XR_SPACE_VELOCITY_LINEAR_VALID_BIT | XR_SPACE_VELOCITY_ANGULAR_VALID_BIT;
constexpr std::uint32_t kMaximumLocated = 10'000;

std::vector<XrReferenceSpaceType> referenceSpaces(const Instance& instance) {
  std::vector<XrReferenceSpaceType> types{
      XR_REFERENCE_SPACE_TYPE_VIEW, XR_REFERENCE_SPACE_TYPE_LOCAL, XR_REFERENCE_SPACE_TYPE_STAGE};
  if (instance.version >= kVersion11 || instance.enabled("XR_EXT_local_floor")) {
    types.push_back(xr::kLocalFloor);
  }
  return types;
}

void requireReference(const Instance& instance, XrReferenceSpaceType type) {
  const auto types = referenceSpaces(instance);
  if (std::find(types.begin(), types.end(), type) != types.end()) return;
  throw Failure(XR_ERROR_REFERENCE_SPACE_UNSUPPORTED,
                fmt::format("reference space {}, expected VIEW, LOCAL, STAGE or (1.1) LOCAL_FLOOR",
                            static_cast<int>(type)));
}

/// `space` in `base`; a space that is found is the identity in itself.
std::optional<xr::Motion> locateIn(const Session& session, const Space& space, const Space& base,
                                   XrTime time) {
  auto found = session.tracking.locate(space, base, time);
  if (found && &space == &base) found = xr::Motion{};
  return found;
}

std::shared_ptr<Space> liveSpace(XrSpace handle, const char* what) {
  auto space = get<Space>(handle, what);
  checkHarness(*space->session);
  requireAlive(*space->session);
  return space;
}

std::shared_ptr<Space> liveSpace(const Session& session, XrSpace handle, const char* what) {
  auto space = liveSpace(handle, what);
  requireOwn(session, space->session.get(), what);
  return space;
}

}  // namespace

XrResult XRAPI_CALL calls::xrEnumerateReferenceSpaces(XrSession session,
                                                      uint32_t spaceCapacityInput,
                                                      uint32_t* spaceCountOutput,
                                                      XrReferenceSpaceType* spaces) {
  return guarded("xrEnumerateReferenceSpaces", [&](Lock&) {
    const auto self = liveSession(session);
    const auto types = referenceSpaces(*self->instance);
    return fillItems(std::span(types), spaceCapacityInput, spaceCountOutput, spaces, "spaces");
  });
}

XrResult XRAPI_CALL calls::xrCreateReferenceSpace(XrSession session,
                                                  const XrReferenceSpaceCreateInfo* createInfo,
                                                  XrSpace* space) {
  return guarded("xrCreateReferenceSpace", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(createInfo, XR_TYPE_REFERENCE_SPACE_CREATE_INFO, "createInfo");
    requirePointer(space, "space");
    requireReference(*self->instance, info.referenceSpaceType);
    requirePose(info.poseInReferenceSpace, "createInfo->poseInReferenceSpace");
    auto made = std::make_shared<Space>();
    made->session = self;
    made->reference = info.referenceSpaceType;
    made->offset = info.poseInReferenceSpace;
    *space = add<XrSpace>(made, self->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrGetReferenceSpaceBoundsRect(XrSession session,
                                                         XrReferenceSpaceType referenceSpaceType,
                                                         XrExtent2Df* bounds) {
  return guarded("xrGetReferenceSpaceBoundsRect", [&](Lock&) {
    const auto self = liveSession(session);
    requirePointer(bounds, "bounds");
    requireReference(*self->instance, referenceSpaceType);
    *bounds = {0.0F, 0.0F};
    return XR_SPACE_BOUNDS_UNAVAILABLE;
  });
}

XrResult XRAPI_CALL calls::xrCreateActionSpace(XrSession session,
                                               const XrActionSpaceCreateInfo* createInfo,
                                               XrSpace* space) {
  return guarded("xrCreateActionSpace", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(createInfo, XR_TYPE_ACTION_SPACE_CREATE_INFO, "createInfo");
    requirePointer(space, "space");
    const auto action = get<Action>(info.action, "createInfo->action");
    if (action->type != XR_ACTION_TYPE_POSE_INPUT) {
      throw Failure(XR_ERROR_ACTION_TYPE_MISMATCH,
                    fmt::format("action '{}' is no pose action", action->name));
    }
    requirePose(info.poseInActionSpace, "createInfo->poseInActionSpace");
    auto made = std::make_shared<Space>();
    made->session = self;
    made->owner = action;
    made->action = action.get();
    made->hand = subactionIndex(*self->instance, *action, info.subactionPath);
    made->offset = info.poseInActionSpace;
    *space = add<XrSpace>(made, self->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrDestroySpace(XrSpace space) {
  return guarded("xrDestroySpace", [&](Lock&) {
    const auto gone = get<Space>(space, "space");
    world().handles.remove(gone->handle);
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrLocateSpace(XrSpace space, XrSpace baseSpace, XrTime time,
                                         XrSpaceLocation* location) {
  return guarded("xrLocateSpace", [&](Lock&) {
    const auto self = liveSpace(space, "space");
    const auto base = liveSpace(*self->session, baseSpace, "baseSpace");
    auto& to = structure(location, XR_TYPE_SPACE_LOCATION, "location");
    requireTime(time, "time");
    const auto found = locateIn(*self->session, *self, *base, time);
    const xr::Motion motion = found.value_or(xr::Motion{});
    to.locationFlags = found ? kLocated : 0;
    to.pose = motion.pose;
    if (auto* velocity = chained<XrSpaceVelocity>(to.next, XR_TYPE_SPACE_VELOCITY)) {
      velocity->velocityFlags = found ? kMoving : 0;
      velocity->linearVelocity = motion.linear;
      velocity->angularVelocity = motion.angular;
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrLocateSpaces(XrSession session, const SpacesLocateInfo* locateInfo,
                                          SpaceLocations* spaceLocations) {
  return guarded("xrLocateSpaces", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(locateInfo, kSpacesLocateInfoType, "locateInfo");
    auto& to = structure(spaceLocations, kSpaceLocationsType, "spaceLocations");
    const auto base = liveSpace(*self, info.base_space, "locateInfo->baseSpace");
    requireTime(info.time, "locateInfo->time");
    if (info.space_count == 0 || info.space_count > kMaximumLocated) {
      invalid(fmt::format("locateInfo->spaceCount is {}, expected 1 to {}", info.space_count,
                          kMaximumLocated));
    }
    requirePointer(info.spaces, "locateInfo->spaces");
    requirePointer(to.locations, "spaceLocations->locations");
    if (to.count != info.space_count) {
      invalid(fmt::format("spaceLocations->locationCount is {}, expected {}", to.count,
                          info.space_count));
    }
    auto* velocities = chained<SpaceVelocities>(to.next, kSpaceVelocitiesType);
    if (velocities != nullptr && velocities->count != info.space_count) {
      invalid(fmt::format("velocityCount is {}, expected {}", velocities->count, info.space_count));
    }
    std::vector<std::shared_ptr<Space>> spaces;
    for (std::uint32_t i = 0; i < info.space_count; ++i) {
      spaces.push_back(liveSpace(*self, info.spaces[i], "locateInfo->spaces[i]"));
    }
    for (std::uint32_t i = 0; i < info.space_count; ++i) {
      const auto found = locateIn(*self, *spaces[i], *base, info.time);
      const xr::Motion motion = found.value_or(xr::Motion{});
      to.locations[i] = {found ? kLocated : 0, motion.pose};
      if (velocities != nullptr) {
        requirePointer(velocities->velocities, "velocities");
        velocities->velocities[i] = {found ? kMoving : 0, motion.linear, motion.angular};
      }
    }
    return XR_SUCCESS;
  });
}

XrResult XRAPI_CALL calls::xrLocateViews(XrSession session, const XrViewLocateInfo* viewLocateInfo,
                                         XrViewState* viewState, uint32_t viewCapacityInput,
                                         uint32_t* viewCountOutput, XrView* views) {
  return guarded("xrLocateViews", [&](Lock&) {
    const auto self = liveSession(session);
    const auto& info = structure(viewLocateInfo, XR_TYPE_VIEW_LOCATE_INFO, "viewLocateInfo");
    auto& state = structure(viewState, XR_TYPE_VIEW_STATE, "viewState");
    requireStereo(info.viewConfigurationType);
    const auto base = liveSpace(*self, info.space, "viewLocateInfo->space");
    requireTime(info.displayTime, "viewLocateInfo->displayTime");
    const auto located = [&](std::size_t eye) {
      return self->tracking.locate(xr::eyeSpace(eye, self->instance->config.ipd_m), *base,
                                   info.displayTime);
    };
    constexpr XrViewStateFlags kValid =
        XR_VIEW_STATE_ORIENTATION_VALID_BIT | XR_VIEW_STATE_POSITION_VALID_BIT |
        XR_VIEW_STATE_ORIENTATION_TRACKED_BIT | XR_VIEW_STATE_POSITION_TRACKED_BIT;
    state.viewStateFlags = located(0) ? kValid : 0;
    if (!wantsItems(kEyes, viewCapacityInput, viewCountOutput, views, "views")) return XR_SUCCESS;
    requireTypes(views, kEyes, XR_TYPE_VIEW, "views");
    for (std::uint32_t eye = 0; eye < kEyes; ++eye) {
      views[eye].pose = located(eye).value_or(xr::Motion{}).pose;
      views[eye].fov = self->instance->config.fov();
    }
    return XR_SUCCESS;
  });
}

}  // namespace sim2vr::openxr
