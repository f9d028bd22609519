// SPDX-License-Identifier: Apache-2.0
// Where xrWaitFrame waits: for the harness's next step, or for the display in real time.
#pragma once

#include "objects.hpp"

namespace sim2vr::openxr {

/// Blocks for the next frame, without the lock while it waits, and tracks its devices. Nothing: the
/// session stops (quit, or the harness is gone).
std::optional<xr::Frame> nextFrame(Session& session, Lock& lock);

/// In real time a headless session needs no frames: it is focused and tracked as soon as it runs.
/// In lockstep only frames bring it time.
void runHeadless(Session& session);

/// A frame was ended, or discarded (nullptr): the last one of a step answers it in strict lockstep.
void frameDone(Session& session, const XrFrameEndInfo* info);

}  // namespace sim2vr::openxr
