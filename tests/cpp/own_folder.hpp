// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

namespace sim2vr::testing {

/// An empty folder that no other test has, also of those that run at the same time; gone at the
/// end.
class OwnFolder {
 public:
  OwnFolder() : path_(std::filesystem::path(::testing::TempDir()) / name()) {
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~OwnFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  OwnFolder(const OwnFolder&) = delete;
  OwnFolder& operator=(const OwnFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::filesystem::path& below) const {
    return path_ / below;
  }

 private:
  static std::string name() {
    static int count = 0;
    return "sim2vr-test-" + std::to_string(::getpid()) + "-" + std::to_string(count++);
  }

  std::filesystem::path path_;
};

}  // namespace sim2vr::testing
