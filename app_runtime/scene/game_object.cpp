// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/scene/game_object.hpp"

#include "sim2vr/scene/scene.hpp"

namespace sim2vr::scene {

GameObject::GameObject(Scene& scene, std::uint64_t id, std::string name, std::string prefab)
    : scene_(&scene),
      id_(id),
      name_(std::move(name)),
      prefab_(std::move(prefab)),
      transform_(*this) {}

bool GameObject::activeInHierarchy() const {
  if (!active_ || destroyed_) return false;
  const Transform* parent = transform_.parent();
  return parent == nullptr || parent->gameObject().activeInHierarchy();
}

void GameObject::setActive(bool active) {
  if (active_ == active) return;
  active_ = active;
  refreshEnabled();
}

void GameObject::adopt(std::unique_ptr<Component> component) {
  Component& adopted = *component;
  adopted.owner_ = this;
  components_.push_back(std::move(component));
  scene_->addOrdered(adopted);
  adopted.Awake();
  refreshEnabled();
}

void GameObject::refreshEnabled() {
  // By index: the callbacks may add components and children.
  for (std::size_t i = 0; i < components_.size(); ++i) {
    Component& component = *components_[i];
    const bool on = component.isActiveAndEnabled();
    if (on == component.on_) continue;
    component.on_ = on;
    scene_->changed();
    if (on) {
      component.OnEnable();
    } else {
      component.OnDisable();
    }
  }
  for (std::size_t i = 0; i < transform_.children().size(); ++i) {
    transform_.children()[i]->gameObject().refreshEnabled();
  }
}

}  // namespace sim2vr::scene
