// SPDX-License-Identifier: Apache-2.0
// The images of a session's apps in memory that a client on the same machine can map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace sim2vr::wire {

/// Memory without a name in any file system (memfd_create): the kernel takes it back with the last
/// process that has it, also after kills.
class SharedImages {
 public:
  /// Memory for `count` images of `image_bytes` each. Null, with a line in the log, where the
  /// machine has none left.
  static std::unique_ptr<SharedImages> create(std::size_t count, std::size_t image_bytes);
  ~SharedImages();
  SharedImages(const SharedImages&) = delete;
  SharedImages& operator=(const SharedImages&) = delete;

  /// For processes that get a descriptor over a socket.
  int file() const { return file_; }
  /// Where processes of the same user can open it: this process's descriptor below /proc.
  std::string path() const;
  /// What that link reads as if it is this memory and not that of a process with the same number in
  /// another container.
  const std::string& link() const { return link_; }
  void write(std::size_t index, std::span<const std::uint8_t> image);

 private:
  SharedImages(std::string link, int file, std::uint8_t* data, std::size_t bytes,
               std::size_t image_bytes)
      : link_(std::move(link)),
        file_(file),
        data_(data),
        bytes_(bytes),
        image_bytes_(image_bytes) {}

  std::string link_;
  int file_;
  std::uint8_t* data_;
  std::size_t bytes_;
  std::size_t image_bytes_;
};

}  // namespace sim2vr::wire
