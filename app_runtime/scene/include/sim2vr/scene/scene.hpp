// SPDX-License-Identifier: Apache-2.0
// The tree of GameObjects and Unity's order of execution within a frame.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/clock.hpp"
#include "sim2vr/scene/game_object.hpp"

namespace sim2vr::scene {

class Scene {
 public:
  /// Fills a fresh object with components and children.
  using Prefab = std::function<void(GameObject&)>;

  explicit Scene(const TimeSettings& time = {});
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  GameClock& clock() { return clock_; }
  const GameClock& clock() const { return clock_; }

  /// A new empty object under `parent` (nullptr: a root).
  GameObject& create(std::string name, GameObject* parent = nullptr);

  /// Objects that come and go during play are made from prefabs, so that a saved state can make
  /// them again. Throws InvalidArgument for a name registered twice or never.
  void registerPrefab(const std::string& prefab, Prefab build);
  GameObject& instantiate(const std::string& prefab, std::string name,
                          GameObject* parent = nullptr);

  /// Destroys the object and its children at the end of the current phase (Unity's Destroy).
  void destroy(GameObject& object);

  /// Object at a path such as "XR Rig/Right Controller/Hammer", or nullptr.
  GameObject* find(std::string_view path) const;
  GameObject* findById(std::uint64_t id) const;
  /// Every live object, in order of creation.
  const std::vector<std::unique_ptr<GameObject>>& objects() const { return objects_; }

  /// Grows when objects or components come, go or change between on and off.
  std::uint64_t structureRevision() const { return structure_revision_; }
  /// Components of type T that are on, in execution order. T must be complete.
  template <class T>
  void forEach(const std::function<void(T&)>& visit) const {
    for (Component* component : ordered_) {
      if (!component->on_) continue;
      if (auto* typed = dynamic_cast<T*>(component)) visit(*typed);
    }
  }

  /// Runs one frame at `time_ns`: all due fixed steps (FixedUpdate, then `physics_step`), then
  /// Update, then LateUpdate. Rendering comes after it and is the caller's.
  void runFrame(std::int64_t time_ns, const std::function<void()>& physics_step);

  /// Clock, tree and every component's fields. Loading needs a scene built by the same game with
  /// the same options: prefab instances are made or dropped to match, then all values are read.
  void fields(Archive& archive);

 private:
  friend class Component;
  friend class GameObject;

  GameObject& createWithId(std::uint64_t id, std::string name, std::string prefab,
                           GameObject* parent);
  void addOrdered(Component& component);
  void changed() { ++structure_revision_; }
  void startNewComponents();
  void runPhase(void (Component::*callback)());
  void announceDestroyed(GameObject& object);
  void flushDestroyed();
  void matchObjects(Archive& archive);

  GameClock clock_;
  std::map<std::string, Prefab> prefabs_;
  std::vector<std::unique_ptr<GameObject>> objects_;
  std::vector<Component*> ordered_;
  std::vector<Component*> phase_;
  std::uint64_t next_id_ = 1;
  std::uint64_t next_sequence_ = 1;
  std::uint64_t structure_revision_ = 1;
  bool has_unstarted_ = false;
  bool has_destroyed_ = false;
};

}  // namespace sim2vr::scene
