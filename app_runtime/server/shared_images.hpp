// The images of a session's apps in POSIX shared memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace sim2vr::server {

class SharedImages {
 public:
  /// Memory for `count` images of `image_bytes` each. Null, with a line in the log, where the
  /// machine has no shared memory left.
  static std::unique_ptr<SharedImages> create(std::size_t count, std::size_t image_bytes);
  /// Unmaps the memory; its name goes too if it is still there.
  ~SharedImages();
  SharedImages(const SharedImages&) = delete;
  SharedImages& operator=(const SharedImages&) = delete;

  /// For shm_open, with the leading slash.
  const std::string& name() const { return name_; }
  void write(std::size_t index, std::span<const std::uint8_t> image);
  /// Takes the name away; who has mapped the memory keeps it. Nothing is left in the system then
  /// when the processes end.
  void unlink();

 private:
  SharedImages(std::string name, std::uint8_t* data, std::size_t bytes, std::size_t image_bytes)
      : name_(std::move(name)), data_(data), bytes_(bytes), image_bytes_(image_bytes) {}

  std::string name_;
  std::uint8_t* data_;
  std::size_t bytes_;
  std::size_t image_bytes_;
  bool linked_ = true;
};

}  // namespace sim2vr::server
