// A program that reads what we write.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace sim2vr::runtime {

class ChildProcess {
 public:
  /// Starts arguments[0], found on PATH, with its standard input connected to write(). Throws
  /// EngineError when it cannot be started.
  explicit ChildProcess(std::vector<std::string> arguments);
  /// As finish().
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// False when the program no longer reads.
  bool write(std::span<const std::uint8_t> bytes);
  /// Closes its input and waits for its end; its exit code, or 128 + the signal that ended it.
  int finish();

 private:
  pid_t pid_ = -1;
  int input_ = -1;
  int status_ = 0;
};

}  // namespace sim2vr::runtime
