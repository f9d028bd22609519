#include "sim2vr/core/text.hpp"
#include "own_folder.hpp"

#include <gtest/gtest.h>

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
            "--script: got '/dev/zero' (above 256 MiB), expected a readable JSON file");
}

}  // namespace
}  // namespace sim2vr
