// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/scene/component.hpp"

#include "sim2vr/scene/scene.hpp"

namespace sim2vr::scene {

Transform& Component::transform() const { return owner_->transform(); }
Scene& Component::scene() const { return owner_->scene(); }
const GameClock& Component::clock() const { return owner_->scene().clock(); }

bool Component::isActiveAndEnabled() const {
  return enabled_ && !owner_->destroyed() && owner_->activeInHierarchy();
}

void Component::setEnabled(bool enabled) {
  enabled_ = enabled;
  owner_->refreshEnabled();
}

}  // namespace sim2vr::scene
