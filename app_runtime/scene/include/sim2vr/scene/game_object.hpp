// SPDX-License-Identifier: Apache-2.0
// A named node of the scene: a Transform and components.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/scene/component.hpp"
#include "sim2vr/scene/transform.hpp"

namespace sim2vr::scene {

class GameObject {
 public:
  GameObject(const GameObject&) = delete;
  GameObject& operator=(const GameObject&) = delete;

  /// Unique within the scene and never reused.
  std::uint64_t id() const { return id_; }
  const std::string& name() const { return name_; }
  /// Name of the prefab it was instantiated from; empty for objects a game builds itself.
  const std::string& prefab() const { return prefab_; }
  int layer() const { return layer_; }
  void setLayer(int layer) { layer_ = layer; }

  Scene& scene() const { return *scene_; }
  Transform& transform() { return transform_; }
  const Transform& transform() const { return transform_; }

  bool activeInHierarchy() const;
  void setActive(bool active);
  bool destroyed() const { return destroyed_; }

  /// Adds a component of type T; Awake (and OnEnable when active) run before it returns.
  template <class T, class... Args>
  T& addComponent(Args&&... args) {
    auto component = std::make_unique<T>(std::forward<Args>(args)...);
    T& reference = *component;
    adopt(std::move(component));
    return reference;
  }

  /// First component of type T (or derived from it), or nullptr.
  template <class T>
  T* getComponent() const {
    for (const auto& component : components_) {
      if (auto* found = dynamic_cast<T*>(component.get())) return found;
    }
    return nullptr;
  }

  const std::vector<std::unique_ptr<Component>>& components() const { return components_; }

 private:
  friend class Component;
  friend class Scene;

  GameObject(Scene& scene, std::uint64_t id, std::string name, std::string prefab);
  void adopt(std::unique_ptr<Component> component);
  void refreshEnabled();

  Scene* scene_;
  std::uint64_t id_;
  std::string name_;
  std::string prefab_;
  int layer_ = 0;
  bool active_ = true;
  bool destroyed_ = false;
  bool destroy_announced_ = false;  // OnDestroy was called
  Transform transform_;
  std::vector<std::unique_ptr<Component>> components_;
};

}  // namespace sim2vr::scene
