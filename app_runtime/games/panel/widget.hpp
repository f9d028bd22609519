// SPDX-License-Identifier: Apache-2.0
// What can be operated on a panel. A pointer presses, holds and releases a widget; the widget says
// when it has been operated, and whether it is then as the player was to set it.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim2vr/core/archive.hpp"
#include "sim2vr/core/math.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/core/random.hpp"
#include "sim2vr/render/components.hpp"
#include "sim2vr/scene/game_object.hpp"
#include "sim2vr/scene/scene.hpp"
#include "sim2vr/xr/device.hpp"
#include "sim2vr/xr/session.hpp"

namespace sim2vr::games::panel {

// The options of a round of the panel (docs/reference/games/panel.md).

/// How widgets are operated: by the controller's ray and a button, or by a fingertip.
enum class Select { ray, touch };
enum class Widgets { buttons, sliders, dial, list, mixed };

struct Settings {
  Select select = Select::ray;
  Widgets widgets = Widgets::buttons;

  /// Centre of the panel from the head at the start of the round, world axes.
  double side_m = 0.0;
  double height_m = -0.1;
  double distance_m = 1.5;

  /// Of the buttons: a grid.
  int columns = 3;
  int rows = 4;
  double button_m = 0.12;
  double pitch_m = 0.20;

  std::vector<xr::Hand> hands{xr::Hand::right};
  float timeout_s = 10.0F;
  float round_s = 20.0F;

  /// Without the term that grows as the hand comes nearer.
  bool sparse = false;
  double error_cost = 2.0;

  Vec3 center_m() const { return {side_m, height_m, distance_m}; }
  /// Sizes of sliders, dials and lists are for 1.5 m; at other distances they look as large.
  double scale() const { return distance_m / 1.5; }

  /// Throws InvalidArgument naming the option.
  static Settings fromOptions(Options& options);
};

// Flat shapes and colours of a panel. In red light only what is to be operated is bright.

inline constexpr render::Color kLit{1.0F, 0.15F, 0.10F, 1.0F};
inline constexpr render::Color kUnlit{0.12F, 0.35F, 0.55F, 1.0F};
inline constexpr render::Color kRail{0.08F, 0.12F, 0.18F, 1.0F};
inline constexpr render::Color kGoal{0.95F, 0.70F, 0.10F, 1.0F};
inline constexpr render::Color kPlate{0.05F, 0.08F, 0.11F, 1.0F};
inline constexpr render::Color kHit{0.10F, 0.85F, 0.30F, 1.0F};
inline constexpr render::Color kError{0.15F, 0.25F, 1.0F, 1.0F};

/// Adds an unlit shape below `parent`, `layer` steps of 1 mm in front of the panel.
render::MeshRenderer& addShape(scene::GameObject& parent, const std::string& name,
                               const render::MeshPtr& mesh, const Vec3& center_m,
                               const Vec3& size_m, const render::Color& color, int layer);

/// Moves it along the panel; its layer stays.
void moveShape(render::MeshRenderer& shape, const Vec3& center_m);

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

/// Whether a widget that has been operated is at its goal; none: it is not decided yet.
using Result = std::optional<bool>;

class Widget {
 public:
  /// Centre from the panel's; z is 0.
  explicit Widget(const Vec3& center_m) : center_m_(center_m) {}
  virtual ~Widget() = default;
  Widget(const Widget&) = delete;
  Widget& operator=(const Widget&) = delete;

  const Vec3& center_m() const { return center_m_; }
  /// Whether a press at a place on the panel is this widget's.
  virtual bool contains(const Vec3& place_m) const = 0;
  /// Where it has to be pressed first, from the panel's centre.
  virtual Vec3 handle_m() const { return center_m_; }
  /// Diameter of what has to be pressed first.
  virtual double width_m() const = 0;
  /// "button", "slider", "dial", "list"
  virtual std::string_view kind() const = 0;

  /// Draws a goal that the widget is not at.
  virtual void drawGoal(Random&) {}
  /// A pointer is over it, and holds nothing.
  virtual void hover(const PointerState&, float /*dt_s*/) {}
  virtual Result press(const PointerState&) { return std::nullopt; }
  virtual void hold(const PointerState&) {}
  virtual Result release(const PointerState&) { return std::nullopt; }

