// SPDX-License-Identifier: Apache-2.0
// A component that writes down which of its methods were called.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "sim2vr/scene/scene.hpp"

namespace sim2vr::scene {

using Calls = std::vector<std::string>;

class Recorder : public Component {
 public:
  Recorder(Calls& calls, std::string tag, int order = 0)
      : calls_(calls), tag_(std::move(tag)), order_(order) {}

  std::string_view typeName() const override { return "Recorder"; }
  int executionOrder() const override { return order_; }
  void Awake() override { note("Awake"); }
  void OnEnable() override { note("OnEnable"); }
  void Start() override { note("Start"); }
  void FixedUpdate() override { note("FixedUpdate"); }
  void Update() override {
    note("Update");
    if (on_update) on_update();
  }
  void LateUpdate() override { note("LateUpdate"); }
  void OnDisable() override { note("OnDisable"); }
  void OnDestroy() override {
    note("OnDestroy");
    if (on_destroy) on_destroy();
  }
  void fields(Archive& archive) override { archive.field("value", value); }

  int value = 0;
  std::function<void()> on_update;
  std::function<void()> on_destroy;

 private:
  void note(const char* call) { calls_.push_back(tag_ + "." + call); }

  Calls& calls_;
  std::string tag_;
  int order_;
};

constexpr std::int64_t kFrame_ns = 62'500'000;

/// Settings with one fixed step per frame of kFrame_ns.
inline TimeSettings oneStepPerFrame() {
  TimeSettings settings;
  settings.fixed_delta_time_s = 0.0625;
  return settings;
}

/// Runs the next frame and returns the calls it made.
inline Calls runFrame(Scene& scene, Calls& calls, std::int64_t frame) {
  calls.clear();
  scene.runFrame(frame * kFrame_ns, [&calls] { calls.push_back("physics"); });
  return calls;
}

}  // namespace sim2vr::scene
