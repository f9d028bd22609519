// SPDX-License-Identifier: Apache-2.0
// What a program submits with xrEndFrame: checked, and composed into the picture for the harness.
#pragma once

#include "objects.hpp"

namespace sim2vr::openxr {

/// Throws Failure with the specification's code, naming the layer.
void checkLayers(const Session& session, const XrFrameEndInfo& info);

/// The frame as the eyes of the configuration see it. Projection layers cover the picture as they
/// are (they are not reprojected to the devices' poses), quads are placed by their pose; later
/// layers lie over earlier ones. Depth comes from the first projection layer that brings it.
Picture composePicture(Session& session, const XrFrameEndInfo& info);

// Where xrWaitFrame waits: for the harness's next step, or for the display in real time.

/// Blocks for the next frame, without the lock while it waits, and tracks its devices. Nothing: the
/// session stops (quit, or the harness is gone).
std::optional<xr::Frame> nextFrame(Session& session, Lock& lock);

/// In real time a headless session needs no frames: it is focused and tracked as soon as it runs.
/// In lockstep only frames bring it time.
void runHeadless(Session& session);

/// A frame was ended, or discarded (nullptr): the last one of a step answers it in strict lockstep.
void frameDone(Session& session, const XrFrameEndInfo* info);

}  // namespace sim2vr::openxr
