// SPDX-License-Identifier: Apache-2.0
// A round of the panel: one widget after the other is lit and has to be operated.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "panel/widget.hpp"
#include "sim2vr/core/archive.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::panel {

// A hand on the panel: where it points, and whether it holds what it points at.

/// From the grip to the fingertip, along the controller's forward axis.
inline constexpr double kFinger_m = 0.10;

/// The actions that both hands have; made before the rig attaches all action sets.
struct Controls {
  const xr::Action* aim = nullptr;
  const xr::Action* trigger = nullptr;
  const xr::Action* squeeze = nullptr;
  const xr::Action* scroll = nullptr;
  const xr::Action* vibrate = nullptr;

  static Controls make(xr::Session& session);
};

/// What a hand does in a frame.
struct PointerState {
  /// The hand is tracked.
  bool active = false;
  /// The ray meets the panel's plane, or the fingertip is near it.
  bool on_plane = false;
  /// There, from the panel's centre; z is 0.
  Vec3 place_m = Vec3::Zero();
  /// World: where the ray begins and which way it goes; or the fingertip, and ahead of it.
  Vec3 origin_m = Vec3::Zero();
  Vec3 forward = Vec3::UnitZ();
  /// The trigger or the grip button is pulled; or the fingertip has come through the plane.
  bool held = false;
  /// `held` began, or ended, in this frame.
  bool pressed = false;
  bool released = false;
  /// Of the controller about its forward axis, rad, clockwise for the player.
  double roll_rad = 0.0;
  /// Thumbstick, up positive, -1 to 1.
  double scroll = 0.0;

  void fields(Archive& archive);
};

class Pointer {
 public:
  /// What is passed outlives it.
  Pointer(const scene::GameObject& controller, xr::Hand hand, xr::Session& session,
          const Controls& controls, Select select)
      : controller_(&controller),
        hand_(hand),
        session_(&session),
        controls_(controls),
        select_(select) {}

  xr::Hand hand() const { return hand_; }
  const PointerState& state() const { return state_; }

  /// Looks at the hand, in every frame; the panel's centre, world.
  void update(const Vec3& center_m);
  /// A pulse of 20 ms.
  void vibrate() const;
  /// How far it is from pointing at a place, world: an angle, rad, or a distance, m.
  double gap(const Vec3& place_m) const;

  void fields(Archive& archive) {
    archive.field("state", state_);
    archive.field("in_front", in_front_);
  }

 private:
  void updateRay(const Vec3& center_m);
  void updateTouch(const Vec3& center_m);

  const scene::GameObject* controller_;
  xr::Hand hand_;
  xr::Session* session_;
  Controls controls_;
  Select select_;
  PointerState state_;
  /// The fingertip has been on the player's side of the plane since it last came through.
  bool in_front_ = false;
};

/// What a round counts and measures.
struct Tally {
  int targets = 0;       // that came up and are over
  int hits = 0;          // operated as wanted
  int errors = 0;        // another widget, another goal, or nothing at all
  int missed_first = 0;  // targets whose first operation was an error
  int timeouts = 0;
  /// From a target's appearance to the operation that ended it, of each hit.
  std::vector<float> times_s;

  double meanTime_s() const;
  double medianTime_s() const;
  void fields(Archive& archive);
};

struct RoundSetup {
  Settings settings;
  std::uint32_t seed = 0;
  rl::XrRig rig;
  std::vector<Pointer> pointers;
  rl::EpisodeLogger* logger = nullptr;
  rl::SoundLog* sounds = nullptr;
};

class Round : public scene::Component {
 public:
  enum class Flash : std::uint8_t { none, hit, error };

  explicit Round(RoundSetup setup);

  std::string_view typeName() const override { return "panel.Round"; }
  void Awake() override;
  void Update() override;
  void fields(Archive& archive) override;

  const Settings& settings() const { return setup_.settings; }
  const Tally& tally() const { return tally_; }
  const std::vector<Pointer>& pointers() const { return setup_.pointers; }
  const std::vector<std::unique_ptr<Widget>>& widgets() const { return widgets_; }
  bool over() const { return over_; }
  /// Of all its time, 0 to 1.
  double progress() const;
  /// World; where the head was at the start of the round decides.
  const Vec3& center_m() const { return center_m_; }
  int lit() const { return lit_; }
  /// World, of what the player has to point at or to touch first.
  Vec3 handle_m() const {
    return center_m_ + widgets_.at(static_cast<std::size_t>(lit_))->handle_m();
  }
  /// What happened last, if that is less than 0.2 s ago.
  Flash flash() const;

 private:
  void begin();
  void light();
  /// Lets a hand press, hold and release what it points at; what it thereby operated, if anything.
  void operate(std::size_t which);
  void decide(int widget, Result result, const Pointer& pointer);
  void endTarget(bool hit);

  // round_log.cpp
  void openLog();
  void logState();
  void logTarget();
  void logOutcome(const char* event, const Vec3* place_m);

  RoundSetup setup_;
  Random random_;
  std::vector<std::unique_ptr<Widget>> widgets_;
  bool begun_ = false;
  bool over_ = false;
  float start_s_ = 0.0F;
  float now_s_ = 0.0F;
  Vec3 center_m_ = Vec3::Zero();
  int lit_ = 0;
  int target_id_ = 0;
  float appeared_s_ = 0.0F;
  bool erred_ = false;
  /// The widget that each hand holds; -1: none.
  std::array<int, 2> grabbed_{-1, -1};
  Tally tally_;
  Flash last_ = Flash::none;
  float last_s_ = 0.0F;
};

}  // namespace sim2vr::games::panel
