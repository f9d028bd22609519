// SPDX-License-Identifier: Apache-2.0
#include "failing_memory.hpp"

#include <atomic>
#include <cstdlib>
#include <limits>
#include <new>

namespace {

constexpr long kEnough = std::numeric_limits<long>::max() / 2;
std::atomic<bool> watched{false};
std::atomic<long> left{kEnough};
thread_local long of_this_thread = 0;

void* allocated(std::size_t bytes) {
  if (watched) {
    ++of_this_thread;
    if (left.fetch_sub(1) <= 0) throw std::bad_alloc();
  }
  void* memory = std::malloc(bytes == 0 ? 1 : bytes);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

}  // namespace

void* operator new(std::size_t bytes) { return allocated(bytes); }
void* operator new[](std::size_t bytes) { return allocated(bytes); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

namespace sim2vr::openxr::test {

FailingMemory::FailingMemory(long after) {
  left = after;
  of_this_thread = 0;
  watched = true;
}
FailingMemory::~FailingMemory() { watched = false; }
long FailingMemory::ofThisThread() { return of_this_thread; }
bool FailingMemory::ranOut() { return left < 0; }

}  // namespace sim2vr::openxr::test
