// SPDX-License-Identifier: Apache-2.0
// Scenes of a few colliders, and a component that writes down trigger events.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/physics/world.hpp"

namespace sim2vr::physics {

using Events = std::vector<std::string>;

class Listener : public scene::Component {
 public:
  Listener(Events& events, std::string tag) : events_(events), tag_(std::move(tag)) {}

  std::string_view typeName() const override { return "Listener"; }
  void OnTriggerEnter(const scene::TriggerContact& contact) override { note("Enter", contact); }
  void OnTriggerStay(const scene::TriggerContact& contact) override { note("Stay", contact); }
  void OnTriggerExit(const scene::TriggerContact& contact) override { note("Exit", contact); }

  std::function<void(const scene::TriggerContact&)> on_event;

 private:
  void note(const char* event, const scene::TriggerContact& contact) {
    events_.push_back(tag_ + "." + event + "(" + contact.other->gameObject().name() + ")");
    if (on_event) on_event(contact);
  }

  Events& events_;
  std::string tag_;
};

/// A hammer (unit box, no body) and targets (unit box triggers with a body), which log their
/// events.
struct Arena {
  scene::Scene scene;
  PhysicsWorld world{scene};
  Events events;

  Collider& addHammer(const std::string& name, double x) {
    scene::GameObject& object = scene.create(name);
    object.transform().setLocalPosition(Vec3(x, 0, 0));
    auto& collider = object.addComponent<Collider>(Box{});
    object.addComponent<Listener>(events, name);
    return collider;
  }

  Collider& addTarget(const std::string& name, double x) {
    scene::GameObject& object = scene.create(name);
    object.transform().setLocalPosition(Vec3(x, 0, 0));
    object.addComponent<Rigidbody>();
    auto& collider = object.addComponent<Collider>(Box{}, Vec3::Zero(), /*is_trigger=*/true);
    object.addComponent<Listener>(events, name);
    return collider;
  }

  static void moveTo(Collider& collider, double x) {
    collider.transform().setPosition(Vec3(x, 0, 0));
  }

  Events step() {
    events.clear();
    world.step();
    return events;
  }
};

}  // namespace sim2vr::physics
