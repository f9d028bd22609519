// SPDX-License-Identifier: Apache-2.0
#include "pointing/rules.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/random.hpp"

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

double Block::index_bits() const { return std::log2(distance_m / width_m + 1.0); }

std::vector<Block> drawBlocks(const Settings& settings, std::uint32_t seed) {
  std::vector<Block> all;
  Random random(seed);
  // The first words of neighbouring seeds resemble each other.
  for (int i = 0; i < 8; ++i) random.next();
  for (int i = 0; i < settings.repeats; ++i) {
    std::vector<Block> once;
    for (const double distance_m : settings.distances_m) {
      for (const double width_m : settings.widths_m) once.push_back({distance_m, width_m});
    }
    random.shuffle(once);
    all.insert(all.end(), once.begin(), once.end());
  }
  return all;
}

int targetOfTrial(int trial, int targets) { return trial * ((targets + 1) / 2) % targets; }

Vec3 targetCenter_m(int target, int targets, double distance_m) {
  const double radius_m = 0.5 * distance_m / std::cos(std::numbers::pi / (2.0 * targets));
  const double angle = 2.0 * std::numbers::pi * target / targets;
  return {radius_m * std::sin(angle), radius_m * std::cos(angle), 0.0};
}

Movement movementOf(const Vec3& from_m, const Vec3& to_m, const Vec3& began_m, const Vec3& ended_m,
                    double time_s) {
  const Vec3 axis = (to_m - from_m).normalized();
  return {time_s, (ended_m - to_m).dot(axis), (ended_m - began_m).dot(axis)};
}

double Effective::index_bits() const { return std::log2(distance_m / width_m() + 1.0); }

void MovementSums::add(const Movement& movement) {
  ++count_;
  time_sum_s_ += movement.time_s;
  length_sum_m_ += movement.length_m;
  offset_sum_m_ += movement.offset_m;
  offset_square_sum_m2_ += movement.offset_m * movement.offset_m;
}

std::optional<Effective> MovementSums::effective() const {
  constexpr double kLeastVariance_m2 = 1e-12;
  if (count_ < 2) return std::nullopt;
  const double variance_m2 =
      (offset_square_sum_m2_ - offset_sum_m_ * offset_sum_m_ / count_) / (count_ - 1);
  const double distance_m = length_sum_m_ / count_;
  if (variance_m2 < kLeastVariance_m2 || distance_m <= 0.0) return std::nullopt;
  return Effective{time_sum_s_ / count_, distance_m, std::sqrt(variance_m2)};
}

void MovementSums::fields(Archive& archive) {
  archive.field("count", count_, kCounts);
  archive.field("time_sum_s", time_sum_s_, kQuantities);
  archive.field("length_sum_m", length_sum_m_, kQuantities);
  archive.field("offset_sum_m", offset_sum_m_, kQuantities);
  archive.field("offset_square_sum_m2", offset_square_sum_m2_, kQuantities);
}

void Tally::add(const Movement& movement, double index_bits) {
  ++movements;
  time_sum_s += movement.time_s;
  index_sum_bits += index_bits;
}

void Tally::add(const Effective& block) {
  ++blocks;
  throughput_sum_bps += block.throughput_bps();
  effective_index_sum_bits += block.index_bits();
  variance_sum_m2 += block.deviation_m * block.deviation_m;
}

void Tally::fields(Archive& archive) {
  archive.field("hits", hits, kCounts);
  archive.field("errors", errors, kCounts);
  archive.field("timeouts", timeouts, kCounts);
  archive.field("movements", movements, kCounts);
  archive.field("time_sum_s", time_sum_s, kQuantities);
  archive.field("index_sum_bits", index_sum_bits, kQuantities);
  archive.field("blocks", blocks, kCounts);
  archive.field("throughput_sum_bps", throughput_sum_bps, kQuantities);
  archive.field("effective_index_sum_bits", effective_index_sum_bits, kQuantities);
  archive.field("variance_sum_m2", variance_sum_m2, kQuantities);
}

}  // namespace sim2vr::games::pointing
