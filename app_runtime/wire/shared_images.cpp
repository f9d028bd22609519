// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/wire/shared_images.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <random>
#include <string_view>

#include "sim2vr/core/errors.hpp"
#include "sim2vr/core/log.hpp"

namespace sim2vr::wire {
namespace {

std::string nextName() {
  std::random_device random;
  return fmt::format("sim2vr-{:08x}{:08x}", random(), random());
}

std::unique_ptr<SharedImages> givenUp(std::string_view call, int problem) {
  logger().warn("shared memory for images: {}: {}", call, std::strerror(problem));
  return nullptr;
}

}  // namespace

std::unique_ptr<SharedImages> SharedImages::create(std::size_t count, std::size_t image_bytes) {
  const std::string name = nextName();
  const std::size_t bytes = count * image_bytes;
  const int file = ::memfd_create(name.c_str(), MFD_CLOEXEC);
  if (file < 0) return givenUp("memfd_create", errno);
  // Reserved now: writing to memory that is not there would be a SIGBUS later.
  if (const int problem = ::posix_fallocate(file, 0, static_cast<off_t>(bytes)); problem != 0) {
    ::close(file);
    return givenUp("posix_fallocate", problem);
  }
  void* data = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (data == MAP_FAILED) {
    const int problem = errno;
    ::close(file);
    return givenUp("mmap", problem);
  }
  return std::unique_ptr<SharedImages>(new SharedImages(
      "/memfd:" + name + " (deleted)", file, static_cast<std::uint8_t*>(data), bytes, image_bytes));
}

SharedImages::~SharedImages() {
  ::munmap(data_, bytes_);
  ::close(file_);
}

std::string SharedImages::path() const { return fmt::format("/proc/{}/fd/{}", ::getpid(), file_); }

void SharedImages::write(std::size_t index, std::span<const std::uint8_t> image) {
  // Left out, the harness would take the picture before for this one.
  if (image.size() != image_bytes_ || index >= bytes_ / image_bytes_) {
    throw EngineError(
        fmt::format("shared images: got {} bytes for image {}, expected {} for one of {}",
                    image.size(), index, image_bytes_, bytes_ / image_bytes_));
  }
  std::memcpy(data_ + index * image_bytes_, image.data(), image_bytes_);
}

}  // namespace sim2vr::wire
