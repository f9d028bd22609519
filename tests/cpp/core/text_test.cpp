// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/core/text.hpp"
#include "own_folder.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "sim2vr/core/errors.hpp"

namespace sim2vr {
namespace {

std::string refusal(const std::filesystem::path& path) {
  try {
    readTextFile("--script", path, "a readable JSON file");
  } catch (const InvalidArgument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Printable, ShowsWhatAStrangerWroteInOneShortLine) {
  EXPECT_EQ(printable("sim2vr-harness, Python 3.11"), "sim2vr-harness, Python 3.11");
  EXPECT_EQ(printable("a\nb\x1b[31m\x7f\"\xff"), R"(a\nb\u001b[31m\u007f\"\ufffd)");
  EXPECT_EQ(printable(std::string(1000, 'x')), std::string(200, 'x') + "...");
  EXPECT_EQ(printable("12345", 4), "1234...");
}

TEST(ReadTextFile, GivesAllBytes) {
  const testing::OwnFolder folder;
  const auto path = folder / "text";
  std::string bytes(200'000, 'x');
  bytes[7] = '\0';
  bytes[65536] = '\n';
  std::ofstream(path, std::ios::binary) << bytes;
  EXPECT_EQ(readTextFile("--script", path, "a file"), bytes);
}

TEST(ReadTextFile, DoesNotWaitForTheWriterOfAPipe) {
  const testing::OwnFolder own;
  const auto pipe = own / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(refusal(pipe), "--script: got '" + pipe.string() +
                               "' (not a regular file), expected a readable JSON file");
}

TEST(PathFromUri, GivesTheBytesOfThePath) {
  EXPECT_EQ(pathFromUri("f", "maps/file:x"), "maps/file:x");
  EXPECT_EQ(pathFromUri("f", "file:///maps/M%E4use%20%25"), "/maps/M\xe4use %");
  EXPECT_EQ(pathFromUri("f", "file:/maps"), "/maps");
  for (const std::string uri : {"file:maps", "file://host/maps", "file:///a%", "file:///a%4",
                                "file:///a%G0", "file:///a%00b"}) {
    EXPECT_THROW(pathFromUri("f", uri), InvalidArgument) << uri;
  }
}

TEST(ValidUtf8, ReplacesEveryOtherByte) {
  EXPECT_EQ(validUtf8("K\xc3\xa4se"), "K\xc3\xa4se");
  EXPECT_EQ(validUtf8("K\xe4se"), "K\xef\xbf\xbdse");
}

TEST(ReadTextFile, SaysInOneSentenceWhatIsWrongWithWhich) {
  const testing::OwnFolder own;
  const std::filesystem::path& folder = own.path();
  EXPECT_EQ(refusal(folder),
            "--script: got '" + folder.string() + "' (a folder), expected a readable JSON file");
  EXPECT_EQ(refusal("no/such\nfile"),
            "--script: got 'no/such\\nfile' (No such file or directory), expected a readable JSON "
            "file");
  const auto empty = folder / "empty";
  std::ofstream(empty).close();
  EXPECT_EQ(refusal(empty),
            "--script: got '" + empty.string() + "' (empty), expected a readable JSON file");
  EXPECT_EQ(refusal("/proc/self/mem"),
            "--script: got '/proc/self/mem' (cannot be read), expected a readable JSON file");
  EXPECT_EQ(refusal("/dev/zero"),
            "--script: got '/dev/zero' (not a regular file), expected a readable JSON file");
  const auto large = folder / "large";
  std::ofstream(large) << "x";
  std::filesystem::resize_file(large, (std::uintmax_t{256} << 20U) + 1);
  EXPECT_EQ(refusal(large), "--script: got '" + large.string() +
                                "' (above 256 MiB), expected a readable JSON file");
}

}  // namespace
}  // namespace sim2vr
