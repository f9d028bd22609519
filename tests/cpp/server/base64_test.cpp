// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/server/message.hpp"

#include <gtest/gtest.h>

namespace sim2vr::server {
namespace {

// The test vectors of RFC 4648, section 10.
TEST(Base64, KnownTexts) {
  const std::pair<const char*, const char*> texts[] = {{"", ""},
                                                       {"f", "Zg=="},
                                                       {"fo", "Zm8="},
                                                       {"foo", "Zm9v"},
                                                       {"foob", "Zm9vYg=="},
                                                       {"fooba", "Zm9vYmE="},
                                                       {"foobar", "Zm9vYmFy"}};
  for (const auto& [bytes, text] : texts) {
    EXPECT_EQ(encodeBase64(bytes), text);
    EXPECT_EQ(decodeBase64(text), bytes);
  }
}

TEST(Base64, EveryByteComesBack) {
  std::string bytes;
  for (int i = 0; i < 256; ++i) bytes += static_cast<char>(i);
  EXPECT_EQ(decodeBase64(encodeBase64(bytes)), bytes);
}

TEST(Base64, RefusesWhatItWouldNotWrite) {
  for (const char* text :
       {"Zg", "Zg=", "Z===", "====", "Zg==Zg==", "Zh==", "Zm9=", "Zm9 ", "Zm\n="}) {
    EXPECT_THROW(decodeBase64(text), MalformedMessage) << text;
  }
}

}  // namespace
}  // namespace sim2vr::server
