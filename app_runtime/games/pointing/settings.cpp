// SPDX-License-Identifier: Apache-2.0
#include "pointing/settings.hpp"

#include <nlohmann/json.hpp>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::games::pointing {
namespace {

int wholeNumber(Options& options, const std::string& name, int fallback, int least, int most) {
  const double value = options.getNumber(name, fallback, least, most);
  if (value != static_cast<int>(value)) {
    throw InvalidArgument("option '" + name + "'", std::to_string(value), "a whole number");
  }
  return static_cast<int>(value);
}

std::vector<double> lengths(Options& options, const std::string& name,
                            const std::vector<double>& fallback, double most_m) {
  constexpr double kLeast_m = 0.002;
  if (!options.has(name)) {
    options.getNumbers(name, kLeast_m, most_m);
    return fallback;
  }
  std::vector<double> given = options.getNumbers(name, kLeast_m, most_m);
  if (given.empty()) throw InvalidArgument("option '" + name + "'", "none", "at least one length");
  return given;
}

}  // namespace

Settings Settings::fromOptions(Options& options) {
  static const std::vector<std::string> kHands{"right", "left"};
  Settings settings;
  settings.targets = wholeNumber(options, "targets", settings.targets, 3, kMostTargets);
  if (settings.targets % 2 == 0) {
    throw InvalidArgument("option 'targets'", std::to_string(settings.targets),
                          "an odd number, so that the next target is opposite");
  }
  settings.distances_m = lengths(options, "distances_m", settings.distances_m, 2.0);
  settings.widths_m = lengths(options, "widths_m", settings.widths_m, 1.0);
  const std::size_t blocks = settings.distances_m.size() * settings.widths_m.size();
  if (blocks > kMostBlocks) {
    throw InvalidArgument("option 'widths_m'",
                          std::to_string(blocks) + " pairs of a distance and a width",
                          "at most " + std::to_string(kMostBlocks));
  }
  settings.repeats = wholeNumber(options, "repeats", settings.repeats, 1, 100);
  settings.side_m = options.getNumber("side_m", settings.side_m, -1.0, 1.0);
  settings.height_m = options.getNumber("height_m", settings.height_m, -1.0, 1.0);
  settings.depth_m = options.getNumber("depth_m", settings.depth_m, 0.1, 2.0);
  settings.head_request = options.getBool("head_request", settings.head_request);
  settings.stylus_m = options.getNumber("stylus_m", settings.stylus_m, 0.0, 0.5);
  settings.rearm_m = options.getNumber("rearm_m", settings.rearm_m, 0.0, 0.1);
  settings.timeout_s = static_cast<float>(options.getNumber("timeout_seconds", 3.0, 0.1, 60.0));
  settings.hand =
      options.getChoice("hand", "right", kHands) == "left" ? xr::Hand::left : xr::Hand::right;
  settings.sparse = options.getBool("sparse", settings.sparse);
  settings.error_cost = options.getNumber("error_cost", settings.error_cost, 0.0, 100.0);
  return settings;
}

std::string Settings::playOptionsJson() const {
  const Settings usual;
  nlohmann::json options = nlohmann::json::object();
  const auto add = [&options](const char* name, const auto& value, const auto& default_value) {
    if (value != default_value) options[name] = value;
  };
  add("targets", targets, usual.targets);
  add("distances_m", distances_m, usual.distances_m);
  add("widths_m", widths_m, usual.widths_m);
  add("repeats", repeats, usual.repeats);
  add("side_m", side_m, usual.side_m);
  add("height_m", height_m, usual.height_m);
  add("depth_m", depth_m, usual.depth_m);
  add("stylus_m", stylus_m, usual.stylus_m);
  add("rearm_m", rearm_m, usual.rearm_m);
  add("timeout_seconds", timeout_s, usual.timeout_s);
  if (hand == xr::Hand::left) options["hand"] = "left";
  return options.dump();
}

}  // namespace sim2vr::games::pointing
