// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/rl/privileged_table.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace sim2vr::rl {
namespace {

struct Source {
  double speed_mps;
  Vec3 place_m;
};

PrivilegedTable<Source> smallTable() {
  PrivilegedTable<Source> table;
  table.number("ball.speed_mps", [](const Source& s) { return s.speed_mps; });
  table.vector("ball.", "_m", [](const Source& s) { return s.place_m; });
  table.number("ball.fast", [](const Source& s) { return s.speed_mps > 1.0; });
  return table;
}

TEST(PrivilegedTable, NamesAndValuesStandInTheSameOrder) {
  const auto table = smallTable();
  EXPECT_EQ(table.names(), (std::vector<std::string>{"ball.speed_mps", "ball.x_m", "ball.y_m",
                                                     "ball.z_m", "ball.fast"}));
  std::vector<float> row(5, -1.0F);
  table.fill({2.5, Vec3(0.1, 0.2, 0.3)}, row);
  EXPECT_EQ(row, (std::vector<float>{2.5F, 0.1F, 0.2F, 0.3F, 1.0F}));
}

TEST(PrivilegedTable, NeverWritesIntoTheNextUsersRow) {
  const auto table = smallTable();
  std::vector<float> rows(8, -1.0F);
  const auto fill = [&](std::size_t size) {
    try {
      table.fill({2.5, Vec3::Zero()}, std::span(rows).first(size));
    } catch (const InvalidArgument& refused) {
      return std::string(refused.what());
    }
    return std::string();
  };
  EXPECT_EQ(fill(4), "values: got 4 numbers, expected 5");
  EXPECT_EQ(fill(6), "values: got 6 numbers, expected 5");
  EXPECT_EQ(rows, std::vector<float>(8, -1.0F));
  EXPECT_EQ(fill(5), "");
  EXPECT_EQ(rows[5], -1.0F);
}

}  // namespace
}  // namespace sim2vr::rl
