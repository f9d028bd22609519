// SPDX-License-Identifier: Apache-2.0
// A round of the panel: one widget after the other is lit and has to be operated.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "panel/widget.hpp"
#include "sim2vr/rl/episode_logger.hpp"
#include "sim2vr/rl/sound.hpp"
#include "sim2vr/rl/xr_rig.hpp"

namespace sim2vr::games::panel {

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
