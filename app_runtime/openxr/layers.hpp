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

}  // namespace sim2vr::openxr
