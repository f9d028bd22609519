// What of a chain is cut.
#pragma once

#include <vector>

#include "beats/beatmap.hpp"

namespace sim2vr::games::beats {

/// The boxes of a chain: its head, unless `boxes`, in order of time, have it already, and its
/// links: Box::link, any direction, evenly spread in time up to the tail, on the game's curve. That
/// is a quadratic Bezier curve from head to tail whose middle point lies half their distance from
/// the head in its cut direction (down for kAny).
std::vector<Box> chainBoxes(const Chain& chain, double head_s, double tail_s,
                            const std::vector<Box>& boxes);

}  // namespace sim2vr::games::beats
