// SPDX-License-Identifier: Apache-2.0
#include "panel/settings.hpp"

#include "sim2vr/core/errors.hpp"

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

}  // namespace sim2vr::games::panel
