// OpenXR structures with their type and zeros.
#pragma once

#include <openxr/openxr.h>

namespace sim2vr::openxr {

template <class Structure>
Structure typed(XrStructureType type) {
  Structure made{};
  made.type = type;
  return made;
}

}  // namespace sim2vr::openxr
