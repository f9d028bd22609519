// SPDX-License-Identifier: Apache-2.0
#include "panel/widget.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/render/mesh.hpp"
#include "sim2vr/xr/frames.hpp"

namespace sim2vr::games::panel {
namespace {

// In the order of the enumerations.
const std::vector<std::string> kSelects{"ray", "touch"};
const std::vector<std::string> kWidgets{"buttons", "sliders", "dial", "list", "mixed"};
const std::vector<std::string> kHands{"right", "left", "both"};

template <class T>
T choice(Options& options, const std::string& name, const std::vector<std::string>& names,
         T fallback) {
  const std::string& usual = names.at(static_cast<std::size_t>(fallback));
  const std::string chosen = options.getChoice(name, usual, names);
  std::size_t index = 0;
  while (names.at(index) != chosen) ++index;
  return static_cast<T>(index);
}

int wholeNumber(Options& options, const std::string& name, int fallback, int most) {
  const double value = options.getNumber(name, fallback, 1, most);
  if (value != static_cast<int>(value)) {
    throw InvalidArgument("option '" + name + "'", std::to_string(value), "a whole number");
  }
  return static_cast<int>(value);
}

// A fingertip farther from the plane points at nothing.
constexpr double kNear_m = 0.15;
// How steeply a ray has to meet the plane.
constexpr double kLeastForward = 0.05;

// At half strength, at the frequency that the controller likes best.
constexpr XrHapticVibration kPulse{XR_TYPE_HAPTIC_VIBRATION, nullptr, 20'000'000,
                                   XR_FREQUENCY_UNSPECIFIED, 0.5F};

bool inBox(const Vec3& place_m, const Vec3& center_m, double width_m, double height_m) {
  const Vec3 away = (place_m - center_m).cwiseAbs();
  return away.x() <= width_m / 2.0 && away.y() <= height_m / 2.0;
}

bool inDisc(const Vec3& place_m, const Vec3& center_m, double diameter_m) {
  return (place_m - center_m).norm() <= diameter_m / 2.0;
}

// A disc's radius is 1 m.
Vec3 discSize(double diameter_m) { return {diameter_m / 2.0, diameter_m / 2.0, 1.0}; }

}  // namespace

Settings Settings::fromOptions(Options& options) {
  Settings settings;
  settings.select = choice(options, "select", kSelects, settings.select);
  settings.widgets = choice(options, "widgets", kWidgets, settings.widgets);
  const double usual_m = settings.select == Select::ray ? settings.distance_m : 0.45;
  settings.side_m = options.getNumber("side_m", settings.side_m, -2.0, 2.0);
  settings.height_m = options.getNumber("height_m", settings.height_m, -1.0, 1.0);
  settings.distance_m = options.getNumber("distance_m", usual_m, 0.2, 6.0);
  settings.columns = wholeNumber(options, "columns", settings.columns, 7);
  settings.rows = wholeNumber(options, "rows", settings.rows, 7);
  const double scale = settings.scale();
  settings.button_m = options.getNumber("button_m", scale * settings.button_m, 0.005, 1.0);
  settings.pitch_m = options.getNumber("pitch_m", scale * settings.pitch_m, 0.005, 2.0);
  if (settings.pitch_m < settings.button_m) {
    throw InvalidArgument("option 'pitch_m'", std::to_string(settings.pitch_m),
                          "at least button_m, " + std::to_string(settings.button_m));
  }
  const std::string hand = options.getChoice("hand", "right", kHands);
  if (hand == "left") settings.hands = {xr::Hand::left};
  if (hand == "both") settings.hands = {xr::Hand::right, xr::Hand::left};
  settings.timeout_s = static_cast<float>(options.getNumber("timeout_seconds", 10.0, 0.5, 600.0));
  settings.round_s = static_cast<float>(options.getNumber("round_seconds", 20.0, 1.0, 600.0));
  settings.sparse = options.getBool("sparse", settings.sparse);
  settings.error_cost = options.getNumber("error_cost", settings.error_cost, 0.0, 100.0);
  return settings;
}

render::MeshRenderer& addShape(scene::GameObject& parent, const std::string& name,
                               const render::MeshPtr& mesh, const Vec3& center_m,
                               const Vec3& size_m, const render::Color& color, int layer) {
  constexpr double kLayer_m = 0.001;
  scene::GameObject& shape = parent.scene().create(name, &parent);
  shape.transform().setLocalPosition(center_m - Vec3(0.0, 0.0, kLayer_m * layer));
  shape.transform().setLocalScale(size_m);
  render::Material material = render::unlitMaterial(color);
  material.cull_back = false;
  return shape.addComponent<render::MeshRenderer>(mesh, material);
}

void moveShape(render::MeshRenderer& shape, const Vec3& center_m) {
  Vec3 place = center_m;
  place.z() = shape.transform().localPosition().z();
  shape.transform().setLocalPosition(place);
}

Controls Controls::make(xr::Session& session) {
  xr::ActionSet& set = session.createActionSet("panel");
  const auto bound = [&](const char* name, XrActionType type, const char* path) {
    xr::Action& action = session.createAction(set, name, type);
    session.suggestBinding(action, std::string("/user/hand/left/") + path);
    session.suggestBinding(action, std::string("/user/hand/right/") + path);
    return &action;
  };
  return {bound("aim", XR_ACTION_TYPE_POSE_INPUT, "input/aim/pose"),
          bound("trigger", XR_ACTION_TYPE_BOOLEAN_INPUT, "input/trigger/value"),
          bound("squeeze", XR_ACTION_TYPE_BOOLEAN_INPUT, "input/squeeze/value"),
          bound("scroll", XR_ACTION_TYPE_VECTOR2F_INPUT, "input/thumbstick"),
          bound("vibrate", XR_ACTION_TYPE_VIBRATION_OUTPUT, "output/haptic")};
}

void PointerState::fields(Archive& archive) {
  archive.field("active", active);
  archive.field("on_plane", on_plane);
  archive.field("place_m", place_m);
  archive.field("origin_m", origin_m);
  archive.field("forward", forward);
  archive.field("held", held);
  archive.field("pressed", pressed);
  archive.field("released", released);
  archive.field("roll_rad", roll_rad, kQuantities);
  archive.field("scroll", scroll, kQuantities);
}

void Pointer::update(const Vec3& center_m) {
  const bool was_held = state_.held;
  state_ = PointerState();
  state_.active = controller_->activeInHierarchy();
  if (state_.active) {
    if (select_ == Select::ray) {
      updateRay(center_m);
    } else {
      updateTouch(center_m);
    }
    const Quat& turned = controller_->transform().rotation();
    const Vec3 right = turned * Vec3::UnitX();
    state_.roll_rad = std::atan2(-right.y(), (turned * Vec3::UnitY()).y());
    state_.scroll = session_->actionState(*controls_.scroll, hand_).value.y;
  } else {
    in_front_ = false;
  }
  state_.pressed = state_.held && !was_held;
  state_.released = was_held && !state_.held;
}

void Pointer::updateRay(const Vec3& center_m) {
  const xr::Space aim = session_->actionSpace(*controls_.aim, hand_);
  const Pose ray = xr::fromXr(session_->locateSpace(aim).value_or(xr::kIdentityPose));
  state_.origin_m = ray.position;
  state_.forward = ray.rotation * Vec3::UnitZ();
  const double ahead_m = center_m.z() - ray.position.z();
  state_.on_plane = ahead_m > 0.0 && state_.forward.z() > kLeastForward;
  if (state_.on_plane) {
    state_.place_m = ray.position + state_.forward * (ahead_m / state_.forward.z()) - center_m;
    state_.place_m.z() = 0.0;
  }
  const auto pulled = [this](const xr::Action* action) {
    return session_->actionState(*action, hand_).pressed();
  };
  state_.held = pulled(controls_.trigger) || pulled(controls_.squeeze);
}

void Pointer::updateTouch(const Vec3& center_m) {
  const Pose grip = controller_->transform().pose();
  state_.origin_m = grip * Vec3(0.0, 0.0, kFinger_m);
  state_.forward = grip.rotation * Vec3::UnitZ();
  const double behind_m = state_.origin_m.z() - center_m.z();
  state_.on_plane = std::abs(behind_m) < kNear_m;
  state_.place_m = state_.origin_m - center_m;
  state_.place_m.z() = 0.0;
  if (behind_m < 0.0) in_front_ = true;
  // A finger that comes from behind the panel touches nothing.
  state_.held = in_front_ && behind_m >= 0.0 && state_.on_plane;
  if (!state_.on_plane && behind_m >= 0.0) in_front_ = false;
}

void Pointer::vibrate() const { session_->applyHapticFeedback(*controls_.vibrate, hand_, kPulse); }

double Pointer::gap(const Vec3& place_m) const {
  const Vec3 way = place_m - state_.origin_m;
  if (select_ == Select::touch) return way.norm();
  return std::atan2(state_.forward.cross(way).norm(), state_.forward.dot(way));
}

// --- Button

bool Button::contains(const Vec3& place_m) const {
  return inDisc(place_m, center_m(), diameter_m_);
}

void Button::build(scene::GameObject& panel) {
  disc_ =
      &addShape(panel, "Button", render::disc(20), center_m(), discSize(diameter_m_), kUnlit, 1);
}

void Button::show(bool lit) { disc_->material.albedo = lit ? kLit : kUnlit; }

// --- Slider

namespace {
constexpr double kKnobOfLength = 0.16;
// Half of the distance between the marks, of the length.
constexpr double kSliderTolerance = 0.06;
constexpr double kSliderLeastWay = 0.2;
}  // namespace

Slider::Slider(const Vec3& center_m, double length_m)
    : Widget(center_m), length_m_(length_m), knob_m_(kKnobOfLength * length_m) {}

bool Slider::contains(const Vec3& place_m) const {
  return inBox(place_m, center_m(), length_m_ + knob_m_, knob_m_);
}

void Slider::drawGoal(Random& random) {
  do {
    goal_ = random.range(0.0F, 1.0F);
  } while (std::abs(goal_ - value_) < kSliderLeastWay);
}

Result Slider::press(const PointerState& pointer) {
  // Beside its knob a slider is not operated, and nothing is wrong.
  grabbed_value_ = value_;
  grabbed_x_m_ = pointer.place_m.x();
  return std::nullopt;
}

void Slider::hold(const PointerState& pointer) {
  if (!pointer.on_plane) return;
  const bool on_knob = std::abs(grabbed_x_m_ - at(grabbed_value_).x()) <= knob_m_ / 2.0;
  if (!on_knob) return;
  const double moved = (pointer.place_m.x() - grabbed_x_m_) / length_m_;
  value_ = std::clamp(grabbed_value_ + moved, 0.0, 1.0);
}

Result Slider::release(const PointerState&) {
  if (value_ == grabbed_value_) return std::nullopt;
  return std::abs(value_ - goal_) <= kSliderTolerance;
}

void Slider::build(scene::GameObject& panel) {
  addShape(panel, "Rail", render::quad(), center_m(), {length_m_ + knob_m_, knob_m_ / 3.0, 1.0},
           kRail, 1);
  mark_ = &addShape(panel, "Mark", render::quad(), center_m(),
                    {2.0 * kSliderTolerance * length_m_, 1.4 * knob_m_, 1.0}, kGoal, 2);
  knob_ = &addShape(panel, "Knob", render::disc(16), center_m(), discSize(knob_m_), kUnlit, 3);
}

void Slider::show(bool lit) {
  moveShape(*knob_, at(value_));
  moveShape(*mark_, at(goal_));
  mark_->visible = lit;
  knob_->material.albedo = lit ? kLit : kUnlit;
}

void Slider::fields(Archive& archive) {
  archive.field("value", value_, {0.0, 1.0});
  archive.field("goal", goal_, {0.0, 1.0});
  archive.field("grabbed_value", grabbed_value_, {0.0, 1.0});
  archive.field("grabbed_x_m", grabbed_x_m_, kQuantities);
}

// --- Dial

namespace {
constexpr double kDialTolerance_rad = 0.15;
// A wrist turns it in one go.
constexpr float kDialLeastWay_rad = 0.4F, kDialMostWay_rad = 0.9F;
constexpr Range kAngle{-std::numbers::pi, std::numbers::pi};

double wrapped(double angle_rad) { return std::remainder(angle_rad, 2.0 * std::numbers::pi); }

// The panel as the player sees it: a turn about z to the left is positive.
Quat clockwise(double angle_rad) { return Quat(Eigen::AngleAxisd(-angle_rad, Vec3::UnitZ())); }
}  // namespace

bool Dial::contains(const Vec3& place_m) const { return inDisc(place_m, center_m(), diameter_m_); }

void Dial::drawGoal(Random& random) {
  const double way_rad = random.range(kDialLeastWay_rad, kDialMostWay_rad);
  // Towards up, so that the pointer stays where a wrist can bring it.
  goal_rad_ = wrapped(angle_rad_ + (angle_rad_ > 0.0 ? -way_rad : way_rad));
}

Result Dial::press(const PointerState& pointer) {
  grabbed_angle_rad_ = angle_rad_;
  grabbed_roll_rad_ = pointer.roll_rad;
  return std::nullopt;
}

void Dial::hold(const PointerState& pointer) {
  if (!pointer.active) return;
  angle_rad_ = wrapped(grabbed_angle_rad_ + wrapped(pointer.roll_rad - grabbed_roll_rad_));
}

Result Dial::release(const PointerState&) {
  return std::abs(wrapped(angle_rad_ - goal_rad_)) <= kDialTolerance_rad;
}

void Dial::build(scene::GameObject& panel) {
  disc_ = &addShape(panel, "Dial", render::disc(24), center_m(), discSize(diameter_m_), kUnlit, 1);
  // Bars that reach from the middle outwards turn about it.
  const auto bar = [&](const std::string& name, const render::Color& color, double from_m,
                       double to_m, int layer) {
    scene::GameObject& axis = panel.scene().create(name + " Axis", &panel);
    axis.transform().setLocalPosition(center_m());
    addShape(axis, name, render::quad(), {0.0, (from_m + to_m) / 2.0, 0.0},
             {diameter_m_ / 8.0, to_m - from_m, 1.0}, color, layer);
    return &axis;
  };
  mark_ = bar("Mark", kGoal, 0.35 * diameter_m_, 0.65 * diameter_m_, 2);
  hand_ = bar("Hand", {1.0F, 1.0F, 1.0F, 1.0F}, 0.0, 0.45 * diameter_m_, 3);
}

void Dial::show(bool lit) {
  hand_->transform().setLocalRotation(clockwise(angle_rad_));
  mark_->transform().setLocalRotation(clockwise(goal_rad_));
  mark_->setActive(lit);
  disc_->material.albedo = lit ? kLit : kUnlit;
}

void Dial::fields(Archive& archive) {
  archive.field("angle_rad", angle_rad_, kAngle);
  archive.field("goal_rad", goal_rad_, kAngle);
  archive.field("grabbed_angle_rad", grabbed_angle_rad_, kAngle);
  archive.field("grabbed_roll_rad", grabbed_roll_rad_, kAngle);
}

// --- List

namespace {
constexpr double kRowOfWidth = 0.2;
// Of a row: what goes farther is no press but a drag.
constexpr double kDragged = 0.3;
constexpr double kScroll_per_s = 6.0;
}  // namespace

List::List(const Vec3& center_m, double width_m)
    : Widget(center_m), width_m_(width_m), row_m_(kRowOfWidth * width_m) {}

bool List::contains(const Vec3& place_m) const {
  return inBox(place_m, center_m(), width_m_, kShown * row_m_);
}

Vec3 List::handle_m() const {
  const double shown = std::clamp(below(goal_), 0.5, kShown - 0.5);
  return center_m() + Vec3(0.0, (0.5 * kShown - shown) * row_m_, 0.0);
}

void List::drawGoal(Random& random) {
  const int last = goal_;
  while (goal_ == last) goal_ = random.range(0, kRows);
}

void List::scrollTo(double top) {
  top_ = std::clamp(top, 0.0, static_cast<double>(kRows - kShown));
}

void List::hover(const PointerState& pointer, float dt_s) {
  // Up shows what is above.
  scrollTo(top_ - kScroll_per_s * pointer.scroll * dt_s);
}

Result List::press(const PointerState& pointer) {
  grabbed_top_ = top_;
  grabbed_y_m_ = pointer.place_m.y();
  dragged_ = false;
  return std::nullopt;
}

void List::hold(const PointerState& pointer) {
  if (!pointer.on_plane) return;
  const double rows = (pointer.place_m.y() - grabbed_y_m_) / row_m_;
  dragged_ = dragged_ || std::abs(rows) > kDragged;
  if (dragged_) scrollTo(grabbed_top_ + rows);
}

Result List::release(const PointerState&) {
  if (dragged_) return std::nullopt;
  const double rows = 0.5 * kShown - (grabbed_y_m_ - center_m().y()) / row_m_;
  return static_cast<int>(std::floor(top_ + rows)) == goal_;
}

void List::build(scene::GameObject& panel) {
  for (int row = 0; row < kRows; ++row) {
    rows_.push_back(&addShape(panel, "Row", render::quad(), center_m(),
                              {width_m_, 0.85 * row_m_, 1.0}, kUnlit, 1));
  }
  arrow_ = &addShape(panel, "Arrow", render::disc(3), center_m(), discSize(0.7 * row_m_), kGoal, 2);
}

void List::show(bool lit) {
  for (int row = 0; row < kRows; ++row) {
    render::MeshRenderer& shape = *rows_.at(static_cast<std::size_t>(row));
    const double from_top = below(row);
    shape.visible = from_top > 0.0 && from_top < kShown;
    moveShape(shape, center_m() + Vec3(0.0, (0.5 * kShown - from_top) * row_m_, 0.0));
    shape.material.albedo = lit && row == goal_ ? kLit : kUnlit;
  }
  // Beside the window, at the end where the row is that has to be scrolled in.
  const bool above = below(goal_) <= 0.0;
  arrow_->visible = lit && (above || below(goal_) >= kShown);
  const double side = above ? 1.0 : -1.0;
  moveShape(*arrow_, center_m() + Vec3(0.5 * width_m_ + row_m_, side * 2.0 * row_m_, 0.0));
}

void List::fields(Archive& archive) {
  archive.field("top", top_, {0.0, static_cast<double>(kRows - kShown)});
  archive.field("goal", goal_, {0.0, kRows - 1.0});
  archive.field("grabbed_top", grabbed_top_, {0.0, static_cast<double>(kRows - kShown)});
  archive.field("grabbed_y_m", grabbed_y_m_, kQuantities);
  archive.field("dragged", dragged_);
}

// --- Layout

std::vector<std::unique_ptr<Widget>> makeWidgets(const Settings& settings) {
  std::vector<std::unique_ptr<Widget>> widgets;
  const double scale = settings.scale();
  const auto buttons = [&](int columns, int rows, const Vec3& center_m) {
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        const Vec3 from_center(column - (columns - 1) / 2.0, (rows - 1) / 2.0 - row, 0.0);
        widgets.push_back(
            std::make_unique<Button>(center_m + settings.pitch_m * from_center, settings.button_m));
      }
    }
  };
  switch (settings.widgets) {
    case Widgets::buttons:
      buttons(settings.columns, settings.rows, Vec3::Zero());
      break;
    case Widgets::sliders:
      for (const double y : {0.2, 0.0, -0.2}) {
        widgets.push_back(std::make_unique<Slider>(Vec3(0.0, y * scale, 0.0), 0.6 * scale));
      }
      break;
    case Widgets::dial:
      widgets.push_back(std::make_unique<Dial>(Vec3::Zero(), 0.3 * scale));
      break;
    case Widgets::list:
      widgets.push_back(std::make_unique<List>(Vec3::Zero(), 0.6 * scale));
      break;
    case Widgets::mixed:
      buttons(2, 2, Vec3(-0.35, 0.2, 0.0) * scale);
      widgets.push_back(std::make_unique<Slider>(Vec3(-0.35, -0.25, 0.0) * scale, 0.45 * scale));
      widgets.push_back(std::make_unique<Dial>(Vec3(0.3, -0.3, 0.0) * scale, 0.25 * scale));
      widgets.push_back(std::make_unique<List>(Vec3(0.3, 0.2, 0.0) * scale, 0.45 * scale));
      break;
  }
  return widgets;
}

}  // namespace sim2vr::games::panel
