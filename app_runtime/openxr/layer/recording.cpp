#include <fmt/format.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "layer.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::openxr::layer {
namespace {

using nlohmann::json;

/// Position and rotation in the app's frame.
json row(const XrPosef& pose) {
  const Pose app = xr::fromXr(pose);
  return {app.position.x(), app.position.y(), app.position.z(), app.rotation.x(),
          app.rotation.y(), app.rotation.z(), app.rotation.w()};
}

/// Columns of xr::kInputColumns; touches are not read.
json inputs(const xr::ControllerState& hand) {
  const auto digital = [](bool pressed) { return pressed ? 1 : 0; };
  return {hand.trigger,
          hand.squeeze,
          hand.thumbstick.x,
          hand.thumbstick.y,
          digital(hand.thumbstick_click),
          digital(hand.a || hand.x),
          digital(hand.b || hand.y),
          digital(hand.menu),
          0,
          0,
          0,
          0,
          0};
}

std::string numbered(std::string path) {
  const std::size_t at = path.find("%p");
  if (at != std::string::npos) path.replace(at, 2, std::to_string(::getpid()));
  return path;
}

}  // namespace

Recording::Recording(std::string path, const std::string& application) {
  const std::string name = numbered(std::move(path));
  file_ = std::fopen(name.c_str(), "wxe");
  if (file_ == nullptr) {
    fmt::print(stderr, "sim2vr OpenXR layer: {}: {}; nothing is recorded\n", name,
               std::strerror(errno));
    return;
  }
  line(json{{"format", "sim2vr-session"},
            {"version", 1},
            {"app", {{"kind", "app"}, {"name", application}}},
            {"source", "openxr"}}
           .dump(-1, ' ', false, json::error_handler_t::replace));
}

Recording::~Recording() {
  if (file_ != nullptr) std::fclose(file_);
}

void Recording::line(const std::string& text) {
  if (file_ == nullptr) return;
  std::fwrite(text.data(), 1, text.size(), file_);
  std::fputc('\n', file_);
  // A program that is killed leaves whole lines.
  std::fflush(file_);
}

void Recording::frame(XrTime time, const XrPosef& head,
                      const std::array<xr::ControllerState, 2>& hands) {
  if (first_ == 0) first_ = time;
  latest_ = std::max(latest_, time - first_);
  json entry{{"t", latest_}, {"head", row(head)}};
  for (std::size_t i = 0; i < hands.size(); ++i) {
    if (!hands[i].active) continue;
    entry[i == 0 ? "left" : "right"] = {
        {"grip", row(hands[i].grip)}, {"aim", row(hands[i].aim)}, {"inputs", inputs(hands[i])}};
  }
  line(entry.dump());
}

void Recording::haptic(const char* hand, const XrHapticVibration& vibration) {
  line(json{{"t", latest_},
            {"event", "haptic"},
            {"data",
             {{"hand", hand},
              {"amplitude", vibration.amplitude},
              {"frequency_hz", vibration.frequency},
              // The shortest that the device can is -1 ns, as in OpenXR.
              {"duration_s", static_cast<double>(vibration.duration) * 1e-9}}}}
           .dump());
}

}  // namespace sim2vr::openxr::layer
