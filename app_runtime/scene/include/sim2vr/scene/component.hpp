// SPDX-License-Identifier: Apache-2.0
// Behaviour attached to a GameObject, with Unity's life cycle.
#pragma once

#include <cstdint>
#include <string_view>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/clock.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::scene {

class Component;
class GameObject;
class Scene;
class Transform;

/// What a trigger callback learns about the other body.
struct TriggerContact {
  /// The collider component of the other object (physics::Collider).
  Component* other = nullptr;
  /// Velocity of the other body relative to this one, world axes, m/s, from the last two frames'
  /// poses.
  Vec3 relative_velocity_mps = Vec3::Zero();
};

/// Order of calls on one component: Awake and OnEnable at creation, Start before its first fixed
/// step, update or late update, then per frame FixedUpdate and trigger callbacks for each fixed
/// step, Update, LateUpdate. Within a phase components run by ascending executionOrder(), equal
/// ones in order of creation. A component created during a phase first runs in the next phase of
/// its kind.
class Component {
 public:
  Component() = default;
  virtual ~Component() = default;
  Component(const Component&) = delete;
  Component& operator=(const Component&) = delete;

  /// Stable name of the type, written into saved states.
  virtual std::string_view typeName() const = 0;
  virtual int executionOrder() const { return 0; }

  virtual void Awake() {}
  virtual void OnEnable() {}
  virtual void Start() {}
  virtual void FixedUpdate() {}
  virtual void Update() {}
  virtual void LateUpdate() {}
  virtual void OnTriggerEnter(const TriggerContact&) {}
  virtual void OnTriggerStay(const TriggerContact&) {}
  virtual void OnTriggerExit(const TriggerContact&) {}
  virtual void OnDisable() {}
  virtual void OnDestroy() {}

  /// Every value that changes during play. References to objects are saved as GameObject ids.
  virtual void fields(Archive&) {}

  GameObject& gameObject() const { return *owner_; }
  Transform& transform() const;
  Scene& scene() const;
  const GameClock& clock() const;

  bool enabled() const { return enabled_; }
  void setEnabled(bool enabled);
  /// Enabled and on an object that is active in the hierarchy and not destroyed.
  bool isActiveAndEnabled() const;

 private:
  friend class GameObject;
  friend class Scene;

  GameObject* owner_ = nullptr;
  std::uint64_t sequence_ = 0;
  bool enabled_ = true;
  bool started_ = false;
  bool on_ = false;  // OnEnable was called and OnDisable not since
};

}  // namespace sim2vr::scene
