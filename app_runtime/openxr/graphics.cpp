#include "graphics.hpp"

namespace sim2vr::openxr {

std::span<const GraphicsMaker> graphicsMakers() { return {}; }

}  // namespace sim2vr::openxr