  /// Adds its shapes below the panel.
  virtual void build(scene::GameObject& panel) = 0;
  /// Shows its state.
  virtual void show(bool lit) = 0;
  virtual void fields(Archive&) {}

 private:
  Vec3 center_m_;
};

/// A round button.
class Button : public Widget {
 public:
  Button(const Vec3& center_m, double diameter_m) : Widget(center_m), diameter_m_(diameter_m) {}
  bool contains(const Vec3& place_m) const override;
  double width_m() const override { return diameter_m_; }
  std::string_view kind() const override { return "button"; }
  Result press(const PointerState&) override { return true; }
  void build(scene::GameObject& panel) override;
  void show(bool lit) override;

 private:
  double diameter_m_;
  render::MeshRenderer* disc_ = nullptr;
};

/// A knob on a rail, to be brought between two marks.
class Slider : public Widget {
 public:
  Slider(const Vec3& center_m, double length_m);
  bool contains(const Vec3& place_m) const override;
  Vec3 handle_m() const override { return at(value_); }
  double width_m() const override { return knob_m_; }
  std::string_view kind() const override { return "slider"; }
  void drawGoal(Random& random) override;
  Result press(const PointerState& pointer) override;
  void hold(const PointerState& pointer) override;
  Result release(const PointerState&) override;
  void build(scene::GameObject& panel) override;
  void show(bool lit) override;
  void fields(Archive& archive) override;

 private:
  Vec3 at(double value) const { return center_m() + Vec3((value - 0.5) * length_m_, 0.0, 0.0); }

  double length_m_;
  double knob_m_;
  double value_ = 0.5;  // 0 left, 1 right
  double goal_ = 0.5;
  double grabbed_value_ = 0.5;
  double grabbed_x_m_ = 0.0;
  render::MeshRenderer* knob_ = nullptr;
  render::MeshRenderer* mark_ = nullptr;
};

/// A knob with a pointer that the wrist turns.
class Dial : public Widget {
 public:
  Dial(const Vec3& center_m, double diameter_m) : Widget(center_m), diameter_m_(diameter_m) {}
  bool contains(const Vec3& place_m) const override;
  double width_m() const override { return diameter_m_; }
  std::string_view kind() const override { return "dial"; }
  void drawGoal(Random& random) override;
  Result press(const PointerState& pointer) override;
  void hold(const PointerState& pointer) override;
  Result release(const PointerState&) override;
  void build(scene::GameObject& panel) override;
  void show(bool lit) override;
  void fields(Archive& archive) override;

 private:
  double diameter_m_;
  double angle_rad_ = 0.0;  // clockwise from up
  double goal_rad_ = 0.0;
  double grabbed_angle_rad_ = 0.0;
  double grabbed_roll_rad_ = 0.0;
  scene::GameObject* hand_ = nullptr;
  scene::GameObject* mark_ = nullptr;
  render::MeshRenderer* disc_ = nullptr;
};

/// Rows that scroll below a window, by the thumbstick or by dragging; one is to be pressed.
class List : public Widget {
 public:
  static constexpr int kRows = 12;
  static constexpr int kShown = 5;

  List(const Vec3& center_m, double width_m);
  bool contains(const Vec3& place_m) const override;
  Vec3 handle_m() const override;
  double width_m() const override { return row_m_; }
  std::string_view kind() const override { return "list"; }
  void drawGoal(Random& random) override;
  void hover(const PointerState& pointer, float dt_s) override;
  Result press(const PointerState& pointer) override;
  void hold(const PointerState& pointer) override;
  Result release(const PointerState& pointer) override;
  void build(scene::GameObject& panel) override;
  void show(bool lit) override;
  void fields(Archive& archive) override;

 private:
  /// Rows between the window's top and the middle of a row.
  double below(int row) const { return row + 0.5 - top_; }
  void scrollTo(double top);

  double width_m_;
  double row_m_;
  double top_ = 0.0;  // rows that have gone out at the top
  int goal_ = 0;
  double grabbed_top_ = 0.0;
  double grabbed_y_m_ = 0.0;
  bool dragged_ = false;
  std::vector<render::MeshRenderer*> rows_;
  render::MeshRenderer* arrow_ = nullptr;
};

/// The widgets of a panel, by its settings.
std::vector<std::unique_ptr<Widget>> makeWidgets(const Settings& settings);

}  // namespace sim2vr::games::panel
