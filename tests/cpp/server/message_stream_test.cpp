#include "sim2vr/server/message_stream.hpp"

#include <gtest/gtest.h>

namespace sim2vr::server {
namespace {

using namespace std::string_literals;

// Two frames of 3 and 0 bytes, then one of 1 byte.
const std::string kBytes = "\x02\0\0\0\x03\0\0\0\0\0\0\0abc"s + "\x01\0\0\0\x01\0\0\0z"s;
const std::vector<std::string> kFirst{"abc", ""};
const std::vector<std::string> kSecond{"z"};

std::string problemOf(std::string_view bytes) {
  MessageStream stream;
  stream.feed(bytes);
  EXPECT_TRUE(stream.complete());
  try {
    stream.take();
  } catch (const MalformedMessage& error) {
    return error.what();
  }
  return "none";
}

TEST(MessageStream, TakesMessagesHoweverTheyWereCut) {
  for (std::size_t cut = 0; cut <= kBytes.size(); ++cut) {
    MessageStream stream;
    stream.feed(kBytes.substr(0, cut));
    const bool first_there = cut >= 15;  // 4 + 2 * 4 + 3
    EXPECT_EQ(stream.complete(), first_there) << cut;
    if (!first_there) {
      EXPECT_EQ(stream.take(), std::nullopt);
    }
    stream.feed(kBytes.substr(cut));
    EXPECT_EQ(stream.take(), kFirst) << cut;
    EXPECT_EQ(stream.take(), kSecond) << cut;
    EXPECT_FALSE(stream.complete());
    EXPECT_EQ(stream.take(), std::nullopt);
  }
}

TEST(MessageStream, WritesWhatItReads) {
  EXPECT_EQ(streamHeader(kFirst) + "abc" + streamHeader(kSecond) + "z", kBytes);
  // 0x01020304 bytes: the lowest byte first.
  EXPECT_EQ(streamHeader({std::string(0x01020304, ' ')}), "\x01\0\0\0\x04\x03\x02\x01"s);
}

TEST(MessageStream, RefusesWhatNoMessageIs) {
  EXPECT_EQ(problemOf("\0\0\0\0"s), "stream: got 0 frames, expected 1 to 16");
  EXPECT_EQ(problemOf("\x11\0\0\0"s), "stream: got 17 frames, expected 1 to 16");
  // 12 bytes before the frames, and 2^26 of the first one: 12 bytes too long.
  EXPECT_EQ(problemOf("\x02\0\0\0\0\0\0\x04\0\0\0\0"s),
            "stream: got a message of 67108876 bytes, expected 67108864 at most");
  MessageStream stream;
  stream.feed("\x02\0\0\0\0\0\0\x04\0\0\0"s);  // the second size is not there yet
  EXPECT_FALSE(stream.complete());
}

}  // namespace
}  // namespace sim2vr::server
