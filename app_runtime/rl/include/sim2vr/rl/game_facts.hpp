// SPDX-License-Identifier: Apache-2.0
// What a game publishes about itself: how its rounds are measured, which conditions it
// has, what its cameras and names are called. Tables, curves, progress and pictures are made of it.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace sim2vr::rl {

enum class Better { kHigher, kLower, kNone };

/// One number of a round, from the last frame's log (RLEnv::log).
struct Measure {
  /// Rows and columns of one number per item, such as the cells of a grid; row by row.
  struct Grid {
    int rows = 1;
    int columns = 1;
  };

  /// Key in results; lower_case, unit last: "hit_speed_mps".
  std::string name;
  /// For tables, without the unit: "Hitting speed".
  std::string label = {};
  std::string unit = {};
  /// The log's number; of a grid, the numbers log_key + "0" and so on.
  std::string log_key = {};
  Better better = Better::kHigher;
  int digits = 1;
  /// What a reader might ask about the label, in a line; may be empty.
  std::string description = {};
  /// With it the measure is the share log_key / (log_key + rate_with) of a round, a number from 0
  /// to 1, and none where nothing came up.
  std::string rate_with = {};
  std::optional<Grid> grid = std::nullopt;
  /// None where this number of the log is 0 (no hit, no hit speed).
  std::string only_if = {};
};

/// A named set of options. All conditions of a game set the same options, so that one can be
/// played after the other.
struct GameCondition {
  std::string name;
  std::string description = {};
  /// A JSON object.
  std::string options_json = "{}";
  /// The conditions a round may turn out to be, where that is not this one itself: the members of a
  /// random mix, or the one that this is another name of.
  std::vector<std::string> draws = {};
  /// Whether evaluations play it by default.
  bool evaluated = false;
};

/// What the log's name of a reward term's sum over the round ends with.
inline constexpr const char* kSumSuffix = "Sum";

/// A part of the reward that the environment logs with RLEnv::logTerm: a user step's under
/// `log_key`, the round's under `log_key` + kSumSuffix.
struct RewardTerm {
  std::string log_key;
  std::string label;
};

/// What comes and goes in a round, such as targets, as the episode's log has it
/// (EpisodeLogger): evaluations write a row of data for each. A line of the log is "EVENT, FIELD
/// VALUE, FIELD VALUE"; the names below are those of events and fields.
struct LoggedItem {
  /// A way to end.
  struct Outcome {
    std::string event;
    /// What data and tables call it: "hit".
    std::string name;
    /// Whether the player did well.
    bool success = false;
  };

  /// "target"
  std::string name;
  /// Tells the items of a round apart, together with `name`.
  std::string id_field;
  /// The event with which it comes; empty: the log has none.
  std::string begin_event = {};
  std::vector<Outcome> outcomes = {};
  /// Events in between, which are counted: touches that were too slow.
  std::vector<std::string> counted_events = {};
  /// The field with the number of the place that it came up in; empty: no such number.
  std::string cell_field = {};
  /// The field with its place, 2 or 3 numbers, m.
  std::string place_field = {};
  /// Or the event at the round's start with "[cell ... x y z]" for every cell: world, m.
  std::string places_event = {};
  /// The field with the velocity that decided, 3 numbers, m/s.
  std::string velocity_field = {};
};

struct GameFacts {
  /// Of a round with default options; 0 when rounds have no usual length.
  double round_seconds = 0.0;
  /// Controllers without which a right-handed player cannot play: "controller_right",
  /// "controller_left". A user who does not wear them gets an error instead of empty rounds.
  std::vector<std::string> devices = {};
  /// What a right-handed player operates besides moving: "right.trigger".
  std::vector<std::string> inputs = {};
  /// The option that takes "right" or "left", the hand that plays; "left" needs the other
  /// controllers. Empty: the game has none.
  std::string hand_option = {};
  /// The option that names the level to play; the game then has a timeline (Game::timelineJson).
  /// Empty: the game has none.
  std::string level_option = {};
  /// In the order of the tables.
  std::vector<Measure> measures = {};
  /// Name of the measure by which users are compared; empty: the return.
  std::string score = {};
  /// Terms that are not the score's; what they leave of the game's reward is called reward_rest.
  std::vector<RewardTerm> reward_terms = {};
  std::string reward_rest = "Game";
  /// What evaluations write a row of data for; none without logs.
  std::vector<LoggedItem> items = {};
  /// In the order in which they are listed to people. None: the game has one, its defaults.
  std::vector<GameCondition> conditions = {};
  /// Name of the condition that a round without options is; may be empty without conditions.
  std::string default_condition = {};
  /// A JSON object: options that an evaluation sets, for example to switch a curriculum off.
  std::string evaluation_options_json = "{}";
  /// "WhacAMole" in the Gymnasium id "sim2vr/WhacAMole-v0". Empty: the name's words in capitals.
  std::string id = {};
};

/// The facts as a JSON object with the game's name and description, what was left empty filled in.
/// Throws InvalidArgument naming the field when they contradict themselves.
std::string factsJson(std::string_view name, std::string_view description, GameFacts facts);

}  // namespace sim2vr::rl
