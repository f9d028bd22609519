// SPDX-License-Identifier: Apache-2.0
// A fixed set of threads that work through a range together and wait for each other.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace sim2vr::runtime {

class ThreadPool {
 public:
  /// `threads` >= 1, the calling one included: with 1 nothing is started.
  explicit ThreadPool(int threads);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int threads() const { return static_cast<int>(workers_.size()) + 1; }

  /// Calls work(0) ... work(threads() - 1), one on each thread (the last on the calling one), and
  /// returns when all are done. When some throw, the exception of the lowest index is rethrown
  /// then.
  void run(const std::function<void(int)>& work);

 private:
  void loop(int index);

  std::mutex mutex_;
  std::condition_variable start_;
  std::condition_variable done_;
  const std::function<void(int)>* work_ = nullptr;
  std::uint64_t round_ = 0;
  int running_ = 0;
  bool stop_ = false;
  std::vector<std::exception_ptr> failures_;
  std::vector<std::thread> workers_;
};

}  // namespace sim2vr::runtime
