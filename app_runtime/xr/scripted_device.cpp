// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/xr/scripted_device.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/math.hpp"

namespace sim2vr::xr {
namespace {

using Json = nlohmann::json;

float mix(float a, float b, double part) {
  return static_cast<float>(a + (static_cast<double>(b) - a) * part);
}

XrPosef mix(const XrPosef& a, const XrPosef& b, double part) {
  const Quat from(a.orientation.w, a.orientation.x, a.orientation.y, a.orientation.z);
  const Quat to(b.orientation.w, b.orientation.x, b.orientation.y, b.orientation.z);
  const Quat q = from.slerp(part, to).normalized();
  return {{static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()),
           static_cast<float>(q.w())},
          {mix(a.position.x, b.position.x, part), mix(a.position.y, b.position.y, part),
           mix(a.position.z, b.position.z, part)}};
}

ControllerState mix(const ControllerState& a, const ControllerState& b, double part) {
  ControllerState mixed = a;
  if (!a.active || !b.active) return mixed;
  mixed.grip = mix(a.grip, b.grip, part);
  mixed.aim = mix(a.aim, b.aim, part);
  mixed.trigger = mix(a.trigger, b.trigger, part);
  mixed.squeeze = mix(a.squeeze, b.squeeze, part);
  mixed.thumbstick = {mix(a.thumbstick.x, b.thumbstick.x, part),
                      mix(a.thumbstick.y, b.thumbstick.y, part)};
  return mixed;
}

// --- JSON

[[noreturn]] void refuse(const std::string& entry, const Json& got, const std::string& expected) {
  throw InvalidArgument(entry, got.dump().substr(0, 80), expected);
}

void requireKnownKeys(const std::string& entry, const Json& object,
                      const std::vector<std::string>& known) {
  if (!object.is_object()) refuse(entry, object, "a JSON object");
  for (const auto& item : object.items()) {
    if (std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
    throw InvalidArgument(entry, "'" + item.key() + "'",
                          "only " + listChoices(known) + didYouMean(item.key(), known));
  }
}

template <std::size_t N>
void readNumbers(const std::string& entry, const Json& object, const char* key,
                 const std::array<float*, N>& values) {
  const auto found = object.find(key);
  if (found == object.end()) return;
  const bool numbers =
      found->is_array() && found->size() == N &&
      std::all_of(found->begin(), found->end(), [](const Json& v) { return v.is_number(); });
  if (!numbers) refuse(entry + "." + key, *found, "a list of " + std::to_string(N) + " numbers");
  for (std::size_t i = 0; i < N; ++i) *values[i] = (*found)[i].template get<float>();
}

void readNumber(const std::string& entry, const Json& object, const char* key, float& value) {
  const auto found = object.find(key);
  if (found == object.end()) return;
  if (!found->is_number()) refuse(entry + "." + key, *found, "a number");
  value = found->get<float>();
}

void readBool(const std::string& entry, const Json& object, const char* key, bool& value) {
  const auto found = object.find(key);
  if (found == object.end()) return;
  if (!found->is_boolean()) refuse(entry + "." + key, *found, "true or false");
  value = found->get<bool>();
}

void readPose(const std::string& entry, const Json& object, const std::string& prefix,
              XrPosef& pose) {
  XrQuaternionf& q = pose.orientation;
  readNumbers<3>(entry, object, (prefix + "position").c_str(),
                 {&pose.position.x, &pose.position.y, &pose.position.z});
  readNumbers<4>(entry, object, (prefix + "rotation").c_str(), {&q.x, &q.y, &q.z, &q.w});
}

void readController(const std::string& entry, const Json& object, ControllerState& state,
                    bool& aim_given) {
  requireKnownKeys(entry, object,
                   {"active", "position", "rotation", "aim_position", "aim_rotation", "trigger",
                    "squeeze", "thumbstick", "thumbstick_click", "a", "b", "x", "y", "menu"});
  state.active = true;
  readBool(entry, object, "active", state.active);
  readPose(entry, object, "", state.grip);
  aim_given = aim_given || object.contains("aim_position") || object.contains("aim_rotation");
  readPose(entry, object, "aim_", state.aim);
  if (!aim_given) state.aim = compose(state.grip, kGripToAim);
  readNumber(entry, object, "trigger", state.trigger);
  readNumber(entry, object, "squeeze", state.squeeze);
  readNumbers<2>(entry, object, "thumbstick", {&state.thumbstick.x, &state.thumbstick.y});
  readBool(entry, object, "thumbstick_click", state.thumbstick_click);
  readBool(entry, object, "a", state.a);
  readBool(entry, object, "b", state.b);
  readBool(entry, object, "x", state.x);
  readBool(entry, object, "y", state.y);
  readBool(entry, object, "menu", state.menu);
}

XrTime readTime(const std::string& entry, const Json& object) {
  const auto found = object.find("time_s");
  if (found == object.end()) throw InvalidArgument(entry + ".time_s", "nothing", "seconds");
  const double time_s = found->is_number() ? found->get<double>() : -1.0;
  if (!(time_s >= 0.0 && time_s < 1e9)) {
    refuse(entry + ".time_s", *found, "seconds from 0 to below 1e9");
  }
  return std::llround(time_s * 1e9);
}

}  // namespace

ScriptedDevice::ScriptedDevice(std::vector<Keyframe> keyframes) : keyframes_(std::move(keyframes)) {
  if (keyframes_.empty()) throw InvalidArgument("keyframes", "none", "one keyframe or more");
  for (std::size_t i = 0; i < keyframes_.size(); ++i) {
    keyframes_[i].state = validated(keyframes_[i].state);
    if (i > 0 && keyframes_[i].time <= keyframes_[i - 1].time) {
      throw InvalidArgument(
          "keyframes[" + std::to_string(i) + "].time", std::to_string(keyframes_[i].time) + " ns",
          "a time after the previous keyframe's " + std::to_string(keyframes_[i - 1].time) + " ns");
    }
  }
}

ScriptedDevice ScriptedDevice::fromJson(std::string_view text) {
  const Json script = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (script.is_discarded()) {
    throw InvalidArgument("script", "'" + std::string(text.substr(0, 80)) + "'", "a JSON object");
  }
  requireKnownKeys("script", script, {"keyframes"});
  const auto list = script.find("keyframes");
  if (list == script.end() || !list->is_array()) {
    throw InvalidArgument("keyframes", "none", "a list of keyframes");
  }
  std::vector<Keyframe> keyframes;
  Keyframe frame;
  std::array<bool, 2> aim_given{};
  for (std::size_t i = 0; i < list->size(); ++i) {
    const Json& object = (*list)[i];
    const std::string entry = "keyframes[" + std::to_string(i) + "]";
    requireKnownKeys(entry, object, {"time_s", "head", "left_controller", "right_controller"});
    frame.time = readTime(entry, object);
    if (object.contains("head")) {
      requireKnownKeys(entry + ".head", object["head"], {"position", "rotation"});
      readPose(entry + ".head", object["head"], "", frame.state.head);
    }
    for (const Hand hand : kHands) {
      const std::string key = hand == Hand::left ? "left_controller" : "right_controller";
      if (!object.contains(key)) continue;
      readController(entry + "." + key, object[key], frame.state.hand(hand),
                     aim_given[static_cast<std::size_t>(hand)]);
    }
    keyframes.push_back(frame);
  }
  return ScriptedDevice(std::move(keyframes));
}

DeviceState ScriptedDevice::sample(XrTime time) const {
  const auto after =
      std::upper_bound(keyframes_.begin(), keyframes_.end(), time,
                       [](XrTime t, const Keyframe& keyframe) { return t < keyframe.time; });
  if (after == keyframes_.begin()) return keyframes_.front().state;
  if (after == keyframes_.end()) return keyframes_.back().state;
  const Keyframe& a = *(after - 1);
  const Keyframe& b = *after;
  const double part = static_cast<double>(time - a.time) / static_cast<double>(b.time - a.time);
  DeviceState state = a.state;
  state.head = mix(a.state.head, b.state.head, part);
  for (const Hand hand : kHands) {
    state.hand(hand) = mix(a.state.hand(hand), b.state.hand(hand), part);
  }
  return state;
}

}  // namespace sim2vr::xr
