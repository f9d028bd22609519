// SPDX-License-Identifier: Apache-2.0
// The options of a round of the panel (docs/reference/games/panel.md).
#pragma once

#include <string>
#include <vector>

#include "sim2vr/core/math.hpp"
#include "sim2vr/core/options.hpp"
#include "sim2vr/xr/device.hpp"

namespace sim2vr::games::panel {

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

}  // namespace sim2vr::games::panel
