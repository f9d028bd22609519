// SPDX-License-Identifier: Apache-2.0
// Actions, and what they are bound to.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "objects.hpp"

namespace sim2vr::openxr {

/// Such as /user/hand/left.
bool isTopLevel(std::string_view path);
/// Index into Action::states for a subaction path. Throws Failure (XR_ERROR_PATH_INVALID; where the
/// action has no such subaction XR_ERROR_PATH_UNSUPPORTED).
std::size_t subactionIndex(const Instance& instance, const Action& action, XrPath subaction);
/// An action of this type whose set is attached to this session. Throws Failure.
std::shared_ptr<Action> attachedAction(const Session& session, XrAction handle, XrActionType type);
/// The living actions of a set.
std::vector<std::shared_ptr<Action>> actionsOf(const ActionSet& set);
/// Binds the session's actions from the suggestions for its profile.
void bindActions(Session& session);

XrPath toPath(Instance& instance, std::string_view text);
/// Throws Failure (XR_ERROR_PATH_INVALID) naming `what`.
const std::string& pathText(const Instance& instance, XrPath path, const char* what);

}  // namespace sim2vr::openxr
