// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/wire/shared_images.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::wire {
namespace {

std::string contents(const SharedImages& images) {
  std::ifstream file(images.path(), std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string refusal(SharedImages& images, std::size_t index, std::size_t bytes) {
  try {
    images.write(index, std::vector<std::uint8_t>(bytes, 9));
  } catch (const EngineError& refused) {
    return refused.what();
  }
  return "none";
}

TEST(SharedImages, AnImageOfAnotherSizeOrPlaceIsRefusedAndWritesNothing) {
  const auto images = SharedImages::create(2, 4);
  ASSERT_NE(images, nullptr);
  images->write(1, std::vector<std::uint8_t>{1, 2, 3, 4});
  const std::string before("\0\0\0\0\1\2\3\4", 8);
  EXPECT_EQ(contents(*images), before);
  EXPECT_EQ(refusal(*images, 1, 3),
            "shared images: got 3 bytes for image 1, expected 4 for one of 2");
  EXPECT_EQ(refusal(*images, 0, 5),
            "shared images: got 5 bytes for image 0, expected 4 for one of 2");
  EXPECT_EQ(refusal(*images, 2, 4),
            "shared images: got 4 bytes for image 2, expected 4 for one of 2");
  EXPECT_EQ(contents(*images), before);
}

}  // namespace
}  // namespace sim2vr::wire
