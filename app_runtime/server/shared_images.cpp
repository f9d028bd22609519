#include "shared_images.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "sim2vr/core/log.hpp"

namespace sim2vr::server {
namespace {

std::string nextName() {
  static std::atomic<int> number{0};
  return "/sim2vr-" + std::to_string(::getpid()) + "-" + std::to_string(number++);
}

std::unique_ptr<SharedImages> givenUp(std::string_view call, int problem) {
  logger().warn("shared memory for images: {}: {}; they go through the socket", call,
                std::strerror(problem));
  return nullptr;
}

}  // namespace

std::unique_ptr<SharedImages> SharedImages::create(std::size_t count, std::size_t image_bytes) {
  const std::string name = nextName();
  const std::size_t bytes = count * image_bytes;
  // A process of the same number in a container of its own may have left the name behind.
  ::shm_unlink(name.c_str());
  const int file = ::shm_open(name.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC, 0600);
  if (file < 0) return givenUp("shm_open", errno);
  // Reserved now: writing to memory that is not there would be a SIGBUS later.
  const int problem = ::posix_fallocate(file, 0, static_cast<off_t>(bytes));
  void* data = problem != 0 ? MAP_FAILED
                            : ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  const int map_problem = errno;
  ::close(file);
  if (data == MAP_FAILED) {
    ::shm_unlink(name.c_str());
    return problem != 0 ? givenUp("posix_fallocate", problem) : givenUp("mmap", map_problem);
  }
  return std::unique_ptr<SharedImages>(
      new SharedImages(name, static_cast<std::uint8_t*>(data), bytes, image_bytes));
}

SharedImages::~SharedImages() {
  unlink();
  ::munmap(data_, bytes_);
}

void SharedImages::write(std::size_t index, std::span<const std::uint8_t> image) {
  if (image.size() != image_bytes_ || (index + 1) * image_bytes_ > bytes_) return;
  std::memcpy(data_ + index * image_bytes_, image.data(), image_bytes_);
}

void SharedImages::unlink() {
  if (linked_) ::shm_unlink(name_.c_str());
  linked_ = false;
}

}  // namespace sim2vr::server
