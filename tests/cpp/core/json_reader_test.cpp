// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/json_reader.hpp"
#include "error_of.hpp"

#include <gtest/gtest.h>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

std::string nested(int levels) {
  const auto times = static_cast<std::size_t>(levels);
  return R"({"a":)" + std::string(times, '[') + std::string(times, ']') + "}";
}

TEST(JsonReader, RefusesWhatWouldExhaustMemory) {
  EXPECT_NO_THROW(parseJson(nested(31), "it"));
  EXPECT_EQ(errorOf([] { parseJson(nested(32), "it"); }),
            "it: got JSON nested deeper, expected 32 levels at most");
  EXPECT_NO_THROW(parseJson(R"({"a": [1, 2, 3]})", "it", 2));
  EXPECT_EQ(errorOf([] { parseJson(R"({"a": [1, 2, 3]})", "it", 1); }),
            "it: got JSON with more values, expected 1 at most");
  EXPECT_EQ(errorOf([] { parseJson("[1]", "it"); }), "it: got an array, expected a JSON object");
}

TEST(JsonReader, NamesThePathOfAField) {
  const nlohmann::json json =
      parseJson(R"({"notes": [{"x": 1}, {"x": 7.5, "t": -1, "z": null}]})", "it");
  const JsonFields fields(json, "it");
  const JsonFields note = fields.objects("notes")[1];
  EXPECT_EQ(errorOf([&] { note.integer("x", 0, 0, 3); }),
            "it.notes[1].x: got 7.5, expected a whole number from 0 to 3");
  EXPECT_EQ(errorOf([&] { note.number("t", 0.0, 0.0, 1e6); }),
            "it.notes[1].t: got -1.0, expected a number from 0.0 to 1000000.0");
  EXPECT_EQ(errorOf([&] { note.expect("z", "a colour"); }),
            "it.notes[1].z: got none, expected a colour");
  EXPECT_EQ(errorOf([&] { note.expectOnly({"x", "t"}); }),
            "it.notes[1]: got the unknown field 'z', expected one of 'x' or 't'; did you mean "
            "'x'?");
  EXPECT_EQ(note.number("z", 0.25, 0.0, 1.0), 0.25);
  EXPECT_EQ(note.names(), (std::vector<std::string>{"t", "x", "z"}));
}

}  // namespace
}  // namespace sim2vr
