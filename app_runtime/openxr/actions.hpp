// Actions, and what they are bound to.
#pragma once

#include <string_view>
#include <vector>

#include "objects.hpp"
#include "profiles.hpp"

namespace sim2vr::openxr {

/// 0 left hand, 1 right hand, 2: none of the two, or XR_NULL_PATH.
int handOf(std::string_view user_path);
/// Index into Action::values for a subaction path. Throws Failure (XR_ERROR_PATH_INVALID; where the
/// action has no such subaction XR_ERROR_PATH_UNSUPPORTED).
int subactionIndex(const Instance& instance, const Action& action, XrPath subaction);
/// An action of this type whose set is attached to this session. Throws Failure.
std::shared_ptr<Action> attachedAction(const Session& session, XrAction handle, XrActionType type);
/// The living actions of a set.
std::vector<std::shared_ptr<Action>> actionsOf(const ActionSet& set);
/// Fills Action::bound of the session's actions from the suggestions for its profile.
void bindActions(Session& session);

}  // namespace sim2vr::openxr
